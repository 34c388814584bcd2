"""The stated frame in the place of what norms leave free: exact, and both estimators one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.rate_table import Bench
from tests.base_seeds import SEEDS, evidence
from tests.methods.ship_cases import EXACT, SENSOR, Case, case, observed
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.calibration import Calibration
from inercal.estimation import Gaussian
from inercal.methods.ship_multi_angle import damped, global_, norm_equations
from inercal.methods.ship_multi_angle.norm_equations import Bounds, SearchOptions
from inercal.physics.sensors import G0
from inercal.physics.sensors.affine import AffineModel, to_affine

Array = NDArray[np.float64]
FRAMED = replace(SENSOR, frame="symmetric")
# The symmetric frame leaves nine coefficients: x.delta_p, say, is −z.delta_o.
NINE = [k for k, name in enumerate(SENSOR.coefficients) if not name.endswith("delta_p")]


def truth(given: Case) -> Array:
    """Return the devices' coefficients in the symmetric frame, √(H Hᵀ), (trials, 12)."""
    h = given.draw.matrix
    size, axes = np.linalg.eigh(h @ np.swapaxes(h, -1, -2))
    root = (axes * np.sqrt(size)[:, None, :]) @ np.swapaxes(axes, -1, -2)
    return given._replace(draw=replace(given.draw, matrix=root)).truth


def one(seed: int = 1) -> Case:
    given = case(seed, 1)
    return given._replace(seen=replace(given.seen, mean=given.seen.mean[0]))


def groups_alone(given: Case):
    steps = given.steps[9:]
    return observed(given.draw.readings[0, 9:], steps, 3e-4), steps


def test_error_free_norms_give_the_sensor_in_the_stated_frame():
    given = case(1, 40, EXACT)
    found = damped(given.seen, FRAMED, given.bench, given.steps)
    away = np.abs(found.value - truth(given)).max()
    print("off", away)
    assert found.converged.all()
    assert away <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_damped_states_what_it_reaches_in_the_stated_frame(seed: int):
    trials = 400
    # XY 135 + 45 alone separates x from y, to 1°, whose square counts: 1.09, by 12 000 devices.
    for size, most in ((0.25, 1.0), (1.0, 1.09)):
        bench = Bench(seat=size * Bench.seat, speed=size * Bench.speed, noise=size * Bench.noise)
        given = case(seed, trials, bench)
        found = damped(given.seen, FRAMED, given.bench, given.steps)
        e = (found.value - truth(given))[:, NINE]
        spread = found.covariance[:, NINE][:, :, NINE]
        reached = (e * np.linalg.solve(spread, e[..., None])[..., 0]).sum(-1).mean() / 9
        print("NEES", size, reached)
        assert found.converged.all()
        margin = 4 * np.sqrt(2 / 9 / trials)
        assert 1 - margin < reached < most + margin


def test_the_frame_moves_no_residual():
    given = case(2, 40)
    plain = damped(given.seen, SENSOR, given.bench, given.steps)
    framed = damped(given.seen, FRAMED, given.bench, given.steps)
    assert framed.residual == pytest.approx(plain.residual, abs=1e-9 * G0)
    assert np.abs(framed.value - plain.value).max() > 1e-3


def test_it_is_what_the_calibration_makes_of_the_other():
    given = one()
    plain, framed = (damped(given.seen, s, given.bench, given.steps) for s in (SENSOR, FRAMED))
    turned = Calibration(SENSOR, plain.value, plain.covariance).in_frame("symmetric")
    assert turned.values == pytest.approx(framed.value, abs=1e-9)
    assert turned.std == pytest.approx(np.sqrt(np.diag(framed.covariance)), rel=0.02)


def test_the_frame_is_exact_and_has_no_uncertainty():
    given = one()
    found = damped(given.seen, FRAMED, given.bench, given.steps)
    by_name = dict(zip(SENSOR.coefficients, np.eye(12), strict=True))
    for first, second in (("x", "y"), ("y", "z"), ("z", "x")):
        both = by_name[f"{first}.delta_o"] + by_name[f"{second}.delta_p"]
        assert abs(both @ found.value) < 1e-14
        assert both @ found.covariance @ both < 1e-16
    assert (found.rank, len(found.null_directions), len(found.singular_values)) == (9, 0, 9)
    assert not any("warning" in note for note in found.notes)


