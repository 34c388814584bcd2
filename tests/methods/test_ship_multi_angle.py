"""`ship_multi_angle` against its method note: gauge, error-free data, devices, what is stated."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.rate_table import (
    PLANAR,
    TILTED,
    Bench,
    centripetal,
    nominal_force,
    norm_rms,
    random_pose_forces,
    vector_rms,
)
from tests.base_seeds import SEEDS, chosen
from tests.methods.ship_cases import (
    ESTIMATORS,
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
from inercal.benches.rate_table.bench import sensed_motion
from inercal.benches.rate_table.fixture import (
    TiltConvention,
    is_tilted,
    multi_angle_plan,
    planar_plan,
)
from inercal.estimation import Gaussian
from inercal.methods.ship_multi_angle import METHOD, damped, joint, plan, planar
from inercal.methods.ship_multi_angle import norm_equations as by_norms
from inercal.methods.ship_multi_angle.free_norm_directions import free_directions, group_information
from inercal.methods.ship_planar import fit_level_states
from inercal.physics.sensors import G0
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel, to_affine

Array = NDArray[np.float64]
READINGS: tuple[TiltConvention, ...] = ("azimuth", "dihedral", "successive")
SQUARE = np.array([centripetal(state[3]) ** 2 + 1 for state in TILTED])
START = AffineModel.of(IDENTITY_PARAMETERS)
RANK = {"azimuth": 9, "dihedral": 8, "successive": 9}


def rank(j: Array) -> int:
    """Return the rank, which must not hang on where the line is drawn."""
    size = np.linalg.svd(j, compute_uv=False)
    found = int((size > 1e-9 * size[0]).sum())
    assert found == (size > 1e-13 * size[0]).sum() == (size > 1e-3 * size[0]).sum()
    return found


# Gauge


@pytest.mark.parametrize("reading", READINGS)
def test_rotations_are_null_directions_whatever_the_data(reading: TiltConvention):
    given = case(1, 40, reading=reading)
    for model in (START, damped_of(given.draw.readings).model):
        j = by_norms.norm_jacobian(model, given.draw.readings[:, 9:])
        turns = by_norms.rotation_directions(model)
        moved = np.linalg.norm(j @ np.swapaxes(turns, -1, -2), axis=-2)
        size = np.linalg.norm(j, axis=(-2, -1))[:, None] * np.linalg.norm(turns, axis=-1)
        print("gauge", (moved / size).max())
        assert (moved / size).max() <= 1e-14


def damped_of(readings: Array) -> by_norms.DampedSolution:
    start, _ = fit_level_states(readings[..., :9, :], nominal_force(PLANAR))
    return by_norms.damped_solution(readings[..., 9:, :], SQUARE, start)


@pytest.mark.parametrize("reading", READINGS)
def test_rank_of_error_free_data(reading: TiltConvention):
    given = case(1, 5, EXACT, reading)
    for truth, a in zip(given.truth, given.draw.readings, strict=True):
        model, _ = to_affine(SENSOR, truth)
        assert rank(by_norms.norm_jacobian(model, a[9:])) == RANK[reading]
    assert rank(by_norms.norm_jacobian(START, nominal_force(TILTED, reading))) == RANK[reading]


def test_tilts_about_the_radial_direction_see_what_the_others_do_not():
    for reading in READINGS:
        steps = multi_angle_plan(reading, "radial")
        f = sensed_motion(declared(EXACT), steps, {}).f / G0
        assert rank(by_norms.norm_jacobian(START, f)) == 9


def test_the_sources_one_speed_sees_no_less():
    for reading in READINGS:
        f = sensed_motion(declared(EXACT), multi_angle_plan(reading, one_speed=True), {}).f / G0
        assert rank(by_norms.norm_jacobian(START, f)) == RANK[reading]


def test_what_is_free_has_a_name():
    given = case(1, 1, EXACT, "dihedral")
    model, _ = to_affine(SENSOR, given.truth[0])
    left = free_directions(SENSOR, model, given.draw.readings[0, 9:], np.zeros((48, 48)))
    assert left.rank == 8
    assert [one.words.partition(":")[0] for one in left.rotations] == [
        f"rotation of the triad about {axis}" for axis in "xyz"
    ]
    (blind,) = left.unobserved
    assert blind.words.startswith("the plan's own Exy + Eyx")
    assert max(blind.weights, key=lambda name: abs(blind.weights[name])) in (
        "x.delta_o",
        "y.delta_p",
    )


def test_the_named_directions_change_no_norm():
    given = case(1, 1, EXACT, "dihedral")
    a = given.draw.readings[0, 9:]
    model, _ = to_affine(SENSOR, given.truth[0])
    left = free_directions(SENSOR, model, a, np.zeros((48, 48)))
    for one in (*left.rotations, *left.unobserved):
        move = np.array([one.weights.get(name, 0.0) for name in SENSOR.coefficients])
        there, back = (
            by_norms.norm_residuals(to_affine(SENSOR, given.truth[0] + h * move)[0], a, SQUARE)
            for h in (1e-6 * SENSOR.unit_scale, -1e-6 * SENSOR.unit_scale)
        )
        assert np.abs(there - back).max() / 2e-6 < 1e-8


def test_rows_are_the_slopes_of_the_equations():
    given = case(1, 1)
    a = given.draw.readings[0, 9:]
    model, _ = to_affine(SENSOR, given.truth[0])
    h = 1e-6 * np.eye(12)
    there, back = (
        by_norms.norm_residuals(AffineModel.of(model.theta + s * h), a, SQUARE) for s in (1, -1)
    )
    assert by_norms.norm_jacobian(model, a) == pytest.approx((there - back).T / 2e-6, abs=1e-8)


# Error-free data


@pytest.mark.parametrize("name", ["planar", "planar_norm", "joint"])
def test_error_free_states_give_the_sensor_exactly(name: str):
    given = case(1, 40, EXACT)
    found = ESTIMATORS[name](given.seen, SENSOR, given.bench, given.steps)
    assert found.converged.all()
    print(name, off(found, given).max(), "mg")
    assert off(found, given).max() <= 1e-9


def test_joint_is_exact_too_where_the_bench_is_uncertain():
    given = case(1, 40, EXACT)
    found = joint(given.seen, SENSOR, declared(Bench()), given.steps)
    assert off(found, given).max() <= 1e-9


def test_damping_from_the_identity_reaches_the_norms_and_not_the_vectors():
    given = case(1, 40, EXACT)
    done = by_norms.damped_solution(given.draw.readings[:, 9:], SQUARE, START)
    assert done.converged.all()
    norm = 1e3 * norm_rms(*done.model, given.draw.readings[:, 9:], TILTED)
    vector = 1e3 * vector_rms(*done.model, given.draw, random_pose_forces(1))
    print("norms", norm.max(), "mg, vectors", vector.min(), "to", vector.max(), "mg")
    assert norm.max() <= 1e-9
    assert vector.min() > 1


# Devices


# mg: the note's median over forty devices, and what such a median scatters, 1σ.
FORTY = {
    "planar": (8.3, 0.5),
    "planar_norm": (6.7, 0.4),
    "joint": (2.3, 0.15),
    "damped": (16.0, 2.2),
}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", FORTY)
def test_forty_devices_reach_the_note(name: str, seed: int):
    given, found = calibrated(name, seed, 40)
    e = off(found, given, seed)
    print(f"{name} {np.median(e):.2f} [{np.quantile(e, 0.95):.2f}] mg")
    assert found.converged.all()
    note, scatter = FORTY[name]
    assert np.median(e) == pytest.approx(note, abs=3 * scatter)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_four_hundred_devices_reach_the_note(seed: int):
    median: dict[str, float] = {}
    for name in ESTIMATORS:
        given, found = calibrated(name, seed, 400)
        e = off(found, given, seed)
        median[name] = float(np.median(e))
        print(f"{name} {median[name]:.2f} [{np.quantile(e, 0.95):.2f}] mg")
        assert found.converged.all()
    assert 2.1 <= median["joint"] <= 2.6
    assert 7.8 <= median["planar"] <= 9.0
    assert 12 <= median["damped"] <= 18


@pytest.mark.parametrize("seed", SEEDS)
def test_damping_betters_the_norms_it_sees_and_worsens_what_it_is_for(seed: int):
    given = case(seed, 100)
    readings = given.draw.readings
    start, _ = fit_level_states(readings[:, :9], nominal_force(PLANAR))
    done = damped_of(readings)
    before, after = (
        np.median(1e3 * norm_rms(*m, readings[:, 9:], TILTED)) for m in (start, done.model)
    )
    print(f"norms {before:.2f} to {after:.2f} mg")
    assert before == pytest.approx(5.6, rel=0.15)
    assert after == pytest.approx(1.7, rel=0.15)
    assert np.median(vector_rms(*done.model, given.draw, random_pose_forces(seed))) > np.median(
        vector_rms(*start, given.draw, random_pose_forces(seed))
    )


# What is stated


@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_what_it_reaches(seed: int):
    trials = 400
    given, found = calibrated("joint", seed, trials)
    reached = nees(found, given).mean()
    print("NEES", reached, "χ²", found.chi2.mean(), "of", found.dof)
    assert found.converged.all()
    assert reached == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    assert found.chi2.mean() == pytest.approx(found.dof, abs=4 * np.sqrt(2 * found.dof / trials))


@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_what_it_reaches_where_the_run_shares_errors(seed: int):
    trials = 400
    given = case(seed, trials, Bench(radius=1e-3, rate=1e-3, gravity=1e-3))
    found = joint(given.seen, SENSOR, given.bench, given.steps)
    assert nees(found, given).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["joint", "planar", "planar_norm"])
def test_rests_on_a_leaning_table_are_stated_as_they_err(name: str, seed: int):
    trials = 400
    bench = Bench(lean=6e-3)
    given = case(seed, trials, bench)
    told, not_told = (
        nees(ESTIMATORS[name](given.seen, SENSOR, declared(one), given.steps), given)
        for one in (bench, replace(bench, lean=0.0))
    )
    print(f"{name} NEES {told.mean():.3f}, lean left out {not_told.mean():.3f}")
    # One lean in all rests: what it adds has its size in common, and scatters more than χ².
    assert told.mean() == pytest.approx(1, abs=4 * told.std() / np.sqrt(trials))
    assert not_told.mean() > 1.15


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("lean", [9e-4, 6e-3])
def test_a_table_that_stops_at_one_azimuth_takes_little_from_what_is_stated(lean: float, seed: int):
    trials = 400
    given = case(seed, trials, Bench(lean=lean, one_azimuth=True))
    reached = nees(joint(given.seen, SENSOR, given.bench, given.steps), given)
    print(f"NEES {reached.mean():.3f}")
    # Rests whose leans are one, taken as independent: an excess of some hundredths.
    assert reached.mean() == pytest.approx(1, abs=0.05 + 4 * reached.std() / np.sqrt(trials))


LARGE = {"pose": 4e-3, "seat": 2e-3, "speed": 5e-3, "radius": 2e-3, "rate": 4e-3, "gravity": 2e-3}


@pytest.mark.slow
@pytest.mark.parametrize("what", chosen(LARGE, [*LARGE][::3]))
def test_joint_cannot_do_without_any_of_them(what: str):
    trials = 400
    bench = replace(Bench(), **{what: LARGE[what]})
    given = case(1, trials, bench)
    squares = [
        nees(joint(given.seen, SENSOR, declared(one), given.steps), given)
        for one in (bench, replace(bench, **{what: 0.0}))
    ]
    print(f"NEES {squares[0].mean():.3f}, without {what} {squares[1].mean():.3f}")
    assert squares[0].mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    assert (squares[1] - squares[0]).mean() > 0.04


@pytest.mark.parametrize("seed", SEEDS)
def test_damped_states_what_it_reaches_with_the_starts_share(seed: int):
    trials = 400
    given, found = calibrated("damped", seed, trials)
    scatter = np.sqrt(((found.value - given.truth) ** 2).mean(0))
    stated = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2).mean(0))
    # First order only: of large errors the second one shows.
    assert scatter == pytest.approx(stated, rel=0.05 + 4 / np.sqrt(2 * trials))
    assert np.isfinite(found.covariance).all()


def test_damped_pretends_nothing_along_what_norms_leave_free():
    given, found = calibrated("damped", 1, 4)
    model, out = to_affine(SENSOR, found.value[0])
    told = group_information(model, given.draw.readings[0, 9:])
    start = planar(given.seen, SENSOR, given.bench, given.steps)
    for turn in by_norms.rotation_directions(model):
        turn = turn / np.linalg.norm(turn)
        assert told.null_projector @ turn == pytest.approx(turn, abs=1e-12)
        mine, theirs = (
            float(turn @ out @ one.covariance[0] @ out.T @ turn) for one in (found, start)
        )
        assert mine == pytest.approx(theirs, rel=0.05)


def test_notes_warn_of_what_damping_decided():
    given = case(1, 1, reading="dihedral")
    one = replace(given.seen, mean=given.seen.mean[0])
    found = damped(one, SENSOR, given.bench, given.steps)
    assert found.rank == 8
    assert len(found.null_directions) == 4
    *rotations, weak = found.null_directions
    assert all(one.words in found.notes[0] for one in rotations)
    assert weak.words in found.notes[1]
    assert set(weak.weights) >= {"x.delta_o", "y.delta_p"}  # Exy + Eyx
    # The fourth direction lives on the mountings' errors alone: no better than a tenth.
    assert found.std.max() > 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_planar_norm_states_what_it_reaches(seed: int):
    trials = 400
    given, found = calibrated("planar_norm", seed, trials)
    assert nees(found, given).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))


# Starts, trials, refusals


def groups_alone(trials: int, bench: Bench):
    given = case(1, trials, bench)
    steps = multi_angle_plan()
    return given, observed(given.draw.readings[:, 9:], steps, 3e-4), steps


def test_priors_take_the_place_of_untilted_states():
    given, seen_alone, steps = groups_alone(400, Bench())
    sd = np.where([name.endswith("k0") for name in SENSOR.coefficients], 0.04 * G0, 0.012)
    sd[[name.endswith("k1") for name in SENSOR.coefficients]] = 0.02
    prior = Gaussian.independent(SENSOR.coefficients, np.zeros(12), sd)
    found = damped(seen_alone, SENSOR, given.bench, steps, [prior])
    assert "that of the stated priors" in found.notes[0]
    scatter = np.sqrt(((found.value - given.truth) ** 2).mean(0))
    stated = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2).mean(0))
    assert scatter == pytest.approx(stated, rel=0.05 + 4 / np.sqrt(800))


def test_nothing_that_tells_the_rotations_is_refused():
    given, seen_alone, steps = groups_alone(1, Bench())
    with pytest.raises(NotObserved) as refusal:
        damped(seen_alone, SENSOR, given.bench, steps)
    assert len(refusal.value.directions) == 3
    assert refusal.value.names == SENSOR.coefficients
    some = Gaussian.independent(("x.k0",), [0.0], 1.0)
    with refused(NotObserved, names=[n for n in SENSOR.coefficients if n != "x.k0"]):
        damped(seen_alone, SENSOR, given.bench, steps, [some])


def test_fewer_than_twelve_groups_are_refused():
    given = case(1, 1)
    rows = list(range(20))
    steps = tuple(given.steps[k] for k in rows)
    few = observed(given.draw.readings[0, rows], steps, 3e-4)
    with refused(NotObserved, key="steps"):
        damped(few, SENSOR, given.bench, steps)
    assert joint(few, SENSOR, given.bench, steps).rank == 12


def test_priors_beside_untilted_states_are_refused():
    given = case(1, 1)
    prior = Gaussian.independent(SENSOR.coefficients, np.zeros(12), 1.0)
    with refused(key="priors"):
        damped(given.seen, SENSOR, given.bench, given.steps, [prior])


def test_joint_names_the_axis_that_nothing_excites():
    rows = [k for k, step in enumerate(STEPS) if not is_tilted(step) and step.label[:2] != "YX"]
    given = case(1, 1)
    steps = tuple(STEPS[k] for k in rows)
    seen_alone = observed(given.draw.readings[0, rows], steps, 3e-4)
    with refused(NotObserved, names=("y",)):
        joint(seen_alone, SENSOR, given.bench, steps)
    known = Gaussian.independent(
        [n for n in SENSOR.coefficients if "delta" in n or "y" in n], 0, 1e-3
    )
    assert joint(seen_alone, SENSOR, given.bench, steps, [known]).converged


def test_priors_count_in_joint():
    given = case(1, 1)
    none = joint(given.seen, SENSOR, given.bench, given.steps)
    told = Gaussian.independent(("x.k1",), given.truth[0, [1]], 1e-6)
    some = joint(given.seen, SENSOR, given.bench, given.steps, [told])
    k = SENSOR.coefficients.index("x.k1")
    assert some.std[0, k] < 1e-5 < none.std[0, k]
    assert (none.rank, none.null_directions) == (12, ())


@pytest.mark.parametrize("name", ["planar_norm", "damped", "joint"])
def test_trials_together_are_those_of_each_alone(name: str):
    given, found = calibrated(name, 1, 12)
    for t in (0, 7):
        one = replace(given.seen, mean=given.seen.mean[t])
        alone = ESTIMATORS[name](one, SENSOR, given.bench, given.steps)
        sd = alone.std[:12]
        assert np.abs((found.value[t, :12] - alone.value[:12]) / sd).max() < 1e-6
        away = (found.covariance[t] - alone.covariance)[:12, :12] / np.outer(sd, sd)
        assert np.abs(away).max() < 1e-6


def test_the_method_is_whole():
    assert METHOD.prepare(SENSOR).coefficients == SENSOR.coefficients
    assert list(METHOD.estimators) == ["joint", "planar", "planar_norm", "damped", "global"]
    assert plan() == (*planar_plan(), *multi_angle_plan())
    assert len(plan(one_speed=True)) == 25
