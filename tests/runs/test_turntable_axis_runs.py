"""Run files with one gyro, or other sets of axes, on a turntable whose angles are read."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import turntable
from tests.base_seeds import chosen
from tests.methods.axes_on_table import Directions, draw_motions, mount
from tests.methods.axis_devices import DIRECTIONS
from tests.methods.turntable_cases import discrete
from tests.refusals import refused

from inercal.cli.app import app
from inercal.pipeline import apply, calibrate

GRADE, HZ = turntable.grade(0.1, 0, 60, 0), 25.0  # a run file states no correlation time
TABLE = turntable.Table(gravity=9.80123)
AXES: dict[str, Mapping[str, Directions]] = {
    "one gyro": {"w": DIRECTIONS["one"]},
    "an inclined gyro": {"w": DIRECTIONS["one, inclined"]},
    "an accelerometer": {"f": DIRECTIONS["one"]},
    "two gyros and an accelerometer": {
        "f": DIRECTIONS["one, inclined"],
        "w": DIRECTIONS["two, not at right angles"],
    },
    "a cluster of gyros": {"w": DIRECTIONS["four"]},
}
KEYS = {
    "f": ("accelerometer", "m/s²", "60 µg/√Hz"),
    "w": ("gyro", "rad/s", "0.1 °/√h"),
}


@pytest.fixture(scope="module")
def motions() -> turntable.Draw:
    return draw_motions(3, 1, discrete(30.0), TABLE, HZ)


def write_run(
    folder: Path, motions: turntable.Draw, axes: Mapping[str, Directions]
) -> tuple[Path, dict[str, float]]:
    """Write a recording and its run file, and return it and the true coefficients by full name."""
    made, truth = mount(motions, axes, GRADE, 3)
    columns = {"time": made.time}
    columns |= dict(zip(("outer", "middle", "inner"), np.degrees(made.angles[0].T), strict=True))
    sensor, data, true = "", "", dict[str, float]()
    for kind, read in (("f", made.forces), ("w", made.rates)):
        key, unit, white = KEYS[kind]
        names = [f"{key} {k + 1}" for k in range(read.shape[2])]
        data += f"{key} = {json.dumps(names)}\n"
        columns |= dict(zip(names, read[0].T, strict=True))
        if names:
            directions = json.dumps([list(one) for one in axes[kind]])
            sensor += f'[sensor.{key}]\naxis = {directions}\nunit = "{unit}"\nwhite = "{white}"\n'
    np.savetxt(
        folder / "log.csv", np.column_stack([*columns.values()]), "%.12g", ",",
        header=",".join(columns), comments="",
    )  # fmt: skip
    path = folder / "run.toml"
    path.write_text(
        f"""{sensor}
[bench]
kind = "turntable"
gravity = "{TABLE.gravity} m/s² ± 0 m/s²"
latitude = "38 °"
azimuth = "0 ° ± 0.1 °"
lean = "5 ″"
square = "2 ″"
harmonics = ["1.4 ″", "0.7 ″"]
noise = "0.5 ″"
latency = "0 ms ± 5 ms"
[data]
file = "log.csv"
time = "time"
{data}[method]
name = "turntable_discrete"
""",
        encoding="utf-8",
    )
    of_axis: dict[str, list[float]] = {name: one[0].tolist() for name, one in truth.items()}
    for number, values in enumerate(zip(*of_axis.values(), strict=True)):
        true |= {f"{number} {name}": x for name, x in zip(of_axis, values, strict=True)}
    return path, true


def changed(path: Path, *pairs: tuple[str, str]) -> Path:
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("which", chosen(AXES, [*AXES][::2]))
def test_axes_on_a_turntable(tmp_path: Path, motions: turntable.Draw, which: str):
    path, true = write_run(tmp_path, motions, AXES[which])
    outcome = calibrate(path)
    assert outcome.verdict.grade == "consistent"
    calibration = outcome.calibration
    channels = calibration.sensor.channels
    for name in calibration.sensor.coefficients:
        axis, term = name.split(".")
        key = f"{channels.index(axis)} {({'k0': 'bias', 'k1': 'scale'}).get(term, term)}"
        assert abs(calibration.value(name) - true[key]) < 3.9 * calibration.uncertainty(name), name
    corrected = apply(calibration, path)
    assert len(corrected.channels) == sum(calibration.sensor.rank(kind) for kind in ("f", "w"))


@pytest.mark.slow
def test_the_verb_calibrates_one_gyro(tmp_path: Path, motions: turntable.Draw):
    path, _ = write_run(tmp_path, motions, AXES["one gyro"])
    app(["calibrate", str(path), "--out", str(tmp_path / "out")], standalone_mode=False)
    assert {one.suffix for one in (tmp_path / "out").iterdir()} == {".json", ".html"}


READBACK = ('latency = "0 ms ± 5 ms"', "readback = false")


def test_one_gyro_without_readback_is_refused(tmp_path: Path, motions: turntable.Draw):
    path, _ = write_run(tmp_path, motions, AXES["one gyro"])
    with refused(key="[bench] readback", names=("turntable_discrete",)):
        calibrate(changed(path, READBACK))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('gyro = ["gyro 1"]', 'gyro = ["-gyro 1"]'), '[data] gyro = ["gyro 1"]'),
        (('"rad/s"', '"°/s"'), "gyro 1 0.0175"),
        (("axis = [[0, 0, 1]]", "axis = [[1, 0, 0]]"), "[bench] axes"),
    ],
    ids=["sign", "unit", "direction"],
)
def test_a_wrong_column_of_one_gyro_is_refused(
    tmp_path: Path, motions: turntable.Draw, change: tuple[str, str], named: str
):
    path, _ = write_run(tmp_path, motions, AXES["one gyro"])
    with refused() as error:
        calibrate(changed(path, change))
    assert named in str(error.value)


def test_one_gyro_does_not_align_the_clock_of_a_separate_readback(
    tmp_path: Path, motions: turntable.Draw
):
    path, _ = write_run(tmp_path, motions, AXES["one gyro"])
    beside = 'file = "log.csv"\ntable_file = "log.csv"\ntable_time = "time"\n'
    with refused(key="[data] table_file"):
        calibrate(changed(path, ('file = "log.csv"\n', beside)))
