"""Each wrong statement or reading about magnetometers is refused in one line that names its key."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.magnetometer.hand_recordings import Made, faces, recording, scattered
from tests.magnetometer.hand_run_files import inputs, run_file
from tests.refusals import refused

from inercal.benches import Hand
from inercal.pipeline.run_calibration import calibrate_run
from inercal.runfile import read

NO_FIELD = {"sensor.magnetometer": None, "data.magnetometer": None}
FIELD, SECTION = "[bench] field", "[sensor.magnetometer]"


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"bench.field": '"486 µT"'}, FIELD, "mG"),
        ({"bench.field": '"0.486 µT"'}, FIELD, "gauss"),
        ({"bench.field": '"48.6 mT ± 0.3 mT"'}, FIELD, "µT"),
        ({"bench.field": '"48600 µT"'}, FIELD, "nT"),
        ({"bench.field": '"48.6 g"'}, FIELD, "magnetic flux density"),
        ({"bench.field": '"50 µT ± 20 µT"'}, FIELD, "uncertain"),
        ({"bench.dip": '"95°"'}, "[bench] dip", "90°"),
        ({"bench.dip": '"65°"', "bench.hemisphere": '"south"'}, "[bench] dip", "south"),
        ({"bench.latitude": '"-52°"', "bench.hemisphere": '"north"'}, "[bench] latitude", "north"),
        ({"bench.latitude": '"52°"', "bench.dip": '"-60°"'}, "[bench] latitude", "dip"),
        ({"bench.hemisphere": '"west"'}, "[bench] hemisphere", "north"),
        ({**NO_FIELD, "bench.field": '"50 µT"'}, FIELD, "no magnetometers"),
        ({**NO_FIELD, "bench.dip": '"65°"'}, "[bench] dip", "no magnetometers"),
        ({"sensor.magnetometer": None}, SECTION, "missing"),
        ({"data.magnetometer": "[]"}, "[data] magnetometer", "no columns"),
        ({"data.magnetometer": '["mx", "my"]'}, f"{SECTION} axis", "whole field"),
        ({"sensor.magnetometer.axis": '["x", "y", "-x"]'}, f"{SECTION} axis", "independent"),
        ({"sensor.magnetometer.unit": '"LSB"'}, f"{SECTION} scale", "LSB/µT"),
        ({"sensor.magnetometer.unit": '"m/s²"'}, f"{SECTION} unit", "flux density"),
        ({"data.magnetometer": '["mx", "my", "ax"]'}, "[data]", "ax"),
        ({"method.name": '"ferraris"'}, SECTION, "multi_position"),
        ({"method.prior": '{"mx.bias" = "1 µT ± 1 µT"}'}, "[method.prior] mx.bias", "without"),
        ({"method.also": '["mx.k2"]'}, "", "mx.k2"),
        ({"data.magnetometer": '["mx", "my", "mw"]'}, "[data] magnetometer", "mw"),
    ],
)
def test_a_wrong_key_is_named(
    tmp_path: Path, made: Made, changes: dict[str, str | None], key: str, says: str
):
    made.write(tmp_path / "log.csv")
    with refused() as refusal:
        inputs(tmp_path, changes)
    text = str(refusal.value)
    assert says in text
    assert "\n" not in text
    assert not key or refusal.value.key == key


@pytest.mark.parametrize("method", ["tumble", "rates_and_poses", "centrifuge_norm"])
def test_methods_of_other_benches_refuse_the_section(tmp_path: Path, method: str):
    kind = {
        "tumble": '"dividing_head"',
        "rates_and_poses": '"rate_platform"',
        "centrifuge_norm": '"centrifuge"',
    }[method]
    changes: dict[str, str | None] = {"method.name": f'"{method}"', "bench.kind": kind}
    if method == "tumble":
        changes |= {"data.angle": '"t"'}
    if method == "centrifuge_norm":
        changes |= {"bench.radius": '"1 m"', "data.arm_rate": '"w"'}
    with refused(key=SECTION):
        read(run_file(tmp_path, changes))


@pytest.fixture(scope="module")
def made() -> Made:
    rng = np.random.default_rng(4)
    return recording(scattered(12, rng), rng)


def with_field(made: Made, field: np.ndarray) -> Made:
    return Made(made.time, made.force, made.rate, field, made.true_field, made.rest)


def test_readings_in_another_unit_are_refused_with_the_unit_that_fits(tmp_path: Path, made: Made):
    with_field(made, 10 * made.field).write(tmp_path / "log.csv")
    with refused(key=f"{SECTION} unit") as refusal:
        inputs(tmp_path)
    assert "mG" in str(refusal.value)
    assert inputs(tmp_path, {"sensor.magnetometer.unit": '"mG"'}).observations.magnetic is not None


def test_one_accelerometer_in_another_unit_is_named(tmp_path: Path, made: Made):
    force = made.force / [1.0, 1.0, 9.80665]
    replace(made, force=force).write(tmp_path / "log.csv")
    with refused(key="[sensor.accelerometer] unit", names=["az"]):
        inputs(tmp_path)


def test_a_constant_axis_is_refused(tmp_path: Path, made: Made):
    field = made.field.copy()
    field[:, 1] = 3.0
    with_field(made, field).write(tmp_path / "log.csv")
    with refused(names=["my"]):
        inputs(tmp_path)


def test_cells_without_a_number_are_refused_unless_they_may_be_dropped(tmp_path: Path, made: Made):
    field = made.field.copy()
    field[100] = np.nan
    with_field(made, field).write(tmp_path / "log.csv")
    with refused() as refusal:
        inputs(tmp_path)
    assert "mx" in str(refusal.value)
    assert inputs(tmp_path, {"data.nonfinite": '"drop"'}).observations.magnetic is not None


def test_readings_beyond_the_stated_range_are_left_out(tmp_path: Path, made: Made):
    made.write(tmp_path / "log.csv")
    found = inputs(tmp_path, {"sensor.magnetometer.full_scale": '"45 µT"'})
    kept = set(found.observations.magnetic.rest.tolist())
    inside = {k for k in range(12) if np.abs(made.field[made.rest == k]).max() < 45}
    assert kept == inside
    assert 0 < len(kept) < 12


def test_a_magnetometer_without_new_values_is_refused(tmp_path: Path, made: Made):
    field = made.field.copy()
    for k in range(12):
        field[made.rest == k] = field[made.rest == k][0]
    with_field(made, field).write(tmp_path / "log.csv")
    with refused(names=["mx", "my", "mz"]):
        inputs(tmp_path)


def test_a_repeated_face_is_still_refused_without_magnetometers(tmp_path: Path):
    rng = np.random.default_rng(5)
    made = recording(faces(2), rng)
    names = np.array([f"{axis}_{sign}" for axis in "xyz" for sign in "pa" for _ in range(2)])
    made.write(tmp_path / "log.csv", label=np.where(made.rest < 0, "", names[made.rest]))
    changes = {
        **NO_FIELD,
        "method.name": '"six_position"',
        "data.label": '"label"',
        "data.marks": '"labels"',
    }
    with refused():
        inputs(tmp_path, {**changes, "sensor.gyro": None, "data.gyro": None})


@pytest.mark.slow
@pytest.mark.parametrize(("field", "warned"), [("51 µT ± 1 µT", False), ("60 µT ± 1 µT", True)])
def test_a_field_that_is_stated_wrong_gives_reservations(
    tmp_path: Path, made: Made, field: str, *, warned: bool
):
    made.write(tmp_path / "log.csv")
    stated = {"bench.field": f'"{field}"', "bench.gravity": '"9.81 m/s² ± 0.1 mm/s²"'}
    run = read(run_file(tmp_path, stated))
    outcome = calibrate_run(run, advise=False)
    assert any(one.what == "units" for one in outcome.findings) is warned
    assert not warned or outcome.verdict.grade == "reservations"


@pytest.mark.slow
def test_a_field_stated_almost_twice_as_large_is_blamed_for_all_axes(tmp_path: Path, made: Made):
    made.write(tmp_path / "log.csv")
    stated = {"bench.field": '"84 µT ± 0.2 µT"', "bench.gravity": '"9.81 m/s² ± 0.1 mm/s²"'}
    first, cause, after, *_ = calibrate_run(
        read(run_file(tmp_path, stated)), advise=False
    ).verdict.lines
    assert "each magnetometer" in first
    assert "stated field" in cause
    assert "check [bench] field" in after


@pytest.mark.slow
def test_magnetometers_whose_times_are_far_off_are_named(tmp_path: Path, made: Made):
    field = np.roll(made.field, round(0.15 / float(np.median(np.diff(made.time)))), axis=0)
    parts = (made.time, made.force, made.rate, field, made.true_field, made.rest)
    Made(*parts).write(tmp_path / "log.csv")
    stated = {"bench.gravity": '"9.81 m/s² ± 0.1 mm/s²"'}
    outcome = calibrate_run(read(run_file(tmp_path, stated)), advise=False)
    assert "delay" in outcome.verdict.warned
    assert "ms later than the other sensors'" in outcome.verdict.lines[1]
    assert outcome.verdict.lines[2] == "Next: correct the times."
    assert outcome.verdict.grade != "consistent"


@pytest.mark.parametrize(
    ("changes", "sign"),
    [
        ({}, 0),
        ({"bench.hemisphere": '"south"'}, -1),
        ({"bench.dip": '"-60° ± 1°"'}, -1),
        ({"bench.dip": '"1° ± 1°"'}, 0),
        ({"bench.latitude": '"48°"'}, 1),
        ({"bench.latitude": '"-12°"'}, 0),
        ({"bench.latitude": '"-12°"', "bench.dip": '"50°"'}, 1),
    ],
)
def test_hemisphere_dip_or_latitude_tell_where_the_field_points(
    tmp_path: Path, changes: dict[str, str | None], sign: int
):
    bench = read(run_file(tmp_path, changes)).bench
    assert isinstance(bench, Hand)
    assert bench.dip_sign == sign
