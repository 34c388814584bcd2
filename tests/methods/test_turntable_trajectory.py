"""Batch least squares over a recording: against dense algebra, the generator and the filters."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest
from scipy.stats import chi2
from tests.accuracy import turntable as made_by
from tests.base_seeds import SEEDS, sampled
from tests.methods.turntable_cases import (
    BENCH,
    Array,
    Score,
    errors,
    observations,
    score,
    sensor,
    truth,
)
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.estimation import Gaussian
from inercal.methods.turntable import model
from inercal.methods.turntable.drift import Drift
from inercal.methods.turntable_kalman import METHOD as FILTERS
from inercal.methods.turntable_trajectory import _kernels, solve_trial, trajectory
from inercal.methods.turntable_trajectory.rows import RotationRows, StaticRows
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track

PATH = [("home", (0, 0, 0), 20.0), *made_by.turns()]
BRIEF = [("home", (0, 0, 0), 20.0), *made_by.turns(360.0, 30.0)]
RESTS = ("home", "rest")
QUIET = made_by.Grade(0, 0, 0, 0)
PLAIN = made_by.Table(
    harmonics=(0, 0), white=0, square=0, lean=0, azimuth=0, latency=0, jerk=radians(300)
)


def gyros(draw: made_by.Draw, made: Sensor) -> tuple[Observations, Sensor]:
    """Return the gyros' part of what was drawn."""
    seen = observations(draw, made, RESTS)
    assert seen.track is not None
    part = replace(
        seen,
        mean=seen.mean[..., 3:],
        covariance=seen.covariance[..., 3:, 3:],
        channels=seen.channels[3:],
        track=replace(seen.track, reading=seen.track.reading[..., 3:]),
    )
    return part, made.select_axes("w")


def track(seen: Observations, trial: int = 0) -> Track:
    assert seen.track is not None
    return seen.track.trial(trial)


# Whitening


def _dense(whitened: Array, rows: Array, covariance: Array) -> None:
    """Hold what is whitened to the sums that the whole covariance makes."""
    exact = rows.T @ np.linalg.solve(covariance, rows)
    made = whitened.T @ whitened
    assert np.abs(made - exact).max() < 1e-9 * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize(("mean_over_run", "readback"), [(False, 0.3), (True, 0.3), (True, -0.01)])
def test_whitened_increments_make_the_sums_of_the_whole_covariance(
    mean_over_run: bool, readback: float
):
    # What neighbouring increments share may exceed the readback's variance.
    rng = np.random.default_rng(3)
    e, m = 9, 4
    since, lost = rng.uniform(0.5, 1.5, e), np.arange(e) == 5
    drifting, earth = rng.normal(size=(e, 3, 3)), rng.normal(0, 0.1, 3)
    half = rng.normal(size=(e, 3, 3))
    driven, walk = half @ half.swapaxes(1, 2), np.array([0.1, 0.0, 0.3])
    times = np.array([2.0, 7.0, inf])
    variance = np.array([(0.5, 0.2, 1.0), (0.1, 0.4, 0.0), (0.0, 0.0, 0.0)])
    drift, components = Drift(times, variance, walk, mean_over_run=mean_over_run), len(times)
    rows = rng.normal(size=(e, 3, m))
    # The same by matrices: all noises ν, z = S (increments), z = N ν.
    turn = np.array([[0, earth[2], -earth[1]], [-earth[2], 0, earth[0]], [earth[1], -earth[0], 0]])
    size = 3 + 3 * (e + 1) * (1 + components) + 3 * e
    noise, phi, gamma = np.zeros(size), np.zeros((3, size)), np.zeros((components, 3, size))
    phi[:, :3], noise[:3] = np.eye(3), readback
    at = 3
    for c in range(components):
        gamma[c, :, at : at + 3], noise[at : at + 3] = np.eye(3), variance[c]
        at += 3
    total, zs, by = np.zeros((3, m)), list[Array](), list[Array]()
    for k in range(e):
        kept, carry = np.exp(-since[k] / times), np.eye(3) + turn * since[k]
        phi = carry @ phi + drifting[k] @ gamma.sum(axis=0)
        gamma = kept[:, None, None] * gamma
        root = np.linalg.cholesky(driven[k])
        phi[:, at : at + 3], noise[at : at + 3] = root, 1.0
        at += 3
        for c in range(components):
            gamma[c, :, at : at + 3] = np.eye(3)
            grown = walk * since[k] if np.isinf(times[c]) else variance[c] * (1 - kept[c] ** 2)
            noise[at : at + 3] = grown
            at += 3
        total = carry @ total + rows[k]
        if lost[k]:
            total, phi = np.zeros((3, m)), np.zeros((3, size))
            phi[:, at : at + 3], noise[at : at + 3] = np.eye(3), readback
            at += 3
            continue
        zs.append(total)
        by.append(phi)
    all_by = np.concatenate(by)
    covariance = all_by * noise @ all_by.T + readback * np.eye(len(all_by))
    made = rows.copy()
    variances = np.tile(readback * np.eye(3), (e + 1, 1, 1))
    _kernels.whiten(
        since, made, drifting, driven, variances, drift, drift.covariance(), earth, lost
    )
    assert not made[5].any()
    _dense(made.reshape(3 * e, m), np.concatenate(zs), covariance)


