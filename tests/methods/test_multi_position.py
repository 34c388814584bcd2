"""`multi_position`: its rows and kernels against dense ones, its refusals, what it also finds.

Sessions are made by `tests.accuracy.handheld`, which imports nothing of inercal.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from tests.accuracy.ferraris import DEGREE, Imu, mems
from tests.accuracy.handheld import (
    Handheld,
    Session,
    about_one_axis,
    directions,
    planar,
    record,
    triangular,
)
from tests.base_seeds import evidence

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration.delays import stated_delays
from inercal.estimation import Gaussian
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import Fit
from inercal.methods.multi_position import (
    METHOD,
    g_sensitivity_findings,
    gyro_delay,
    joint,
    sequential,
)
from inercal.methods.multi_position._kernels import integrate_transitions
from inercal.methods.multi_position.rest_observations import Rests, Scatter
from inercal.methods.multi_position.rotations import (
    inverse_model,
    rotations_only,
    transition_rotations,
)
from inercal.methods.multi_position.row_whitening import whitener
from inercal.physics.plan import Hold
from inercal.physics.sensors import Sensor, imu
from inercal.pipeline.stated_values import gravity_notes
from inercal.recordings import Mark, Observations, Recording, Transitions
from inercal.recordings.segments import transitions_between_rests
from inercal.recordings.segments.section_means import average_sections

Array = NDArray[np.float64]
SESSION = Session(latitude=47 * DEGREE, gravity_sd=2e-4)
BENCH = Hand(Measured(SESSION.gravity, SESSION.gravity_sd), SESSION.latitude)
INSIDE = 10  # samples of a rest that are left out at either end


def whole(*also: str) -> Sensor:
    return METHOD.prepare(imu(), also=also)


def observed(made: Handheld, sensor: Sensor, inside: int = INSIDE) -> Observations:
    """Return the first trial's rests and, where there are gyros, the transitions between them."""
    marks = [Mark(f"r{k:02d}", a + inside, b - inside) for k, (a, b) in enumerate(made.rests)]
    steps = METHOD.plan(positions=max(len(marks), 9))
    steps = [replace(step, label=mark.label) for step, mark in zip(steps, marks, strict=False)]
    m = len(sensor.axes)
    output = np.ascontiguousarray(made.data[0, :, :m])
    recording = Recording(made.time, output, sensor.channels, ("SI",) * m)
    seen = average_sections(recording, sensor, marks, steps, by_hand=True)
    return (
        replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
        if m == 6
        else seen
    )


def truth(device: Imu, sensor: Sensor, **more: float) -> Array:
    named = triangular(device).coefficients() | more
    return np.array([named[name] for name in sensor.coefficients])


@cache
def session(positions: int = 12, seed: int = 80) -> tuple[Rests, Array]:
    """Return rests whose transitions lack the fifth, and x near the truth but at random."""
    rng = np.random.default_rng(seed)
    device, sensor = mems(rng), whole("g")
    seen = observed(record(device, replace(SESSION, positions=positions), rng), sensor)
    way = seen.transitions
    assert way is not None
    kept = np.delete(np.arange(positions - 1), 4)
    way = replace(
        way,
        rest=way.rest[kept],
        start=way.start[kept],
        left=way.left[kept],
        reached=way.reached[kept],
        stop=way.stop[kept],
    )
    rests = Rests(replace(seen, transitions=way), sensor, BENCH)
    x = rests.start()
    p = len(sensor.coefficients)
    x[:p] = truth(device, sensor) + 1e-3 * sensor.unit_scale * rng.standard_normal(p)
    x[p:] += [1e-3, 3e-5, -2e-5, 1e-5, 2e-4, 1e-5, -2e-5, 3e-5]
    return rests, x


def moved_reading(rests: Rests, rest: int, axis: int, by: float) -> Rests:
    mean = rests.observations.mean.copy()
    mean[rest, axis] += by
    moved = replace(rests, observations=replace(rests.observations, mean=mean))
    moved.__dict__["across"] = rests.cross_directions  # the two directions in which ρ is told stay
    return moved


