"""A turntable without readback: no angle is recorded, read, or taken by a method that needs it."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.qualification.test_bench_keys import qualification_of
from tests.runfile.key_sweep import Content, example, toml

from inercal.basics.errors import InputError
from inercal.benches.qualification.result import save
from inercal.methods import METHODS
from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

Change = tuple[str, str, object]
ANGLES = {"outer", "middle", "inner"}
WITHOUT = ("bench", "readback", False)


def write(folder: Path, content: Content) -> Path:
    path = folder / "run.toml"
    path.write_text(toml(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "name",
    [name for name in METHODS if name.startswith("turntable_")],
)
def test_methods_that_use_the_angles_are_refused_and_the_one_that_does_not_is_named(
    tmp_path: Path, name: str
):
    shutil.copy(
        Path(__file__).parents[2] / "examples" / "turntable" / "path.csv", tmp_path / "path.csv"
    )
    content = example("turntable/mimu.toml", ("method", "name", name))
    read(write(tmp_path, content))
    content["bench"]["readback"] = False
    with pytest.raises(InputError, match="systematic") as caught:
        read(write(tmp_path, content))
    assert caught.value.key == "[bench] readback"


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        *(
            ("bench", key, value)
            for key, value in {
                "azimuth": "0 ° ± 0.2 °",
                "lean": "5 ″",
                "square": "2 ″",
                "harmonics": ["2 ″"],
                "noise": "0.5 ″",
                "latency": "0 ms ± 1 ms",
                "clock": "1 ppm",
            }.items()
        ),
        ("data", "table", ["a", "b", "c"]),
        ("data", "table_unit", "rad"),
        ("data", "hold", "hold"),
    ],
)
@pytest.mark.parametrize("readback", [True, False])
def test_keys_of_the_readback_are_refused_when_the_run_file_is_read(
    tmp_path: Path, section: str, key: str, value: object, readback: bool
):
    content = example("systematic/imu.toml", ("bench", "readback", readback), (section, key, value))
    with pytest.raises(InputError) as caught:
        read(write(tmp_path, content))
    assert caught.value.key == f"[{section}] {key}"


def test_a_qualification_of_angles_is_refused_and_one_of_gravity_is_not(tmp_path: Path):
    typed = read(write(tmp_path, example("systematic/imu.toml", WITHOUT)))
    for name in ("g", "lean_x"):
        save(qualification_of(typed, [name]), tmp_path / f"{name}.json")

    def stated(name: str, *more: Change) -> Run:
        changes = (("bench", "qualification", f"{name}.json"), ("bench", "gravity", None), *more)
        kept = changes if name == "g" else (changes[0], *more)
        return read(write(tmp_path, example("systematic/imu.toml", *kept)))

    assert stated("g", WITHOUT).bench.gravity == typed.bench.gravity
    assert "lean" in stated("lean_x").qualified.keys
    with pytest.raises(InputError) as caught:
        stated("lean_x", WITHOUT)
    assert caught.value.key == "[bench] qualification"
    assert caught.value.names == ("lean",)


@pytest.mark.slow
def test_readings_are_the_same_and_the_recording_has_no_angles(tmp_path: Path):
    small = (("data", "rate", "20 Hz"), ("data", "file", "log.npz"), ("method", "seconds", "12 s"))
    with_angles = simulate(write(tmp_path, example("systematic/imu.toml", *small)), 1)
    path = write(tmp_path, example("systematic/imu.toml", *small, WITHOUT))
    without = simulate(path, 1)
    assert set(with_angles.readback) == ANGLES
    assert not without.readback
    np.testing.assert_array_equal(without.data, with_angles.data)
    run = read(path)
    write_recording(apply_data_columns(run, without), run.file("log.npz"))
    assert not set(np.load(tmp_path / "log.npz").files) & ANGLES
    outcome = calibrate(run)
    assert len(outcome.observations.labels) == 19
    assert outcome.verdict.grade == "consistent"
