"""Run files with magnetometers from end to end: good data, and what must be refused in one line."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import chosen, evidence
from tests.magnetometer import generator as sim
from tests.magnetometer.recorded import MOVING, RATE_HZ, STILL, recording, table
from tests.program import run_program

from inercal.basics.errors import InputError, NotObserved
from inercal.pipeline import Outcome, calibrate

Rng = np.random.Generator
FIELD = "50 µT ± 0.3 µT"
AXES = {
    "rotated": ('["y", "x", "-z"]', np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])),
    "left-handed": ('["y", "x", "z"]', np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1.0]])),
    "reversed": ('["x", "y", "-z"]', np.diag([1, 1, -1.0])),
}
N = 24


def refusal(path: Path) -> str:
    """Return the one line with which the program ends with status 2."""
    ended = run_program("calibrate", path)
    assert ended.status == 2, ended.output + ended.error
    return ended.error


def require_true(outcome: Outcome, own: sim.Device, axes: np.ndarray | None = None) -> None:
    """Check bias and scale of each axis and the dip against the device, within 4.5 u."""
    axes = np.eye(3) if axes is None else axes
    found = outcome.calibration
    for k, axis in enumerate(axes):
        for name, true in (("bias", own.o[k]), ("scale", own.d[k] @ axis - 1)):
            # An axis is named after its direction, not after its column.
            full = f"m{'xyz'[int(np.argmax(np.abs(axis)))]}.{name}"
            assert abs(found.value(full) - true) < 4.5 * found.uncertainty(full), full
    at = outcome.estimate.names.index("dip")
    assert abs(outcome.estimate.value[at] - own.dip) < 4.5 * outcome.estimate.std[at]


def label_at(outcome: Outcome, rest: int) -> str:
    """Return the label of a rest, by its time, because the program may not find all rests."""
    middle = rest * (STILL + MOVING) + STILL / 2
    seen = outcome.observations
    k = int(np.argmin(np.abs(seen.time - middle)))
    assert abs(seen.time[k] - middle) < STILL / 2
    return seen.labels[k]


@pytest.fixture(autouse=True)
def _outputs_in_a_folder_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def rng() -> Rng:
    return np.random.default_rng(7)


@pytest.mark.parametrize("which", chosen(AXES, ("rotated", "left-handed")))
def test_axes_as_stated_are_calibrated_and_others_refused(which: str, rng: Rng, tmp_path: Path):
    stated, axes = AXES[which]
    own, attitude = sim.device(rng, axes), sim.scattered(rng, N)
    data = sim.rests(rng, attitude, own)
    key = f"axis = {stated}"
    path = table(tmp_path, data, attitude, rng, field=FIELD, sensor=[key])
    outcome = calibrate(path)
    assert outcome.verdict.grade == "consistent"
    require_true(outcome, own, axes)
    line = refusal(table(tmp_path, data, attitude, rng, field=FIELD, hemisphere="north"))
    assert key in line
    assert "run.toml" in line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hemisphere", "other", "sign"), [("north", "south", 1), ("south", "north", -1)]
)
def test_the_field_points_down_in_the_north_only(
    hemisphere: str, other: str, sign: int, rng: Rng, tmp_path: Path
):
    own, attitude = sim.device(rng, dip=sign * sim.DIP), sim.scattered(rng, N)
    data = sim.rests(rng, attitude, own)
    outcome = calibrate(table(tmp_path, data, attitude, rng, field=FIELD, hemisphere=hemisphere))
    require_true(outcome, own)
    path = table(tmp_path, data, attitude, rng, field=FIELD, hemisphere=other)
    with pytest.raises(InputError) as refused:
        calibrate(path)
    assert refused.value.key == "[bench] latitude"
    assert 'axis = ["-x", "-y", "-z"]' in refusal(path)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [evidence("G"), evidence("mG"), "LSB"])
def test_other_units_give_the_same_and_a_wrong_unit_is_named(unit: str, rng: Rng, tmp_path: Path):
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    data = sim.rests(rng, attitude, own)
    sensor = ['scale = "6.67 LSB/µT"'] if unit == "LSB" else []

    def made(**keys: Any) -> Path:
        same = np.random.default_rng(3)
        return table(tmp_path, data, attitude, same, field=FIELD, **keys)

    one = calibrate(made()).calibration
    other = calibrate(made(unit=unit, sensor=sensor)).calibration
    np.testing.assert_allclose(one.values[9:], other.values[9:], atol=1e-6)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-4, atol=1e-15)
    line = refusal(made(unit=unit, stated="µT"))
    fits = re.search(r"the unit is (\S+?):", line)
    if unit == "LSB":  # no other unit fits
        assert "unit" in line
    else:
        assert fits is not None
        same = calibrate(made(unit=unit, stated=fits[1])).calibration
        np.testing.assert_allclose(same.values, other.values, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("stated", [True, False])
def test_rests_beyond_the_range_are_left_out(stated: bool, rng: Rng, tmp_path: Path):
    """Without a stated range, a rest is recognised if all of its samples are at the end."""
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    largest = np.abs(sim.rests(rng, attitude, own, noise=0.0).reading).max(axis=1)
    limit = np.floor(1e7 * np.sort(largest)[-4] - 10) / 1e7
    scatter = sim.SIGMA_M * np.sqrt(STILL * RATE_HZ)
    beyond = np.flatnonzero(largest > limit + (0 if stated else 4 * scatter))
    assert beyond.size > 1
    sensor = [f'full_scale = "{limit * 1e6:.1f} µT"'] if stated else []
    outcome = calibrate(
        recording(tmp_path, attitude, own, rng, full_scale=limit, field=FIELD, sensor=sensor)
    )
    magnetic = outcome.observations.magnetic
    assert magnetic is not None
    used = {outcome.observations.labels[k] for k in magnetic.rest.tolist()}
    assert not used & {label_at(outcome, k) for k in beyond.tolist()}
    lost = [one for one in outcome.findings if one.what == "magnetometer"]
    assert len(lost) == len(outcome.observations.labels) - len(used) >= beyond.size
    assert all(re.search(r"\bm[xyz]\b", one.message) for one in lost)
    assert outcome.verdict.grade != "consistent"
    require_true(outcome, own)


def test_a_constant_axis_is_refused(rng: Rng, tmp_path: Path):
    path = recording(tmp_path, sim.scattered(rng, N), sim.device(rng), rng, constant=[1])
    assert "my" in refusal(path)


@pytest.mark.slow
def test_repeated_values_of_a_slow_magnetometer_count_once(rng: Rng, tmp_path: Path):
    own, attitude, every = sim.device(rng), sim.scattered(rng, N), 5
    sizes = []
    for slow in (1, every):
        path = recording(tmp_path, attitude, own, rng, every=slow, field=FIELD)
        outcome = calibrate(path)
        require_true(outcome, own)
        assert outcome.verdict.grade == "consistent"
        magnetic = outcome.observations.magnetic
        assert magnetic is not None
        sizes.append(np.sqrt(np.mean(np.diagonal(magnetic.covariance, axis1=1, axis2=2))))
    assert sizes[1] / sizes[0] == pytest.approx(np.sqrt(every), rel=0.1)


def test_too_few_rests_are_refused(rng: Rng, tmp_path: Path):
    attitude = sim.six_faces(rng, 1, 0.005)
    data = sim.rests(rng, attitude, sim.device(rng))
    path = table(tmp_path, data, attitude, rng, method="six_position", field=FIELD)
    with pytest.raises(NotObserved):
        calibrate(path)
    assert "6 attitudes" in refusal(path)


@pytest.mark.slow
def test_one_azimuth_for_each_face_is_refused_with_what_it_leaves_open(rng: Rng, tmp_path: Path):
    attitude = np.repeat(sim.six_faces(rng, 1), 2, axis=0)
    data = sim.rests(rng, attitude, sim.device(rng))
    path = table(tmp_path, data, attitude, rng, method="six_position", field=FIELD)
    with pytest.raises(NotObserved) as refused:
        calibrate(path)
    assert len(refused.value.directions) == 1
    assert all(name.startswith("m") for name in refused.value.names if name != "dip")
    assert refused.value.directions[0] in refusal(path)
    two = sim.six_faces(rng, 2, 0.005)
    own = sim.device(rng)
    data = sim.rests(rng, two, own)
    outcome = calibrate(table(tmp_path, data, two, rng, method="six_position", field=FIELD))
    require_true(outcome, own)


@pytest.mark.slow
def test_a_step_of_the_field_is_named_and_never_consistent(rng: Rng, tmp_path: Path):
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    change = np.zeros((N, 3))
    change[N // 2 :] = [1e-6, 0.5e-6, -0.5e-6]
    outcome = calibrate(recording(tmp_path, attitude, own, rng, disturbance=change, field=FIELD))
    judged = outcome.verdict
    assert judged.grade != "consistent"
    assert judged.suspect is not None
    label = label_at(outcome, N // 2)
    assert judged.suspect.name == f"step of the field at {label}"
    assert label in judged.lines[0] + judged.lines[1]


@pytest.mark.slow
def test_a_rest_next_to_iron_is_named(rng: Rng, tmp_path: Path):
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    change = np.zeros((N, 3))
    change[7] = [1e-6, 1e-6, 1e-6]
    outcome = calibrate(recording(tmp_path, attitude, own, rng, disturbance=change, field=FIELD))
    judged = outcome.verdict
    assert judged.grade != "consistent"
    assert judged.suspect is not None
    assert judged.suspect.name == f"field at {label_at(outcome, 7)}"


@pytest.mark.slow
def test_another_field_at_each_rest_is_refused(rng: Rng, tmp_path: Path):
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    change = 0.1 * own.strength * rng.standard_normal((N, 3))
    path = recording(tmp_path, attitude, own, rng, disturbance=change, field=FIELD)
    assert "%" in refusal(path)


def test_a_simulated_session_in_the_south_is_calibrated_to_its_truth(tmp_path: Path):
    """Without a stated strength, coefficients are relative to the mean scale."""
    path = tmp_path / "run.toml"
    path.write_text(
        '[sensor]\nname = "unit"\n'
        '[sensor.accelerometer]\nunit = "m/s²"\nwhite = "200 µg/√Hz"\n'
        '[sensor.magnetometer]\nunit = "µT"\nwhite = "50 nT/√Hz"\n'
        '[sensor.truth]\n"mx.bias" = "23 µT"\n"my.scale" = "-3 %"\n"mz.delta_p" = "-2.1 °"\n'
        '[bench]\ngravity = "9.8126 m/s² ± 0.0005 m/s²"\ntilt = "0.3°"\ndip = "-60° ± 1°"\n'
        '[data]\nfile = "six.csv"\nrate = "20 Hz"\ntime = "time"\n'
        'accelerometer = ["ax", "ay", "az"]\nmagnetometer = ["mx", "my", "mz"]\n'
        '[method]\nname = "six_position"\n',
        encoding="utf-8",
    )
    assert run_program("simulate", path).status == 0
    outcome = calibrate(path)
    assert outcome.verdict.grade == "consistent"
    found, mean = outcome.calibration, 1 - 0.03 / 3
    true = {"mx.bias": 23e-6, "my.bias": 0.0, "mx.scale": 1 / mean - 1, "my.scale": 0.97 / mean - 1}
    true["mz.delta_p"] = np.radians(-2.1) / mean
    for name, value in true.items():
        assert abs(found.value(name) - value) < 4.5 * found.uncertainty(name), name
    dip = outcome.estimate.value[outcome.estimate.names.index("dip")]
    assert dip == pytest.approx(np.radians(-60), abs=np.radians(4.5))