SCATTERS = [
    Scatter(),
    Scatter(ScatterModel(excess=2e-3), ScatterModel(excess=3e-4), ScatterModel(excess=1e-3)),
    Scatter(ScatterModel(share=0.3), ScatterModel(share=0.5), ScatterModel(share=0.2)),
]


def dense_noise(rests: Rests, x: Array) -> Callable[[Scatter], Array]:
    """Return the covariance of all rows, by a scatter, from that of every sample of the rate."""
    rows, way = rests.rows(x), rests.transitions
    turns = rows.rotations
    assert turns is not None
    assert way is not None
    r, m, k = len(rows.norm.residual), 3, len(turns.residual)
    chained = r + 2 * k
    # How an error of each accelerometer reading moves norms and rotations, by differences.
    J = np.zeros((chained, r * m))
    for column in range(r * m):
        ends = [
            moved_reading(rests, column // m, column % m, by).rows(x, rows).residual
            for by in (1e-4, -1e-4)
        ]
        J[:, column] = ((ends[0] - ends[1]) / 2e-4)[:chained]
    size = chained + 3 * r
    # How an error of each sample of the rate moves rotations and mean rates.
    samples = np.zeros((size, way.time.size, 3))
    model = inverse_model(rests.sensor, x[: len(rests.sensor.coefficients)])
    for i in range(k):
        frames, dt, _ = dense_steps(way, i, model.matrix, model.offset)
        lever = -turns.to_end_turn[i] @ frames[1:] * dt[:, None, None]  # of the steps' rates
        of = slice(r + 2 * i, r + 2 * i + 2)
        samples[of, way.start[i] : way.stop[i]] += 0.5 * np.moveaxis(lever, 0, 1)
        samples[of, way.start[i] + 1 : way.stop[i] + 1] += 0.5 * np.moveaxis(lever, 0, 1)
    for i, n in enumerate(rests.observations.samples):
        begin = int(np.searchsorted(way.time, rests.observations.time[i])) - n // 2
        for axis in range(3):
            samples[chained + 3 * i + axis, begin : begin + n, axis] = 1 / n
    white = np.einsum("ina,ab,jnb->ij", samples, rests.rate_noise, samples, optimize=True)

    # An offset of the gyros through a rest, half of it on the ways there and on; their own offset.
    def turned_by(j: int, before: float, between: float, after: float) -> Array:
        frames, dt, _ = dense_steps(way, j, model.matrix, model.offset)
        of_step = np.full(len(dt), between)
        of_step[: way.left[j] - way.start[j]] = before
        of_step[way.reached[j] - way.start[j] :] = after
        return -turns.to_end_turn[j] @ np.einsum("n,nab,n->ab", dt, frames[1:], of_step)

    offsets = np.zeros((size, size))
    for i in range(r):
        steady = np.zeros((size, 3))
        steady[chained + 3 * i : chained + 3 * i + 3] = np.eye(3)
        for j in np.flatnonzero((way.rest == i) | (way.rest + 1 == i)).tolist():
            leaves = float(way.rest[j] == i)
            steady[r + 2 * j : r + 2 * j + 2] = turned_by(j, leaves, 0.5, 1 - leaves)
        offsets += steady @ steady.T
    for i in range(k):
        of, alone = slice(r + 2 * i, r + 2 * i + 2), turned_by(i, 0.0, 1.0, 0.0)
        offsets[of, of] += 0.5 * alone @ alone.T

    def covariance(scatter: Scatter) -> Array:
        force, rate, turn = scatter
        readings = np.zeros((r * m, r * m))
        C = np.zeros((size, size))
        for i, noise in enumerate(rests.noise):
            of = slice(m * i, m * i + m)
            readings[of, of] = force.share * noise[:3, :3] + force.excess**2 * np.eye(3)
        C[:chained, :chained] = J @ readings @ J.T
        share = np.full(white.shape, turn.share)
        share[chained:, chained:] = rate.share
        share[:chained, chained:] = share[chained:, :chained] = min(rate.share, turn.share)
        C += share * white + rate.excess**2 * offsets
        rotations = np.arange(r, chained)
        C[rotations, rotations] += turn.excess**2
        return C

    return covariance


@pytest.mark.slow
def test_the_band_whitens_the_dense_covariance_of_all_rows():
    rests, x = session(positions=9)
    rows = rests.rows(x)
    covariance = dense_noise(rests, x)
    r = len(rows.norm.residual)
    for scatter in SCATTERS:
        for norms in (True, False):
            C = covariance(scatter)
            W = whitener(rests, rows, scatter, norms=norms)(np.eye(len(C)))
            if not norms:
                C, W = C[r:, r:], W[:, r:]
            # Sums along a ramp of some 280 samples are taken for integrals: 1/280.
            np.testing.assert_allclose(W @ C @ W.T, np.eye(len(C)), rtol=0, atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("hold_seconds", [1.0, evidence(8.0)])
def test_ramps_within_a_rest_share_their_samples(hold_seconds: float):
    """Rests shorter and longer than what is weighed of them."""
    rng = np.random.default_rng(90)
    device, sensor = mems(rng), whole()
    made = record(device, replace(SESSION, positions=10, hold_seconds=hold_seconds), rng)
    rests = Rests(observed(made, sensor), sensor, BENCH)
    x = rests.start()
    C = dense_noise(rests, x)(Scatter())
    W = whitener(rests, rests.rows(x), Scatter())(np.eye(len(C)))
    np.testing.assert_allclose(W @ C @ W.T, np.eye(len(C)), rtol=0, atol=0.03)


def test_rotations_of_neighbouring_transitions_are_correlated():
    """Else the oracle above would say little."""
    rests, x = session()
    rows = rests.rows(x)
    whiten = whitener(rests, rows, Scatter(ScatterModel(excess=2e-3)), norms=False)
    r, k = len(rows.norm.residual), len(rests.observations.labels) - 2
    W = whiten(np.eye(len(rows.residual)))[:, r:]
    C = np.linalg.inv(W.T @ W)[: 2 * k, : 2 * k]
    sd = np.sqrt(np.diag(C))
    correlation = np.abs(C / np.outer(sd, sd))
    assert correlation[0:2, 2:4].max() > 0.3
    # The fifth transition is missing: what lies before and after it has no reading in common.
    assert correlation[6:8, 8:10].max() < 1e-12


def test_derivatives_of_all_rows_are_those_by_differences():
    rests, x = session()
    x[-3:] = 0.004, -0.003, 0.002  # rad/s, rounding errors of coarse gyros
    rows = rests.rows(x)
    size = np.concatenate([rests.sensor.unit_scale, [10.0], np.ones(7)])
    columns: list[Array] = []
    for step in np.diag(1e-5 * size):
        ahead, behind = (rests.rows(x + s * step, rows).residual for s in (1, -1))
        columns.append((behind - ahead) / 2e-5)  # the prediction runs ahead: minus the residual's
    expected, found = np.stack(columns, axis=1), rows.jacobian * size
    off = np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)
    earth = slice(-7, -4)
    exact = np.delete(off, np.arange(len(off))[earth])
    assert exact.max() < 1e-4, dict(zip(rests.sensor.coefficients, off.tolist(), strict=False))
    assert off[earth].max() < 1e-3  # the earth's turn is taken as small


def turned(v: Array) -> Array:
    """Return the matrix exponential of [v×], by Rodrigues."""
    angle = float(np.linalg.norm(v))
    cross = np.cross(np.eye(3), v / angle).T if angle else np.zeros((3, 3))
    # Rows of np.cross(1, v) are e × v, so that its transpose has columns −(v × e).
    return np.eye(3) - np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def dense_steps(way: Transitions, i: int, back: Array, zero: Array) -> tuple[Array, Array, Array]:
    """Return the frames of all samples seen from the last, weighed steps of time, (f, ω, 1)."""
    span = np.arange(way.start[i], way.stop[i] + 1)
    felt = np.column_stack([way.output[span] @ back.T + zero, np.ones(len(span))])
    # The weight of a step: up from the first of the rest before, down to the last of that after.
    rise = (span - way.start[i]) / (way.left[i] - way.start[i] + 1)
    fall = (way.stop[i] + 1 - span) / (way.stop[i] - way.reached[i] + 1)
    dt = np.diff(way.time[span]) * np.minimum(np.minimum(rise, fall), 1.0)[1:]
    w = felt[:, 3:6]
    middle = 0.5 * (w[1:] + w[:-1])
    step = middle * dt[:, None] + dt[:, None] ** 2 / 12 * np.cross(w[:-1], w[1:])
    after = [np.eye(3)]  # what turns the frame after a step to the last, from the end on
    for phi in step[::-1]:
        after.append(after[-1] @ turned(-phi))
    after.reverse()
    return np.array(after), dt, felt


def dense_carry(way: Transitions, i: int, back: Array, zero: Array, white: Array):
    """Return rotation, sensitivity and noise of a transition by products of all its steps."""
    C, dt, felt = dense_steps(way, i, back, zero)
    ends, middle = 0.5 * (C[1:] + C[:-1]), 0.5 * (felt[1:] + felt[:-1])
    sensitivity = np.einsum("nab,nq,n->abq", ends, middle, dt)
    way_only = slice(way.left[i] - way.start[i], way.reached[i] - way.start[i])
    whole = C[1:][way_only]
    noise = np.einsum("nab,bc,ndc,n->ad", whole, white, whole, dt[way_only] ** 2)
    return C[0], sensitivity, noise


@pytest.mark.slow
def test_what_is_carried_along_is_the_product_of_all_steps():
    rests, x = session()
    way = rests.transitions
    assert way is not None
    model = inverse_model(rests.sensor, x[: len(rests.sensor.coefficients)])
    white = 1e-6 * np.array([[2.0, 0.3, -0.2], [0.3, 1.0, 0.1], [-0.2, 0.1, 3.0]])
    found = integrate_transitions(
        way.time,
        way.output,
        (way.start, way.left, way.reached, way.stop),
        model.matrix,
        model.offset,
        white,
        np.zeros(0),
    )
    for i in range(len(way.rest)):
        expected = dense_carry(way, i, model.matrix, model.offset, white)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one[i], other, rtol=0, atol=1e-10 * np.abs(other).max())


