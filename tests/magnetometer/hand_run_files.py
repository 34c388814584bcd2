"""Run files for recordings of the generator."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from inercal.recordings import Observations
from inercal.runfile import read

SECTIONS: dict[str, dict[str, str]] = {
    "sensor.accelerometer": {"unit": '"m/s²"'},
    "sensor.gyro": {"unit": '"rad/s"'},
    "sensor.magnetometer": {"unit": '"µT"'},
    "bench": {"gravity": '"9.81 m/s²"'},
    "data": {
        "file": '"log.csv"',
        "time": '"t"',
        "accelerometer": '["ax", "ay", "az"]',
        "gyro": '["gx", "gy", "gz"]',
        "magnetometer": '["mx", "my", "mz"]',
    },
    "method": {"name": '"multi_position"'},
}


def run_file(folder: Path, changes: Mapping[str, str | None] | None = None) -> Path:
    """Write a run file with keys changed, such as "bench.field"; None takes a key out.

    A section without keys, such as "sensor.magnetometer", is left out as a whole.
    """
    sections = {name: dict(keys) for name, keys in SECTIONS.items()}
    for key, value in (changes or {}).items():
        section, _, name = key.rpartition(".")
        if value is None and key in sections:
            del sections[key]
        elif value is None:
            sections[section].pop(name)
        else:
            sections.setdefault(section, {})[name] = value
    path = folder / "run.toml"
    lines = [
        f"[{s}]\n" + "".join(f"{k} = {v}\n" for k, v in keys.items())
        for s, keys in sections.items()
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def observed(folder: Path, changes: Mapping[str, str | None] | None = None) -> Observations:
    """Return the observations of a run."""
    return inputs(folder, changes).observations


def inputs(folder: Path, changes: Mapping[str, str | None] | None = None) -> Any:
    """Return the input of the estimator of a run."""
    run = read(run_file(folder, changes))
    return run.kind.observe(run)
