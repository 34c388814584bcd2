"""`ship_planar` against its method note: exact, with the note's errors, and as it states."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.rate_table import (
    PLANAR,
    PLANES,
    RPM,
    Bench,
    State,
    centripetal,
    draw,
    nominal_force,
)
from tests.base_seeds import SEEDS
from tests.methods.ship_cases import (
    EXACT,
    SENSOR,
    STEPS,
    calibrated,
    case,
    declared,
    nees,
    observed,
    off,
)
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.benches.rate_table.fixture import planar_plan
from inercal.estimation import Gaussian
from inercal.methods.ship_planar import METHOD, planar
from inercal.physics.sensors.affine import to_affine

NINE = planar_plan()


def test_the_nine_states_have_the_papers_rank_and_the_notes_condition():
    rows = np.insert(nominal_force(PLANAR), 3, 1.0, axis=1)
    assert np.linalg.matrix_rank(rows) == 4
    # The note states 5.2: an ideal sensor at 0.25 m has 5.08.
    assert np.linalg.cond(rows) == pytest.approx(5.08, abs=0.005)
    assert centripetal(86) == pytest.approx(2.068, abs=1e-3)


def test_error_free_states_give_the_sensor_exactly():
    given = case(1, 40, EXACT)
    assert off(planar(given.seen, SENSOR, given.bench, given.steps), given).max() < 1e-9


def test_each_axis_is_the_linear_regression_of_the_paper():
    given, found = calibrated("planar", 1, 40)
    rows = np.insert(given.draw.readings[7, :9], 3, 1.0, axis=1)
    expected = np.linalg.lstsq(rows, nominal_force(PLANAR), rcond=None)[0].T
    model, _ = to_affine(SENSOR, found.value[7])
    assert np.column_stack([model.matrix, model.offset]) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_stated_is_the_scatter(seed: int):
    trials = 400
    given, found = calibrated("planar", seed, trials)
    scatter = np.sqrt(((found.value - given.truth) ** 2).mean(0))
    stated = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2).mean(0))
    assert scatter == pytest.approx(stated, rel=4 / np.sqrt(2 * trials))
    assert nees(found, given).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))


@pytest.mark.slow
def test_what_all_states_share_is_stated_too():
    trials = 400
    bench = Bench(radius=1e-3, rate=1e-3, gravity=1e-3)
    given = case(5, trials, bench)
    found = planar(given.seen, SENSOR, given.bench, given.steps)
    assert nees(found, given).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    without = planar(given.seen, SENSOR, declared(Bench()), given.steps)
    assert nees(without, given).mean() > 1.5


def test_tilted_states_are_left_out_and_it_is_said():
    given, found = calibrated("planar", 1, 4)
    nine = observed(given.draw.readings[:, :9], NINE, 3e-4)
    alone = planar(nine, SENSOR, given.bench, NINE)
    assert np.array_equal(alone.value, found.value)
    assert "16 tilted states" in found.notes[0]
    assert found.observations == alone.observations
    assert len(alone.observations) == 27


def test_trials_together_are_those_of_each_alone():
    given, found = calibrated("planar", 1, 4)
    one = replace(given.seen, mean=given.seen.mean[2])
    alone = planar(one, SENSOR, given.bench, given.steps)
    assert alone.value == pytest.approx(found.value[2], abs=1e-12)
    assert alone.covariance == pytest.approx(found.covariance[2], rel=1e-9, abs=1e-18)


def refusal_of(keep: Callable[[State], bool], speeds: tuple[float, ...]) -> NotObserved:
    """Return how states of these mountings and speeds (r/min) are refused."""
    states = tuple((p, 0.0, None, w) for p in PLANES for w in speeds)
    steps = planar_plan([w * RPM for w in speeds])
    kept = [k for k, state in enumerate(states) if keep(state)]
    given = draw(1, 1, Bench(), tuple(states[k] for k in kept))
    steps = tuple(steps[k] for k in kept)
    with pytest.raises(NotObserved) as found:
        planar(observed(given.readings[0], steps, 3e-4), SENSOR, declared(Bench()), steps)
    assert found.value.names == found.value.directions
    return found.value


def test_nine_states_that_leave_an_axis_unexcited_name_it_and_what_to_add():
    speeds = (0.0, 20.0, 46.0, 66.0, 86.0)
    error = refusal_of(lambda state: state[0] != "YX" and state != ("ZY", 0.0, None, 20.0), speeds)
    assert error.directions == ("y",)
    assert "add mounting YX" in str(error)


def test_one_mounting_lacks_two_axes():
    error = refusal_of(lambda state: state[0] == "XY", (0.0, 46.0, 86.0))
    assert error.directions == ("y", "z")
    assert "add mounting YX, ZY" in str(error)


def test_a_table_that_only_stands_lacks_all():
    assert refusal_of(lambda _: True, (0.0,)).directions == ("x", "y", "z")


def test_a_bench_that_tells_too_little_is_refused():
    given = case(1, 1, Bench(pose=0.5))
    with pytest.raises(NotObserved) as refusal:
        planar(given.seen, SENSOR, given.bench, given.steps)
    assert refusal.value.names
    assert set(refusal.value.names) <= set(SENSOR.coefficients)


def test_priors_and_wrong_rows_are_refused():
    given = case(1, 1)
    prior = Gaussian.independent(("x.k0",), 0.0, 1.0)
    with refused(key="priors", names=("x.k0",)):
        planar(given.seen, SENSOR, given.bench, given.steps, [prior])
    with refused(key="steps", names=(STEPS[0].label, STEPS[-1].label)):
        planar(given.seen, SENSOR, given.bench, STEPS[::-1])


def test_the_method_finds_twelve_coefficients():
    assert METHOD.prepare(SENSOR).coefficients == SENSOR.coefficients
    assert METHOD.plan() == NINE