def test_samples_that_no_transition_uses_change_nothing():
    rests, x = session()
    way, c = rests.transitions, x[: len(rests.sensor.coefficients)]
    assert way is not None
    n, k, far = len(way.time), len(way.rest), 100.0
    more = np.concatenate([way.output, np.full((3 * n, way.output.shape[1]), np.nan)])
    later = np.concatenate([way.time, way.time[-1] + far + np.arange(3 * n)])
    long = replace(way, time=later, output=more)
    short = long.compact()
    assert len(short.time) <= n
    for one in (long, short):
        found = transition_rotations(one, rests.sensor, c, np.eye(3))
        assert found.rotation.shape == (k, 3, 3)
        np.testing.assert_array_equal(found.rotation, rotations_only(one, rests.sensor, c, 0, None))
    np.testing.assert_array_equal(short.duration, way.duration)
    expected = transition_rotations(way, rests.sensor, c, np.eye(3))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_of_known_rate_is_carried_as_that_turn(axis: int):
    rate, dt, n = 1.5, 0.01, 101
    output = np.zeros((n, 6))
    output[:, 3 + axis] = rate
    one, last = np.array([0]), np.array([n - 1])
    rotation, _, _ = integrate_transitions(
        dt * np.arange(n, dtype=np.float64),
        output,
        (one, one, last, last),
        np.eye(6),
        np.zeros(6),
        np.eye(3),
        np.zeros(0),
    )
    # What is fixed in space turns backwards in the body. The last sample's weight is one.
    angle = rate * dt * (n - 1)
    p, o = (axis + 1) % 3, (axis + 2) % 3
    assert rotation[0, p, p] == pytest.approx(np.cos(angle), abs=1e-12)
    assert rotation[0, p, o] == pytest.approx(np.sin(angle), abs=1e-12)
    assert rotation[0, axis, axis] == pytest.approx(1, abs=1e-12)