def test_neither_untilted_states_nor_a_start_decide_anything():
    given = one()
    few, steps = groups_alone(given)
    alone = damped(few, FRAMED, given.bench, steps)
    both = damped(given.seen, FRAMED, given.bench, given.steps)
    assert (alone.value == both.value).all()
    assert alone.covariance == pytest.approx(both.covariance, rel=1e-9, abs=1e-18)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        SearchOptions(seed=1),
        evidence(SearchOptions(seed=2)),
        evidence(SearchOptions(Bounds(1.0, 1.0, 1.0), seed=1)),
    ],
)
def test_a_search_and_damping_agree_once_the_frame_is_stated(options: SearchOptions):
    given = one()
    found = global_(given.seen, FRAMED, given.bench, given.steps, options=options)
    other = damped(given.seen, FRAMED, given.bench, given.steps)
    apart = np.abs(found.value - other.value) / other.std
    plain = global_(given.seen, SENSOR, given.bench, given.steps, options=options)
    left = np.abs(plain.value - damped(given.seen, SENSOR, given.bench, given.steps).value)
    print(f"apart by {apart.max():.2g} u; without by {(left / other.std).max():.3g} u")
    assert apart.max() < 1e-6
    assert (left / other.std).max() > 3
    assert found.std == pytest.approx(other.std, rel=1e-6)


def test_mirrored_and_turned_solutions_have_one_symmetric_frame():
    rng = np.random.default_rng(1)
    model, _ = to_affine(SENSOR, case(1, 1).truth[0])
    there = norm_equations.to_symmetric_frame(model)
    q = np.linalg.qr(rng.standard_normal((5, 3, 3)))[0]
    q[::2] *= -1
    assert {1.0, -1.0} == set(np.sign(np.linalg.det(q)).tolist())
    many = norm_equations.to_symmetric_frame(AffineModel(q @ model.matrix, q @ model.offset))
    assert many.theta == pytest.approx(np.broadcast_to(there.theta, (5, 12)), abs=1e-13)


def test_what_restores_the_frame_is_its_slope():
    model = norm_equations.to_symmetric_frame(to_affine(SENSOR, case(1, 1).truth[0])[0])
    h = 1e-6 * np.eye(12)
    there, back = (
        norm_equations.to_symmetric_frame(AffineModel.of(model.theta + s * h)).theta
        for s in (1, -1)
    )
    assert norm_equations.frame_projection(model) == pytest.approx(
        (there - back).T / 2e-6, abs=1e-8
    )


def test_what_the_plan_does_not_see_besides_is_still_named():
    given = case(1, 1, reading="dihedral")
    few, steps = groups_alone(given)
    with pytest.raises(NotObserved) as refusal:
        damped(few, FRAMED, given.bench, steps)
    (direction,) = refusal.value.directions
    assert "Exy + Eyx" in direction
    seen = replace(given.seen, mean=given.seen.mean[0])
    found = damped(seen, FRAMED, given.bench, given.steps)
    assert found.rank == 8
    assert found.null_directions[-1].words in found.notes[-1]


def test_error_free_data_of_a_blind_plan_warn_of_the_one_direction_that_damping_decided():
    given = case(1, 1, EXACT, "dihedral")
    seen = replace(given.seen, mean=given.seen.mean[0])
    found = damped(seen, FRAMED, given.bench, given.steps)
    (direction,) = found.null_directions
    assert direction.words in found.notes[1]


def test_priors_beside_a_frame_are_refused():
    given = one()
    few, steps = groups_alone(given)
    prior = Gaussian.independent(SENSOR.coefficients, np.zeros(12), 1.0)
    with refused(key="priors"):
        damped(few, FRAMED, given.bench, steps, [prior])
