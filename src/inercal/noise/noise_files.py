"""Write sensor noise to files: run-file sections, Kalibr's imu.yaml and ROS covariances.

All axes of a triad share one value, which is the root mean square over the axes. Kalibr needs
values in continuous time: N in rad/s/√Hz and m/s²/√Hz, and K in rad/s²/√Hz and m/s³/√Hz.
"""

from collections.abc import Callable, Collection

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_value_and_uncertainty, si_factor
from inercal.noise.channel_noise import SI_UNIT, coefficient_unit
from inercal.noise.filter_file import filter_text
from inercal.noise.sensor_noise import SensorNoise, TriadNoise, require_rate
from inercal.noise.terms import FLICKER_FLOOR
from inercal.physics.quantities import SensorKind

HORIZON = 100.0  # s, time over which a filter without B should be correct
_KEYS = {"N": "white", "B": "bias_instability", "K": "random_walk"}
NOISE_KEYS = tuple(_KEYS.values())
_MARK = "# inercal noise"


def section_lines(noise: TriadNoise) -> list[str]:
    """Return the keys for [sensor.gyro] or [sensor.accelerometer], with u in comments."""
    lines: list[str] = []
    for symbol, (value, u) in noise.values.items():
        unit = coefficient_unit(symbol, noise.quantity)
        size = si_factor(unit)
        number = f"{value / size:.4g}"
        if symbol in noise.limits:
            comment = "upper limit (95 %): not detected"
        elif u is None:
            comment = f"data sheet, without u: {noise.origins[symbol]}"
        else:
            number, spread = format_value_and_uncertainty(value / size, u / size)
            comment = f"u = {spread} {unit}"
        lines.append(f'{_KEYS[symbol]} = "{number} {unit}"  # {comment}')
    return lines + [f"{_MARK}: {one}" for one in noise.notes]


def run_file_sections(noise: SensorNoise) -> dict[str, list[str]]:
    """Return the lines for each section of a run file, by section name."""
    return {f"sensor.{quantity}": section_lines(one) for quantity, one in noise.triads.items()}


def merge_sections(
    text: str, sections: dict[str, list[str]], replaced: Collection[str] = ()
) -> str:
    """Insert noise keys into the text of a run file; the same keys in its sections are replaced.

    Parameters
    ----------
    text : str
        Text of the run file; empty for a new file, which then contains only the sections.
    sections : dict of str to list of str
        Lines from `run_file_sections`.
    replaced : collection of str
        Keys to remove even if the sections do not contain them, because an earlier analysis wrote
        them.
    """
    lines = text.splitlines()
    for name, new in sections.items():
        head = f"[{name}]"
        if head not in [line.split("#")[0].strip() for line in lines]:
            lines += ["", head] if lines else [head]
            lines += new
            continue
        start = next(k for k, line in enumerate(lines) if line.split("#")[0].strip() == head)
        stop = next(
            (k for k in range(start + 1, len(lines)) if lines[k].lstrip().startswith("[")),
            len(lines),
        )
        keys = {line.split("=")[0].strip() for line in new if not line.startswith("#")}
        keys |= set(replaced)
        body = [
            line
            for line in lines[start + 1 : stop]
            if line.split("=")[0].strip() not in keys and not line.startswith(f"{_MARK}: ")
        ]
        tail = len(body)
        while tail and not body[tail - 1].strip():
            tail -= 1
        lines[start + 1 : stop] = [*body[:tail], *new, *body[tail:]]
    return "\n".join(lines) + "\n"


def walk_for_filter(
    noise: TriadNoise, horizon: float, *, is_data_sheet: bool = False
) -> tuple[float, str]:
    """Return K, SI, and a text that states where this value comes from.

    If K was measured or stated, this value is returned. Otherwise the function returns 0.664 B
    √(3/τ_h) with a horizon τ_h, s, or the upper limit of K if B is unknown. K is 0 if a data sheet
    states neither B nor K.
    """
    origin, done = ("data sheet", "stated") if is_data_sheet else ("fit", "detected")
    if "K" in noise.values and "K" not in noise.limits:
        return noise.values["K"][0], f"from the {origin}"
    if "B" in noise.values:
        value = float(np.sqrt(FLICKER_FLOOR)) * noise.values["B"][0] * np.sqrt(3 / horizon)
        return float(value), (
            f"no random walk is {done}: K from the Allan deviation of B at {horizon:g} s"
        )
    if "K" in noise.values:
        return noise.values["K"][0], "upper limit (95 %): no random walk is detected"
    return 0.0, f"neither a random walk nor a bias instability is {done}"