def refused(ups: ArrayLike, estimator: str, **changes: float) -> NotObserved:
    rng = np.random.default_rng(81)
    sensor = whole()
    seen = observed(record(mems(rng), replace(SESSION, **changes), rng, ups=ups), sensor)
    with pytest.raises(NotObserved) as caught:
        METHOD.estimator(estimator)(seen, sensor, BENCH, ())
    named = {word for words in caught.value.directions for word in words.split()}
    assert caught.value.names
    assert set(caught.value.names) == named & set(sensor.coefficients)
    return caught.value


both = pytest.mark.parametrize("estimator", ["joint", "sequential"])


@both
def test_eight_poses_do_not_determine_nine_coefficients(estimator: str):
    error = refused(directions(8, np.random.default_rng(82)), estimator)
    assert all(name[0] == "a" for name in error.names)


@both
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 1.0, 1.0)])
def test_poses_in_one_plane_are_refused_with_the_directions_that_are_missing(
    estimator: str, normal: tuple[float, float, float]
):
    ups = planar(20, normal, 1.0, np.random.default_rng(83))
    error = refused(ups, estimator)
    numbers = re.search(r"\(([-+.\d]+), ([-+.\d]+), ([-+.\d]+)\)", str(error))
    assert numbers is not None
    across = np.array([float(part) for part in numbers.groups()])
    along = abs(across @ np.array(normal)) / np.linalg.norm(normal)
    assert along > np.cos(3 * DEGREE)
    if normal == (0.0, 0.0, 1.0):
        assert "az.k1" in error.names


