"""The noise densities that files of Kalibr and OpenVINS need: the user states them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.export.target_definition import TargetOption
from inercal.export.targets.shared import yaml_number

_KEYS = {
    "accelerometer_noise_density": "m/s^2/sqrt(Hz)",
    "accelerometer_random_walk": "m/s^3/sqrt(Hz)",
    "gyroscope_noise_density": "rad/s/sqrt(Hz)",
    "gyroscope_random_walk": "rad/s^2/sqrt(Hz)",
    "update_rate": "Hz",
}
_LARGEST = 1 << 20
NOISE_OPTIONS = (
    *(TargetOption(name, f"{unit}; or in the file of noise") for name, unit in _KEYS.items()),
    TargetOption("noise", "imu.yaml of a noise analysis, with these keys", kind=str),
    TargetOption("rostopic", "topic of the IMU", "/imu0", kind=str),
)


def noise_lines(options: Mapping[str, Any], target: str) -> list[str]:
    """Return the lines `key: number` of the noise.

    Raises
    ------
    InputError
        A number is not stated, or is not above 0, or the file cannot be read.
    """
    known: dict[str, float] = {}
    if options["noise"] is not None:
        path = Path(options["noise"])
        text = read_small_file(path, "file of noise", _LARGEST).decode("utf-8", "replace")
        for name in _KEYS:
            # One number per line: PyYAML, an extra, is not needed.
            if found := re.search(rf"^\s*{name}\s*:\s*([-+.\deE]+)", text, re.MULTILINE):
                known[name] = _number(found[1], name, path)
    known |= {name: options[name] for name in _KEYS if options[name] is not None}
    missing = [name for name in _KEYS if name not in known]
    if missing:
        raise InputError(
            f"target {target} needs the noise of the IMU, which no calibration holds: "
            + ", ".join(f"--set {name}=… ({_KEYS[name]})" for name in missing)
            + ", or --set noise=imu.yaml of a noise analysis",
            key="--set",
            names=tuple(missing),
        )
    wrong = [name for name, value in known.items() if not value > 0]
    if wrong:
        raise InputError(
            f"target {target}: {wrong[0]} is {known[wrong[0]]:g}; give a number above 0",
            key="--set",
            names=tuple(wrong),
        )
    return [f"{name}: {yaml_number(known[name])}" for name in _KEYS] + [
        f"rostopic: {options['rostopic']}",
        "time_offset: 0.0",
    ]


def _number(text: str, name: str, path: Path) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}: {name}: {text} is no number", file=path, key=name) from None