@pytest.mark.slow
def test_whitened_means_make_the_sums_of_the_whole_covariance():
    rng = np.random.default_rng(4)
    time, rows, white = (
        np.cumsum(rng.uniform(1, 50, 8)),
        rng.normal(size=(8, 3, 2)),
        np.ones((8, 3)),
    )
    made = rows.copy()
    drift = Drift(np.array([200.0, 10.0]), np.array([[4.0] * 3, [2.0] * 3]), np.zeros(3), True)
    _kernels.whiten_independent_axes(time, made, white, drift, drift.covariance(), 0.0)
    apart = np.abs(time[:, None] - time)
    for k in range(3):
        covariance = 4 * np.exp(-apart / 200) + 2 * np.exp(-apart / 10) + np.eye(8)
        _dense(made[:, k], rows[:, k], covariance)


# Jacobians


@pytest.mark.parametrize("kind", ["w", "f"])
def test_jacobians_are_those_of_the_residuals(kind: str):
    made = sensor(made_by.T, "g" if kind == "w" else "k2")
    bench = replace(BENCH, clock=1e-5, gravity=replace(BENCH.gravity, sd=1e-4))
    path = (
        made_by.complete_path(5.0)
        if kind == "f"
        else [("home", (0, 40, 30), 5.0), ("x", 1, 90.0, 30.0)]
    )
    draw = made_by.draw(2, 1, path, hz=50.0)
    whole = track(observations(draw, made))
    of = RotationRows if kind == "w" else StaticRows
    part = of.from_track(model.triad_model(made, kind, 60.0), bench, whole)
    names = part.triad.sensor.coefficients
    theta = np.zeros(len(names))
    drawn = [k for k, name in enumerate(names) if ".g_" not in name and ".k2" not in name]
    theta[drawn] = truth(draw, [names[k] for k in drawn])[0]
    q = {one.name: one.value for one in part.table} | {"latency": 2e-3}

    def rows(theta: np.ndarray, q: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        whole, _, _ = part.whiten(theta, q)
        return whole[:, 0], whole[:, 1:]

    residual, jacobian = rows(theta, q)
    for k, name in enumerate(names):
        step = 1e-4 * part.triad.sensor.unit_scale[k]
        up, down = (rows(theta + s * step * np.eye(len(names))[k], q)[0] for s in (1, -1))
        off = np.abs((up - down) / (2 * step) + jacobian[:, k]).max()
        assert off < 2e-3 * np.abs(jacobian[:, k]).max(), name
    for k, one in enumerate(part.table):
        column = jacobian[:, len(names) + k]
        up, down = (rows(theta, q | {one.name: q[one.name] + s * one.sd})[0] for s in (0.1, -0.1))
        off = np.abs((up - down) / (0.2 * one.sd) + column)
        # The table's rate is that over two samples: off where it bends.
        assert np.median(off) <= 1e-2 * np.abs(column).max(), one.name
    assert len(residual) == len(jacobian)


# Estimates


@pytest.mark.slow
def test_without_noise_and_with_a_perfect_table_the_truth_comes_out():
    made = sensor()
    draw = made_by.draw(3, 1, made_by.complete_path(5.0), QUIET, PLAIN, hz=200.0)
    found = trajectory(observations(draw, made), made, BENCH, ())
    # What is left is accelerations that bend between samples.
    assert (np.abs(errors(found, draw, made)[0]) < 0.05 * found.std[:, :24]).all()


@pytest.mark.slow
def test_the_delay_of_the_readback_comes_out_and_trials_are_each_by_itself():
    made = sensor()
    draw = made_by.draw(4, 2, PATH, hz=50.0)
    seen, part = gyros(draw, made)
    both = trajectory(seen, part, BENCH, ())
    k = both.names.index("latency")
    assert np.abs(both.value[:, k] - 2e-3).max() < 4 * both.std[0, k]
    assert both.std[0, k] < 1e-4
    one = solve_trial(part, BENCH, track(seen, 1))
    assert np.array_equal(one.value, both.value[1])
    assert both.chi2.shape == (2,)


@pytest.mark.slow
def test_the_filters_make_the_same_of_the_same_recording():
    made = sensor()
    draw = made_by.draw(5, 2, PATH, hz=50.0)
    seen, part = gyros(draw, made)
    # A readback that is surely late, and so taken in at its sample by both.
    late = replace(BENCH, latency=Measured(2e-3, 0.5e-3))
    batch = trajectory(seen, part, late, ())
    for name in ("drift", "full"):
        filtered = FILTERS.estimator(name)(seen, part, late, ())
        off = (filtered.value - batch.value[:, : filtered.value.shape[1]])[:, :12]
        assert (np.abs(off) < 0.35 * batch.std[:, :12]).all(), name


@pytest.mark.slow
def test_of_flicker_both_find_the_mean_over_the_run():
    grade = replace(made_by.T, gyro_drift=10 * made_by.T.gyro_drift, flicker=True)
    made = sensor(grade)
    path = [("home", (0, 0, 0), 25.0), *made_by.positions(10.0), *made_by.turns(360.0, 30.0)]
    draw = made_by.draw(8, 2, path, grade, hz=50.0)
    seen = observations(draw, made)
    batch = trajectory(seen, made, BENCH, ())
    filtered = FILTERS.estimator("full")(seen, made, BENCH, ())
    at = [k for k, name in enumerate(made.coefficients) if name.endswith(("bias", "k0"))]
    apart = (batch.value[:, at] - filtered.value[:, at]) / batch.std[:, at]
    assert np.abs(apart).max() < 0.5
    assert np.abs(filtered.std[:, at] / batch.std[:, at] - 1).max() < 0.1
    assert (np.abs(errors(batch, draw, made)[0])[:, at] / batch.std[:, at]).max() < 4


@pytest.mark.slow
def test_samples_that_were_lost_cost_only_what_they_would_have_said():
    made = sensor()
    draw = made_by.draw(6, 1, PATH, hz=50.0)
    seen, part = gyros(draw, made)
    kept = np.abs(draw.time - 100.0) > 0.6
    whole = track(seen)
    short = Track(whole.time[kept], whole.reading[kept], whole.angles[kept], whole.hold[kept])
    one, other = (solve_trial(part, BENCH, each) for each in (whole, short))
    assert (np.abs(one.value - other.value)[:12] < 0.6 * one.std[:12]).all()
    assert (other.std[:12] > 0.999 * one.std[:12]).all()
    assert other.p_value > 0.05


@pytest.mark.slow
def test_attitudes_at_the_ends_of_whole_turns_alone_leave_six_directions_open():
    made = sensor()
    draw = made_by.draw(7, 1, BRIEF, hz=50.0)
    seen, part = gyros(draw, made)
    ends = [np.flatnonzero(draw.labels == name)[[0, -1]] for name in ("x+", "y+", "z+", "rest")]
    epochs = np.unique(np.concatenate([[0], *ends])).astype(np.int64)
    with pytest.raises(NotObserved) as refusal:
        solve_trial(part, BENCH, track(seen), epochs=epochs)
    assert len(refusal.value.directions) == 6
    assert all("delta" in words for words in refusal.value.directions)
    assert all("delta" in name for name in refusal.value.names)


@pytest.mark.slow
def test_an_axis_that_was_never_turned_is_refused_unless_a_prior_says_what_it_is():
    made = sensor()
    path = [step for step in BRIEF if step[0] not in ("x+", "y+")]
    draw = made_by.draw(8, 1, path, hz=25.0)
    seen, part = gyros(draw, made)
    with pytest.raises(NotObserved) as refusal:
        trajectory(seen, part, BENCH, ())
    assert "gx.scale" in refusal.value.names
    prior = Gaussian.independent(part.coefficients, truth(draw, part.coefficients)[0], 1e-3)
    found = trajectory(seen, part, BENCH, (), [prior])
    assert (found.std[0, :12] < 1.01e-3).all()


def test_means_alone_or_a_track_without_rest_are_refused():
    made = sensor()
    draw = made_by.draw(9, 1, BRIEF, hz=25.0)
    seen = observations(draw, made, RESTS)
    with refused(key="track"):
        trajectory(replace(seen, track=None), made, BENCH, ())
    with refused(key="hold"):
        trajectory(observations(draw, made, ()), made, BENCH, ())


# Statistics


def _on_papers_path(estimator: str, seeds: int, base: int) -> Score:
    off, stated, names = list[Array](), list[Array](), tuple[str, ...]()
    for k in range(0, seeds, 2):
        draw = made_by.draw(1000 * base + k, 2, PATH, hz=50.0)
        seen, part = gyros(draw, sensor())
        way = FILTERS.estimator(estimator) if estimator else trajectory
        one = errors(way(seen, part, BENCH, ()), draw, part)
        off.append(one[0])
        stated.append(one[1])
        names = part.coefficients
    return score(np.concatenate(off), np.concatenate(stated), names, "g")


@pytest.mark.slow
@pytest.mark.parametrize("base", SEEDS)
def test_nineteen_states_on_the_papers_path_are_within_5_percent_of_the_batch(base: int):
    batch, filtered = (_on_papers_path(name, 24, base) for name in ("", "drift"))
    assert 0.85 < batch.nees < 1.2
    ratio = np.array(filtered[:3]) / np.array(batch[:3])
    assert (np.abs(ratio - 1) < 0.05).all(), ratio
    # What the note has on the source's path; 20 s of rest more make it no worse.
    assert (np.array(batch[:3]) < 1.2 * np.array([0.0139, 26.8, 6.35])).all()


@pytest.mark.slow
@pytest.mark.parametrize(("base", "devices"), sampled(10, 60))
def test_on_the_whole_recording_errors_are_those_of_the_note_and_as_stated(base: int, devices: int):
    made, off, stated = sensor(), list[Array](), list[Array]()
    # Of few devices NEES scatters widely: its band is that of χ², two-sided 99.9 %.
    dof = 12 * devices
    low, high = (0.85, 1.2) if devices == 60 else chi2.ppf([5e-4, 1 - 5e-4], dof) / dof
    for k in range(0, devices, 2):
        draw = made_by.draw(1000 * base + k, 2, made_by.complete_path(), hz=50.0)
        one = errors(trajectory(observations(draw, made), made, BENCH, ()), draw, made)
        off.append(one[0])
        stated.append(one[1])
    for kind, most in (("g", (0.006, 19.0, 4.2)), ("a", (11.0, 8.0, 2.6))):
        found = score(np.concatenate(off), np.concatenate(stated), made.coefficients, kind)
        assert low < found.nees < high
        assert (np.array(found[:3]) < most).all(), found