@both
@pytest.mark.parametrize("axis", range(3))
def test_a_gyro_turned_about_one_axis_only_leaves_the_others_open(estimator: str, axis: int):
    ups = about_one_axis(20, np.eye(3)[axis], np.random.default_rng(84))
    named = refused(ups, estimator, yaw_deg=0.0).names
    scales = {name for name in named if name[0] == "g" and name.endswith(".scale")}
    assert scales == {f"g{'xyz'[k]}.scale" for k in {0, 1, 2} - {axis}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [85, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (86, 87))]
)
@pytest.mark.parametrize("late", [0.0, 0.004])
@pytest.mark.parametrize(("arm", "known"), [(0.2, 0.02), (0.01, 0.0008)])
def test_the_gyros_delay_is_found_and_none_where_there_is_none(
    seed: int, late: float, arm: float, known: float
):
    """The hand's own acceleration, in proportion to its reach, is what limits it."""
    rng = np.random.default_rng(seed)
    sensor = whole("g")
    seen = observed(record(mems(rng), replace(SESSION, delay=late, arm=arm), rng), sensor)
    found = gyro_delay(seen, sensor, joint(seen, sensor, BENCH, ()), SESSION.gravity)
    assert found.value == pytest.approx(late, abs=4 * found.sd)
    assert found.sd < known


