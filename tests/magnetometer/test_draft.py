"""`inercal init` recognises magnetometers by name and by value, with their unit and their axes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.magnetometer.hand_recordings import Made, recording, scattered

from inercal.pipeline import drafts
from inercal.pipeline.drafts import Draft, draft_run_file
from inercal.pipeline.drafts.method_trials import Candidate, MethodTrial

PERMUTED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # as in an MPU-9250


def made(axes: np.ndarray | None = None, size: float = 1.0) -> Made:
    rng = np.random.default_rng(6)
    found = recording(scattered(12, rng), rng, axes=axes, noise=0.3)
    return Made(
        found.time, found.force, found.rate, size * found.field, found.true_field, found.rest
    )


def drafted(folder: Path, one: Made, head: str | None, **stated: str) -> Draft:
    path = one.write(folder / "log.csv")
    lines = path.read_text().splitlines()[1:]
    path.write_text("\n".join([*([] if head is None else [head]), *lines]) + "\n")
    known = {"bench.latitude": "48 °", "data.rate": "100 Hz", **stated}
    return draft_run_file([path], folder / "run.toml", known, typical=True)


@pytest.fixture
def untried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the first candidate untried: calibrations by them take nearly all of the time."""
    fits: Any = SimpleNamespace(verdict=SimpleNamespace(grade="consistent"))

    def first(_: object, candidates: Sequence[Candidate], __: Path) -> tuple[MethodTrial, ...]:
        name, own = candidates[0][1:]
        return (MethodTrial(name, dict(own), fits),)

    monkeypatch.setattr(drafts, "try_methods", first)


def keys(draft: Draft) -> dict[str, object]:
    return {entry.dotted: entry.value for entry in draft.entries}


NAMES = ["mx,my,mz", "mag_x,mag_y,mag_z", "MagX_uT,MagY_uT,MagZ_uT", "compassX,compassY,compassZ"]


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("names", [NAMES[0], *map(evidence, NAMES[1:]), "q (1),r (1),s (1)"])
def test_magnetometers_are_recognised_by_name_or_by_values(tmp_path: Path, names: str):
    found = keys(drafted(tmp_path, made(), f"t,ax,ay,az,gx,gy,gz,{names}"))
    assert found["data.magnetometer"] == names.split(",")
    assert found["sensor.magnetometer.unit"] == "µT"
    assert "sensor.magnetometer.axis" not in found
    assert found["data.accelerometer"] == ["ax", "ay", "az"]
    assert found["data.gyro"] == ["gx", "gy", "gz"]


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("axes", [None, PERMUTED])
def test_a_log_without_names_keeps_the_three_triads_apart(tmp_path: Path, axes: np.ndarray | None):
    found = keys(drafted(tmp_path, made(axes), None))
    assert found["data.accelerometer"] == [2, 3, 4]
    assert found["data.gyro"] == [5, 6, 7]
    assert found["data.magnetometer"] == [8, 9, 10]
    expected = None if axes is None else ["y", "x", "-z"]
    assert found.get("sensor.magnetometer.axis") == expected


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(("size", "unit"), [(10.0, "mG"), evidence(0.01, "gauss"), (1000.0, "nT")])
def test_the_unit_is_the_one_in_which_the_field_is_that_of_the_earth(
    tmp_path: Path, size: float, unit: str
):
    found = keys(drafted(tmp_path, made(size=size), "t,ax,ay,az,gx,gy,gz,mx,my,mz"))
    assert found["sensor.magnetometer.unit"] == unit


@pytest.mark.usefixtures("untried")
def test_readings_that_fit_no_unit_are_counts_with_a_scale(tmp_path: Path):
    found = keys(drafted(tmp_path, made(size=20.0), "t,ax,ay,az,gx,gy,gz,mx,my,mz"))
    assert found["sensor.magnetometer.unit"] == "LSB"
    per_field = float(str(found["sensor.magnetometer.scale"]).partition(" ")[0])
    assert abs(per_field / 20 - 1) < 0.1  # the soft iron is 3 %


def counted(one: Made) -> Made:
    return replace(one, field=np.rint(one.field))


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(
    ("size", "stated", "unit", "asked"),
    [
        (6.67, {}, "mG", {"unit"}),
        (30.0, {}, "LSB", {"unit", "scale"}),
        (30.0, {"sensor.magnetometer.unit": "LSB"}, "LSB", {"scale"}),
        (6.67, {"bench.field": "50 µT ± 1 µT"}, "LSB", set()),
        (10.0, {"bench.field": "50 µT ± 1 µT"}, "mG", set()),
        (6.67, {"sensor.magnetometer.scale": "6.67 LSB/µT"}, "LSB", set()),
        (6.67, {"sensor.magnetometer.unit": "mG"}, "mG", set()),
    ],
)
def test_whole_numbers_leave_the_unit_open_unless_a_field_is_stated(
    tmp_path: Path, size: float, stated: dict[str, str], unit: str, asked: set[str]
):
    log, head = counted(made(size=size)), "t,ax,ay,az,gx,gy,gz,mx,my,mz"
    draft = drafted(tmp_path, log, head, **stated)
    found, section = keys(draft), "sensor.magnetometer"
    assert found[f"{section}.unit"] == unit
    assert found.get(f"{section}.unit_assumed", False) is bool(asked)
    taken = {one.key for one in draft.entries if one.assumed} - {"timebase"}
    assert taken == asked
    questions = draft_run_file(
        [tmp_path / "log.csv"],
        tmp_path / "run.toml",
        {"bench.latitude": "48 °", "data.rate": "100 Hz", **stated},
    ).questions
    assert {one.dotted for one in questions} == {f"{section}.{key}" for key in asked}
    if unit == "LSB":
        per_field = float(str(found[f"{section}.scale"]).partition(" ")[0])
        assert abs(per_field / size - 1) < 0.1


@pytest.mark.slow
def test_the_hemisphere_decides_about_a_left_handed_triad(tmp_path: Path):
    mirrored = np.diag([1.0, 1.0, -1.0])
    head = "t,ax,ay,az,gx,gy,gz,mx,my,mz"
    found = keys(drafted(tmp_path, made(mirrored), head, **{"bench.hemisphere": "north"}))
    assert found["sensor.magnetometer.axis"] == ["x", "y", "-z"]


@pytest.mark.slow
@pytest.mark.usefixtures("untried")
def test_no_magnetometers_are_found_where_there_are_none(tmp_path: Path):
    rng = np.random.default_rng(7)
    one = made()
    noise = Made(
        one.time, one.force, one.rate, rng.normal(size=one.field.shape), one.field, one.rest
    )
    found = keys(drafted(tmp_path, noise, None))
    assert found["data.accelerometer"] == [2, 3, 4]
    assert "data.magnetometer" not in found