def _require_walk(noise: TriadNoise, horizon: float, *, is_data_sheet: bool) -> tuple[float, str]:
    """Return K and its origin; raise an error if K is zero, because filters do not accept this."""
    walk, why = walk_for_filter(noise, horizon, is_data_sheet=is_data_sheet)
    if not walk:
        raise InputError(
            f"[datasheet.{noise.quantity}] states neither random_walk nor bias_instability, "
            "but Kalibr needs one of them; add it, or record the sensor at rest",
            key=f"[datasheet.{noise.quantity}] random_walk",
        )
    return walk, why


def _white(noise: TriadNoise, *, is_data_sheet: bool) -> float:
    if "N" in noise.values:
        return noise.values["N"][0]
    if is_data_sheet:
        raise InputError(
            f"[datasheet.{noise.quantity}] states no white noise, but Kalibr and ROS need it; "
            "add white or rms",
            key=f"[datasheet.{noise.quantity}] white",
        )
    raise InputError(
        f"no white noise N was found for the {noise.quantity}s, but Kalibr and ROS need it; "
        "fit it, for example with --terms NBK",
        key="--terms",
    )


def _absence(noise: SensorNoise) -> str:
    return "not stated" if noise.is_data_sheet else "not measured"


def kalibr_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return Kalibr's imu.yaml; the densities are written as they are, without a safety factor.

    Raises
    ------
    InputError
        There are no axes, an axis has no white noise, or there is no sampling rate.
    """
    lines = [f"{_MARK}: Kalibr, continuous-time, of {noise.source}"]
    rate = 0.0
    names: dict[SensorKind, str] = {"accelerometer": "accelerometer", "gyro": "gyroscope"}
    for quantity, name in names.items():
        unit = SI_UNIT[quantity]
        triad = noise.triads.get(quantity)
        if triad is None:
            lines.append(f"# {name}: {_absence(noise)}")
            continue
        rate = require_rate(triad)
        walk, why = _require_walk(triad, horizon, is_data_sheet=noise.is_data_sheet)
        white = _white(triad, is_data_sheet=noise.is_data_sheet)
        lines += [
            f"{name}_noise_density: {white:.6e}  # {unit}/√Hz",
            f"{name}_random_walk: {walk:.6e}  # {unit}/s/√Hz; {why}",
        ]
    if not rate:
        raise InputError("the analysis has no axes, so there is nothing to write for Kalibr")
    return "\n".join([*lines, "rostopic: /imu0", f"update_rate: {rate:.6g}", ""])


def ros_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return covariances, N²/Δ for each axis, and continuous-time densities.

    They are those of sensor_msgs/Imu, and of sensor_msgs/MagneticField if there are magnetometers.

    Raises
    ------
    InputError
        The axes of one kind of sensor have no white noise, or there is no sampling rate.
    """
    messages = "sensor_msgs/Imu"
    names: dict[SensorKind, tuple[str, str]] = {
        "gyro": ("angular_velocity", "gyroscope"),
        "accelerometer": ("linear_acceleration", "accelerometer"),
    }
    if "magnetometer" in noise.triads:
        messages += " and sensor_msgs/MagneticField"
        names["magnetometer"] = "magnetic_field", "magnetometer"
    lines = [f"{_MARK}: ROS {messages}, of {noise.source}"]
    for quantity, (field, prefix) in names.items():
        triad = noise.triads.get(quantity)
        if triad is None:
            lines.append(f"{field}_covariance: [-1, 0, 0, 0, 0, 0, 0, 0, 0]  # {_absence(noise)}")
            continue
        white = _white(triad, is_data_sheet=noise.is_data_sheet)
        rate = require_rate(triad)
        axes = [one.get("N", 0.0) ** 2 * rate for one in triad.axes][:3]
        axes += [axes[-1]] * (3 - len(axes))
        x, y, z = axes
        walk, why = walk_for_filter(triad, horizon, is_data_sheet=noise.is_data_sheet)
        lines += [
            f"{field}_covariance: [{x:.6e}, 0, 0, 0, {y:.6e}, 0, 0, 0, {z:.6e}]",
            f"{prefix}_noise_density: {white:.6e}",
            f"{prefix}_random_walk: {walk:.6e}  # {why}"
            if walk
            else f"# {prefix}_random_walk: {why}",
        ]
    return "\n".join([*lines, ""])


WRITERS: dict[str, Callable[[SensorNoise, float], str]] = {
    "kalibr": kalibr_text,
    "ros": ros_text,
    "filter": filter_text,
}
"""Functions that write the files for other programs, by the program's name."""