@pytest.mark.parametrize("late", [-1.4, evidence(-0.794), 0.25, 0.004])
def test_any_delay_shorter_than_the_rests_is_found_and_a_large_one_is_a_warning(late: float):
    rng, sensor = np.random.default_rng(95), whole("g")
    hand = replace(SESSION, positions=14, delay=late, arm=0.05, hold_seconds=5.0)
    made = record(mems(rng), hand, rng)
    seen = observed(made, sensor, inside=INSIDE + round(100 * abs(late)))
    estimate = joint(seen, sensor, BENCH, ())
    fit = Fit[Hand, Hold]("joint", sensor, BENCH, seen, (), (), estimate)
    assert [one.what for one in METHOD.remarks(fit).findings] == ["delay"] * (late != 0.004)
    stated = METHOD.remarks(replace(fit, time_offset=True))
    assert not stated.findings
    (found,) = stated_delays(stated.conditions).values()
    assert found.value == pytest.approx(late, abs=4 * found.sd)
    assert found.sd < 0.005


@pytest.mark.parametrize("also", [(), ("g",)])
@pytest.mark.parametrize(
    ("sign", "g", "found"), [(1, 0, ""), (-1, 0, "opposite sign"), (1, 0.01, "g")]
)
def test_reversed_accelerometers_are_told_from_gyros_that_are_sensitive_to_g(
    also: tuple[str, ...], sign: int, g: float, found: str
):
    rng = np.random.default_rng(94)
    device = mems(rng, white_g=3e-4 * DEGREE, G=g * DEGREE / 9.81 * rng.standard_normal((3, 3)))
    made = record(device, SESSION, rng)
    made.data[..., :3] *= sign
    sensor = whole(*also)
    seen = observed(made, sensor)
    findings = g_sensitivity_findings(Rests(seen, sensor, BENCH), joint(seen, sensor, BENCH, ()))
    assert [one.what for one in findings] == ([found] if found and found != "".join(also) else [])


@pytest.mark.slow
def test_bent_accelerometers_are_found_on_wish():
    rng = np.random.default_rng(88)
    device, sensor = mems(rng), whole("g", "k2", "k3")
    k2, k3 = np.array([1e-4, -8e-5, 6e-5]), np.array([-1e-5, 8e-6, 1.2e-5])
    made = record(device, replace(SESSION, positions=40), rng, k2=k2, k3=k3)
    estimate = joint(observed(made, sensor), sensor, BENCH, ())
    bent = {f"a{a}.k2": float(k2[i]) for i, a in enumerate("xyz")}
    bent |= {f"a{a}.k3": float(k3[i]) for i, a in enumerate("xyz")}
    p = len(sensor.coefficients)
    off = (estimate.value[:p] - truth(device, sensor, **bent)) / estimate.std[:p]
    assert np.abs(off).max() < 4, dict(zip(sensor.coefficients, off.tolist(), strict=True))
    found = estimate.select(list(bent))
    assert np.abs(found.value / found.std).min() > 5


@both
def test_accelerometers_alone_are_calibrated(estimator: str):
    rng = np.random.default_rng(89)
    device, sensor = mems(rng), METHOD.prepare(imu().select_axes("f"))
    seen = observed(record(device, SESSION, rng), sensor)
    estimate = METHOD.estimator(estimator)(seen, sensor, BENCH, ())
    p = len(sensor.coefficients)
    assert p == 9
    off = (estimate.value[:p] - truth(device, sensor)) / estimate.std[:p]
    assert np.abs(off).max() < 4
    assert [group.name for group in estimate.groups] == ["norms"]


def test_the_accelerometers_of_sequential_are_those_found_without_gyros():
    rng = np.random.default_rng(90)
    device, sensor = mems(rng), whole("g")
    made = record(device, SESSION, rng)
    alone = METHOD.prepare(imu().select_axes("f"))
    first = sequential(observed(made, alone), alone, BENCH, ())
    both_kinds = sequential(observed(made, sensor), sensor, BENCH, ())
    np.testing.assert_allclose(both_kinds.value[:9], first.value[:9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        both_kinds.covariance[:9, :9], first.covariance[:9, :9], rtol=1e-6, atol=1e-16
    )


@pytest.mark.slow
@both
def test_the_clock_of_the_recording_is_in_every_gyro_scale(estimator: str):
    """All turns are integrals over its time: nothing in a session tells it from the scale."""
    rng = np.random.default_rng(87)
    sensor = whole()
    device = mems(rng)
    seen = observed(record(device, replace(SESSION, positions=16), rng), sensor)
    found = {
        timebase: METHOD.estimator(estimator)(seen, sensor, replace(BENCH, timebase=timebase), ())
        for timebase in (0.0, 1e-4, 1e-2)
    }
    p = len(sensor.coefficients)
    exact = found[0.0].covariance[:p, :p]
    scales = [sensor.coefficients.index(f"g{a}.scale") for a in "xyz"]
    mine = [k for k, name in enumerate(sensor.coefficients) if name.startswith("a")]
    for timebase, estimate in found.items():
        shared = estimate.covariance[:p, :p] - exact
        # K is that of the gyros' output to the rate: it moves by -(1 + scale) times the error.
        by = np.array([1 + estimate.value[k] for k in scales]) * timebase
        np.testing.assert_allclose(
            shared[np.ix_(scales, scales)], np.outer(by, by), rtol=0.02, atol=1e-12
        )
        of_force = np.sqrt(np.diag(exact)[mine])
        off = shared[np.ix_(mine, mine)] / np.outer(of_force, of_force)
        assert np.abs(off).max() < 1e-3
        assert estimate.dof == found[0.0].dof
        # The earth's rate at rest tells the scale by itself, to 10 %: hence not exactly 0.
        assert (np.abs(estimate.value[:p] - found[0.0].value[:p]) < 0.1 * estimate.std[:p]).all()


@both
def test_a_wrong_clock_within_its_deviation_stays_within_u(estimator: str):
    """A prior on one gyro's scale, from a rate table, tells the clock: the others follow it."""
    rng = np.random.default_rng(88)
    sensor, device = whole(), mems(rng)
    made = record(device, replace(SESSION, positions=16), rng)
    tau = 2e-2
    seen = observed(replace(made, time=made.time / (1 + tau)), sensor)
    known = truth(device, sensor)
    scale = sensor.coefficients.index("gx.scale")
    prior = Gaussian.independent(("gx.scale",), float(known[scale]), 1e-5)
    bench = replace(BENCH, timebase=tau)
    estimate = METHOD.estimator(estimator)(seen, sensor, bench, (), (prior,))
    place = estimate.names.index("timebase")
    off = estimate.value[place] - tau
    assert abs(off) < 4 * estimate.std[place] < 0.4 * tau
    for axis in "yz":
        k = sensor.coefficients.index(f"g{axis}.scale")
        assert abs(estimate.value[k] - known[k]) < 4 * estimate.std[k] < 0.4 * tau


def gravity_lines(gravity_sd: float, positions: int = 24) -> list[str]:
    """Return the advice of a session whose gravity is known to `gravity_sd`, m/s²."""
    rng = np.random.default_rng(89)
    sensor = whole()
    seen = observed(record(mems(rng), replace(SESSION, positions=positions), rng), sensor)
    bench = replace(BENCH, gravity=Measured(SESSION.gravity, gravity_sd))
    estimate = METHOD.estimator("joint")(seen, sensor, bench, ())
    notes = (*estimate.notes, *gravity_notes(bench, sensor, estimate))
    return [note for note in notes if "comes from gravity" in note or "These attitudes" in note]


@pytest.mark.slow
def test_scale_factors_that_gravity_limits_ask_for_a_better_gravity():
    (line,) = gravity_lines(2e-2)
    assert "ax.k1, ay.k1, az.k1" in line
    assert "[bench]" in line
    before, after = re.search(r"from (\d+) to (\d+) ppm", line).groups()  # pyright: ignore
    assert float(before) == pytest.approx(2e6 * 2e-2 / 9.8, rel=0.1)
    assert float(after) < 0.3 * float(before)
    assert not gravity_lines(4e-4)
