"""Both filters on a turntable: against the note's dense ones, in pieces, and where they fail."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import radians
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from tests.accuracy import turntable
from tests.accuracy.turntable_filters import FilterOutcome, Step
from tests.accuracy.turntable_filters import accelerometer as dense_accelerometer
from tests.accuracy.turntable_filters import gyro as dense_gyro
from tests.accuracy.turntable_filters import smoothing_correction as dense_smoothed
from tests.base_seeds import chosen, evidence
from tests.methods.turntable_cases import (
    ARCSEC,
    bench,
    columns,
    observations,
    score,
    sensor,
    track,
    truth,
)
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.estimation import FilterHistory, Gaussian, NullDirection, SmoothedStates
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman import METHOD
from inercal.methods.turntable_kalman._gyros import run_gyro_filter as compiled_gyros
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.filtered_track import filter_track
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recordings import Track

REST = ("rest", (0, 0, 0), 20.0)
POSITIONS = [("warm-up", (0, 0, 0), 30.0), *turntable.positions(5.0)]
SHORT = [*POSITIONS, *turntable.turns(360.0, 30.0)[:-1], REST]
TEN_SECONDS = [(name, angles, 10.0) for name, angles, _ in turntable.positions()]
SENSOR = sensor()
HELD = 3.5 * ARCSEC  # the note's error of each hold


@pytest.fixture(scope="module")
def made() -> turntable.Draw:
    return turntable.draw(1, 2, SHORT)


@pytest.fixture(scope="module")
def smooth() -> turntable.Draw:
    # A table that is not late, as the note takes a delay in first order, and whose moves do not all
    # begin suddenly at a sample: there a parabola is off by as much as it ever is.
    return turntable.draw(1, 2, SHORT, table=turntable.Table(latency=0.0, jerk=radians(300)))


Dense = Callable[[int], tuple[FilterOutcome, list[Step]]]


@pytest.fixture(scope="module")
def of_gyros(smooth: turntable.Draw) -> Dense:
    """Return where the note's filter of so many states ends, and its steps."""

    @cache
    def run(states: int) -> tuple[FilterOutcome, list[Step]]:
        steps: list[Step] = []
        return dense_gyro(smooth, states, steps=steps), steps

    return run


@pytest.fixture(scope="module")
def of_accelerometers(made: turntable.Draw) -> Dense:
    """Return the same of the accelerometers, where the table carries the attitude.

    As gyros would that are perfect.
    """
    carried, grade = replace(made, rates=_of_the_earth(made)), replace(turntable.T, arw=0.0)

    @cache
    def run(states: int) -> tuple[FilterOutcome, list[Step]]:
        steps: list[Step] = []
        return dense_accelerometer(carried, states, grade=grade, steps=steps), steps

    return run


@pytest.mark.slow
@pytest.mark.parametrize(("states", "chosen"), [evidence(15, False), (19, True)])
def test_gyros_filter_is_the_notes(
    smooth: turntable.Draw, of_gyros: Dense, states: int, chosen: bool
):
    made, (dense, _) = smooth, of_gyros(states)
    # Without an azimuth to doubt: the note has no such state.
    stated = bench(azimuth=replace(bench().azimuth, sd=0.0))
    for k in range(2):
        one = track(made).trial(k)
        ours = GyroFilter.from_track(
            sensor(), stated, one, bias_drift=chosen, table="lean" if chosen else "exact",
            readback_sd=(4 if chosen else 10) * ARCSEC,
        )  # fmt: skip
        ours = replace(ours, lag=0)  # the note takes a readback in as it comes
        state, _ = ours.step(ours.start(one), one)
        by = columns(ours.triad.sensor.coefficients)
        sd = np.sqrt(np.diagonal(dense.covariance[k]))
        assert np.max(np.abs(by @ state.theta - dense.theta[k]) / sd) < 0.03
        assert np.sqrt(np.diagonal(by @ state.p[3:15, 3:15] @ by.T)) == pytest.approx(sd, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("states", "held"), [(18, "exact"), (25, "lean")])
def test_accelerometers_filter_is_the_notes(
    made: turntable.Draw,
    of_accelerometers: Dense,
    states: int,
    held: Literal["exact", "lean"],
):
    dense, _ = of_accelerometers(states)
    # The note's 3.5″ of each hold by right angles alone would differ between holds: no harmonics,
    # and both leans and right angles as large as give it.
    for k in range(2):
        one = track(made).trial(k)
        hold = np.where(np.isin(made.labels, [f"p{n + 1}" for n in range(10)]), one.hold, -1)
        ours = AccelerometerFilter.from_track(
            sensor(), bench(), one, bias_drift=states == 25, table=held,
            readback_sd=(1 if states == 25 else 10) * ARCSEC, velocity_sd=1e-3,
        )  # fmt: skip
        inside = Track(one.time, one.reading, one.angles, hold)
        alike = _Alike(**vars(ours))
        state, _ = alike.step(alike.start(inside), inside)
        by = columns(ours.triad.sensor.coefficients)
        sd = np.sqrt(np.diagonal(dense.covariance[k]))
        assert np.max(np.abs(by @ state.theta - dense.theta[k]) / sd) < 0.1
        assert np.sqrt(np.diagonal(by @ state.p[6:18, 6:18] @ by.T)) == pytest.approx(sd, rel=0.02)


def _of_the_earth(made: turntable.Draw) -> np.ndarray:
    """Return what perfect gyros read at rest, from attitudes where each rest begins."""
    first = np.r_[True, made.labels[1:] != made.labels[:-1]]
    at = np.flatnonzero(first)[np.cumsum(first) - 1]
    table = turntable.Table()
    north, up = np.cos(table.latitude), np.sin(table.latitude)
    earth = turntable.EARTH * np.array([0.0, north, up])
    return turntable.attitude(made.angles[:, at]).swapaxes(-1, -2) @ earth


class _Alike(AccelerometerFilter):
    """The filter with the note's error of each hold in the place of what the table declares."""

    def _hold_variance(self, angles: np.ndarray) -> np.ndarray:
        return np.full((len(angles), 2), HELD**2)


@pytest.mark.slow
def test_the_gyros_way_back_is_that_of_the_notes_filter(smooth: turntable.Draw, of_gyros: Dense):
    made, (_, steps) = smooth, of_gyros(19)
    exact = dense_smoothed(steps)
    stated = bench(azimuth=replace(bench().azimuth, sd=0.0))
    for k in range(2):
        one = track(made).trial(k)
        ours = replace(
            GyroFilter.from_track(sensor(), stated, one, table="lean", readback_sd=4 * ARCSEC),
            lag=0,
        )
        _, course = ours.step(ours.start(one), one, ours.time_varying_states)
        _compare(course.smoothed, steps, exact, k, [0, 1, 2], [15, 16, 17])


def test_the_accelerometers_way_back_is_that_of_the_notes_filter(
    made: turntable.Draw, of_accelerometers: Dense
):
    _, steps = of_accelerometers(25)
    exact = dense_smoothed(steps)
    for k in range(2):
        one = track(made).trial(k)
        hold = np.where(np.isin(made.labels, [f"p{n + 1}" for n in range(10)]), one.hold, -1)
        inside = Track(one.time, one.reading, one.angles, hold)
        ours = AccelerometerFilter.from_track(
            sensor(), bench(), one, table="lean", readback_sd=ARCSEC, velocity_sd=1e-3
        )
        alike = _Alike(**vars(ours))
        smooth = (*alike.states[:5], *alike.time_varying_states[2:5])
        _, course = alike.step(alike.start(inside), inside, smooth)
        _compare(course.smoothed, steps, exact, k, [0, 1, 2, 3, 4], [18, 19, 20])


def _compare(
    found: SmoothedStates | None,
    steps: list[Step],
    smoothed: tuple[np.ndarray, np.ndarray],
    trial: int,
    fed: list[int],
    drift: list[int],
) -> None:
    """Hold what is smoothed to Rauch, Tung and Striebel: what is fed back, and the drift."""
    assert found is not None
    added, spread = smoothed
    exact, at = added[:, trial].copy(), [*fed, *drift]
    filtered = np.zeros(3)
    for e, (phi, _, _, x) in enumerate(steps):
        filtered = phi[trial][drift, drift] * filtered + x[trial][drift]
        exact[e, drift] += filtered
    sd = np.sqrt(np.diagonal(spread[:, trial], axis1=1, axis2=2))[:, at]
    off = np.abs(found.value[: len(steps)] - exact[:, at]) / sd
    assert off[:, len(fed) :].max() < 0.02
    # The attitudes that both go by differ while the coefficients are still far off; what both feel
    # of them at rest, until all axes have been up.
    early = len(steps) // 4
    assert off[2 * early :].max() < 0.25
    np.testing.assert_allclose(found.std[early : len(steps)], sd[early:], rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [GyroFilter, AccelerometerFilter])
def test_constants_are_all_along_what_they_are_at_the_end(
    made: turntable.Draw, kind: type[GyroFilter] | type[AccelerometerFilter]
):
    one = track(made).trial(0)
    kept = np.r_[0:9000, 9300 : one.time.size]  # with a gap: the attitude is taken anew
    torn = Track(one.time[kept], one.reading[kept], one.angles[kept], one.hold[kept])
    ours: Any = kind.from_track(sensor(), bench(), torn)
    first = ours.states.index(ours.triad.sensor.coefficients[0])
    constants = tuple(name for name in ours.states[first:] if name not in ours.time_varying_states)
    _, course = ours.step(ours.start(torn), torn, constants)
    at = [course.names.index(name) for name in constants]
    assert course.smoothed.value[-1] == pytest.approx(course.value[-1, at], rel=1e-12)
    value, std = course.smoothed.value, course.smoothed.std
    assert np.max(np.abs(value - value[-1]) / std[-1]) < 1e-6
    # At first variances are 10⁷ times as large, and what is left of them is a difference.
    assert np.max(np.abs(std / std[-1] - 1)) < 0.03


@pytest.mark.parametrize("kind", [GyroFilter, AccelerometerFilter])
def test_what_varies_is_the_attitude_alone_where_biases_do_not_drift(
    made: turntable.Draw, kind: type[GyroFilter] | type[AccelerometerFilter]
):
    one = track(made).trial(0)
    names = kind.from_track(sensor(), bench(), one, bias_drift=False).time_varying_states
    assert names
    assert all(name.startswith("phi_") for name in names)


@pytest.mark.parametrize("kind", [GyroFilter, AccelerometerFilter])
def test_a_recording_in_pieces_is_the_whole_to_the_last_bit(
    made: turntable.Draw, kind: type[GyroFilter] | type[AccelerometerFilter]
):
    one = track(made).trial(0)
    cuts = np.sort(np.random.default_rng(3).choice(one.time.size - 1, 40, replace=False) + 1)
    ours: Any = kind.from_track(sensor(), bench(), one)
    whole, course = ours.step(ours.start(one), one)
    state, parts = ours.start(one), list[FilterHistory]()
    for start, stop in pairwise([0, *cuts.tolist(), one.time.size]):
        state, part = ours.step(state, one.slice(start, stop))
        parts.append(part)
    assert np.array_equal(state.theta, whole.theta)
    assert np.array_equal(state.p, whole.p)
    assert state.nis == pytest.approx(whole.nis, rel=1e-12)
    assert np.array_equal(np.concatenate([part.value for part in parts]), course.value)
    assert np.array_equal(np.concatenate([part.time for part in parts]), course.time)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [GyroFilter, AccelerometerFilter])
def test_the_smoother_from_checkpoints_is_that_of_the_whole(
    made: turntable.Draw, kind: type[GyroFilter] | type[AccelerometerFilter]
):
    one = track(made).trial(0)
    ours: Any = kind.from_track(sensor(flicker=True), bench(), one)
    names = ours.time_varying_states
    whole, parts = (
        filter_track(ours, ours.start(one), one, piece).smoothed(names) for piece in (10**6, 1300)
    )
    # Of a value near zero the rounding is that of the sums it is a difference of.
    assert np.max(np.abs(parts.value - whole.value) / whole.std) < 1e-10
    np.testing.assert_allclose(parts.std, whole.std, rtol=1e-10)


@pytest.mark.slow
def test_both_filters_make_one_estimate_in_the_sensors_order(made: turntable.Draw):
    estimate = METHOD.estimator("")(observations(made), sensor(), bench(), ())
    names = sensor().coefficients
    assert estimate.names[:24] == names
    assert {"latency", "azimuth", "square_1", "sin1[outer]", "lean_x"} <= set(estimate.names)
    assert estimate.value.shape == (2, len(estimate.names))
    off = (estimate.value[:, :24] - truth(made, names)) / estimate.std[:, :24]
    assert np.sqrt(np.mean(off**2)) < 1.3
    assert [one.name for one in estimate.courses] == ["gyros", "accelerometers"]
    late = estimate.select(["latency"])
    assert np.all(np.abs(late.value - 2e-3) < 4 * late.std)


def test_biases_of_a_tenth_of_a_degree_a_second_are_found_only_where_fed_back():
    made = turntable.draw(2, 1, SHORT)
    one = track(made).trial(0)
    ours = GyroFilter.from_track(sensor(), bench(), one, table="lean")
    raw = replace(ours, initial_values=np.zeros(12))
    by = columns(ours.triad.sensor.coefficients)
    off = {}
    for name, filter_ in (("closed", raw), ("open", replace(raw, feedback=False))):
        state, _ = filter_.step(filter_.start(one), one)
        found = state.theta + state.x[3:15]
        sd = np.sqrt(np.diagonal(state.p[3:15, 3:15]))
        off[name] = float(np.max(np.abs(found - made.gyro[0] @ by) / sd)), state.nis / state.dof
    assert off["closed"][0] < 5
    assert off["open"][0] > 50
    assert off["open"][1] > 10 * off["closed"][1]  # and NIS says so


def test_attitudes_at_the_ends_of_turns_alone_leave_six_of_twelve():
    made = turntable.draw(1, 1, [("warm-up", (0, 0, 0), 30.0), *turntable.turns()])
    one = track(made).trial(0)
    ours = GyroFilter.from_track(sensor(), bench(), one, table="lean")
    whole, _ = ours.step(ours.start(one), one)
    assert model.undecided_directions(ours.triad, whole.p[3:15, 3:15]) == ()
    ends = replace(ours, compare_while_turning=False)
    state, _ = ends.step(ends.start(one), one)
    free = model.undecided_directions(ours.triad, state.p[3:15, 3:15])
    assert len(free) == 6
    assert all(name.split(".")[1].startswith("delta") for one in free for name in _large(one))


def _large(direction: NullDirection) -> list[str]:
    return [name for name, weight in direction.weights.items() if abs(weight) > 0.05]


def test_a_run_that_never_turns_about_z_names_what_it_leaves_open():
    path = [("warm-up", (0, 0, 0), 30.0), ("up", (0, 90, 0), 30.0), ("x+", 1, 360.0, 20.0)]
    made = turntable.draw(1, 1, [*path, ("rest", (0, 0, 0), 30.0)])
    with pytest.raises(NotObserved) as refusal:
        METHOD.estimator("full")(observations(made), sensor(), bench(), ())
    assert refusal.value.directions
    assert "gz.scale" in refusal.value.names
    assert all(name[0] == "g" for name in refusal.value.names)


def test_a_prior_decides_what_the_run_leaves_open(made: turntable.Draw):
    one = track(made).trial(0)
    wide = GyroFilter.from_track(sensor(), bench(), one)
    told = Gaussian.independent(("gx.scale",), (0.005,), (1e-6,))
    ours = GyroFilter.from_track(sensor(), bench(), one, (told,))
    k = ours.triad.sensor.coefficients.index("gx.scale")
    assert ours.initial_values[k] == pytest.approx(0.005, abs=1e-9)
    assert ours.prior[k, k] == pytest.approx(1e-12, rel=1e-6)
    assert wide.prior[k, k] == pytest.approx(0.02**2)


LATE = turntable.Table(latency=0.02)


@pytest.fixture(scope="module")
def late() -> turntable.Draw:
    path = [("warm-up", (0, 0, 0), 30.0), *TEN_SECONDS, *turntable.turns()]
    return turntable.draw(3, 6, path, table=LATE)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["paper", "full"])
def test_a_readback_20_ms_late_is_a_state_or_an_error(late: turntable.Draw, estimator: str):
    made = late
    estimate = METHOD.estimator(estimator)(observations(made), sensor(), bench(LATE), ())
    names = [name for name in sensor().coefficients if name[0] == "g"]
    found = estimate.select(names)
    judged = score(found.value - truth(made, names), found.stated_covariance, names, "g")
    assert judged.cross < 9 if estimator == "full" else judged.cross > 15
    assert judged.nees < 2.5 if estimator == "full" else judged.nees > 5


@pytest.mark.slow
def test_sensitivity_to_acceleration_is_found_or_shows():
    device = turntable.Device(by_g=radians(10) / 3600 / turntable.G)
    made = turntable.draw(4, 4, SHORT, device=device)
    seen = observations(made)
    for also, honest in ((("g",), True), ((), False)):
        chosen = sensor(turntable.T, *also)
        estimate = METHOD.estimator("full")(seen, chosen, bench(), ())
        names = [n for n in chosen.coefficients if n[0] == "g" and ".g_" not in n]
        found = estimate.select(names)
        judged = score(found.value - truth(made, names), found.stated_covariance, names, "g")
        assert (judged.nees < 2) == honest
        if also:
            told = [n for n in chosen.coefficients if ".g_" in n]
            off = _by_g(made, told) - estimate.select(told).value
            assert np.sqrt(np.mean((off / estimate.select(told).std) ** 2)) < 1.5


def _by_g(made: turntable.Draw, names: list[str]) -> np.ndarray:
    rows = [("xyz".index(n[1]), ("i", "p", "o").index(n[-1])) for n in names]
    return np.stack([made.by_g[:, i, (i + k) % 3] for i, k in rows], axis=1)


@pytest.mark.slow
def test_gravity_that_is_not_known_well_is_in_every_scale_factor(made: turntable.Draw):
    g = bench().gravity
    seen = observations(made)
    sharp = METHOD.estimator("full")(seen, sensor(), bench(), ()).select(["ax.k1", "ay.k1"])
    stated = bench(gravity=replace(g, sd=40e-6 * g.value))
    loose = METHOD.estimator("full")(seen, sensor(), stated, ()).select(["ax.k1", "ay.k1"])
    added = loose.covariance - sharp.covariance
    assert added == pytest.approx(np.full((2, 2, 2), (40e-6) ** 2), rel=0.05)


class Judged(NamedTuple):
    """NIS and NEES by component, and what the first trial's course says."""

    nis: float
    nees: float
    course: FilterHistory


def judged(
    made: turntable.Draw, stated: Turntable, tracks: Sequence[Track], **changes: Any
) -> Judged:
    """Return how the gyros' filter did that trusts the readback as its noise allows."""
    nis, nees, courses = [], [], []
    for k, one in enumerate(tracks):
        ours = replace(
            GyroFilter.from_track(SENSOR, stated, one, readback_sd=0.5 * ARCSEC), **changes
        )
        state, course = ours.step(ours.start(one), one)
        courses.append(course)
        names = ours.triad.sensor.coefficients
        off = state.theta + state.x[3:15] - made.gyro[k] @ columns(names)
        nees.append(off @ np.linalg.solve(state.p[3:15, 3:15], off) / 12)
        nis.append(state.nis / state.dof)
    return Judged(float(np.mean(nis)), float(np.mean(nees)), courses[0])


def trials(made: turntable.Draw) -> list[Track]:
    whole = track(made)
    return [whole.trial(k) for k in range(len(made.rates))]


def band(devices: int) -> float:
    """Return three standard deviations of NEES by coefficient."""
    return 3 * (2 / (12 * devices)) ** 0.5


@cache
def both_ways(rate: float, table: turntable.Table) -> turntable.Draw:
    """Return positions, and turns there and back at a rate, °/s."""
    path = [*POSITIONS, *turntable.turns(1080.0, rate, back=True)[:-1], REST]
    return turntable.draw(11, 8, path, table=table)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "acceleration", "jerk"),
    [(100, 300, 3000), evidence(60, 100, 500), (100, 300, None), evidence(30, 30, None)],
)
def test_a_fast_table_is_followed_as_honestly_as_a_slow_one(
    rate: float, acceleration: float, jerk: float | None
):
    table = turntable.Table(
        fastest=radians(rate),
        acceleration=radians(acceleration),
        jerk=None if jerk is None else radians(jerk),
    )
    made = both_ways(float(rate), table)
    found = judged(made, bench(table), trials(made))
    assert 0.93 < found.nis < 1.07
    assert abs(found.nees - 1) < band(8)


@pytest.mark.parametrize(
    ("hz", "true", "stated", "sd"),
    chosen(
        [(100, 20, 20, 5), (100, 150, 150, 5), (100, 200, 200, 5), (100, 700, 700, 5),
         (100, 0, 0, 12), (100, 10, 0, 10), (100, -10, 0, 10), (100, 20, 20, 0),
         (1000, 100, 100, 5)],
        [(100, 20, 20, 5), (100, 700, 700, 5), (100, 10, 0, 10), (100, 20, 20, 0)],
    ),
)  # fmt: skip
def test_a_readback_is_as_late_as_is_stated(hz: float, true: float, stated: float, sd: float):
    table = turntable.Table(latency=true * 1e-3)
    path = [("warm-up", (0, 0, 0), 25.0), *turntable.turns(360.0, 30.0, back=True)]
    made = turntable.draw(12, 3, path, table=table, hz=hz)
    told = bench(table, latency=Measured(stated * 1e-3, sd * 1e-3))
    found = judged(made, told, trials(made))
    # What a delay of which little is known does of second order in the first moves stays.
    assert 0.9 < found.nis < (1.25 if sd > 5 else 1.08)
    assert abs(found.nees - 1) < band(3)
    if sd:
        at = found.course.names.index("latency")
        assert abs(found.course.value[-1, at] - true * 1e-3) < 4 * found.course.std[-1, at]


def test_a_latency_that_is_hardly_known_is_refused(made: turntable.Draw):
    told = bench(latency=Measured(0.0, 50e-3))
    with refused(key="[bench] latency"):
        GyroFilter.from_track(SENSOR, told, track(made).trial(0))


def test_an_imu_that_waits_for_its_readback_may_come_in_pieces():
    table = turntable.Table(latency=0.15)
    made = turntable.draw(1, 1, SHORT, table=table)
    one = track(made).trial(0)
    ours = GyroFilter.from_track(SENSOR, bench(table, latency=Measured(0.15, 5e-3)), one)
    assert ours.lag == -12
    whole, _ = ours.step(ours.start(one), one)
    state = ours.start(one)
    for start, stop in pairwise([0, 1, 5, 12, 13, 30, 4000, one.time.size]):
        state, _ = ours.step(state, one.slice(start, stop))
    assert np.array_equal(state.theta, whole.theta)
    assert np.array_equal(state.p, whole.p)


def test_the_filter_is_compiled_once_whichever_of_imu_and_readback_waits():
    table = turntable.Table(latency=0.15)
    one = track(turntable.draw(1, 1, SHORT, table=table)).trial(0)
    exact, late, early = Measured(0, 0), Measured(0.15, 5e-3), Measured(-0.15, 5e-3)
    filters = [
        GyroFilter.from_track(SENSOR, bench(table, latency=delay), one)
        for delay in (exact, late, early)
    ]
    assert filters[1].lag < 0 < filters[2].lag
    assert isinstance(compiled_gyros, Dispatcher)
    signatures = list[int]()
    for ours in filters:
        state = ours.start(one)
        for start, stop in pairwise([0, 30, 4000]):
            state, _ = ours.step(state, one.slice(start, stop))
        signatures.append(len(compiled_gyros.signatures))
    assert len(set(signatures)) == 1


def test_drift_of_the_bias_is_in_what_a_late_readback_is_compared_with():
    clean = turntable.Table(white=0.0, harmonics=(0.0, 0.0), square=0.0, lean=0.0, azimuth=0.0)
    bias_drift = turntable.Device(gyro_bias=radians(0.1), scale=0.0, cross=0.0)
    silent = turntable.grade(0, 0, 0, 0)
    made = turntable.draw(13, 1, [("warm-up", (0, 0, 0), 25.0)], silent, clean, bias_drift)
    one = track(made).trial(0)
    ours = replace(
        GyroFilter.from_track(SENSOR, bench(clean), one, readback_sd=0.5 * ARCSEC), lag=4
    )
    ours = replace(ours, initial_values=np.zeros(12))
    state = ours.start(one)
    state.x[15:18] = made.gyro[0, :3]  # as if it had been found
    state.p[:, :] *= 1e-6
    state, _ = ours.step(state, one.slice(0, 60))
    # 40 ms of a drift of 0.1 °/s would be 14″.
    assert np.max(np.abs(state.c - np.eye(3))) < 2 * ARCSEC


def test_an_axis_that_does_not_turn_finds_no_scale_factor_in_its_noise():
    path = [("warm-up", (0, 0, 0), 25.0), *turntable.turns(360.0, 30.0, back=True)[:3]]
    made = turntable.draw(12, 3, path)
    for k, one in enumerate(trials(made)):
        ours = GyroFilter.from_track(SENSOR, bench(), one, readback_sd=0.5 * ARCSEC)
        state, _ = ours.step(ours.start(one), one)
        names = ours.triad.sensor.coefficients
        off = (state.theta - made.gyro[k] @ columns(names))[names.index("gz.scale")]
        # Near what was expected before the data: they say nothing of it.
        assert abs(off) < 3 * 0.02
        assert state.p[3 + names.index("gz.scale"), 3 + names.index("gz.scale")] > (0.9 * 0.02) ** 2


def test_open_and_closed_loop_agree_near_the_truth():
    wandering = turntable.grade(0.1, 20, 60, 15)
    made = turntable.draw(14, 1, SHORT, wandering)
    one = track(made).trial(0)
    ours = GyroFilter.from_track(sensor(wandering), bench(), one, table="lean")
    near = replace(ours, initial_values=made.gyro[0] @ columns(ours.triad.sensor.coefficients))
    closed, _ = near.step(near.start(one), one)
    parted = replace(near, feedback=False)
    opened, _ = parted.step(parted.start(one), one)
    sd = np.sqrt(np.diagonal(closed.p[3:, 3:]))
    apart = opened.x[3:] - closed.x[3:]
    apart[:12] += opened.theta - closed.theta
    assert np.max(np.abs(apart) / sd) < 0.1
    assert opened.nis == pytest.approx(closed.nis, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.6, 3.0, 7.0])
def test_a_gap_takes_the_attitude_from_the_table_anew(seconds: float):
    made = both_ways(30.0, turntable.Table())
    # Up to 7 s of it the table turns back meanwhile.
    middle = int(np.flatnonzero(made.labels == "y+")[-1]) - 150
    kept = np.r_[0:middle, middle + round(100 * seconds) : made.time.size]
    torn = [
        Track(one.time[kept], one.reading[kept], one.angles[kept], one.hold[kept])
        for one in trials(made)
    ]
    found = judged(made, bench(), torn)
    assert 0.93 < found.nis < 1.07
    assert abs(found.nees - 1) < band(8)


def test_what_the_filters_do_not_take_is_refused(made: turntable.Draw):
    seen = observations(made)
    estimate = METHOD.estimator("full")
    with refused(key="track"):
        estimate(replace(seen, track=None), sensor(), bench(), ())
    moving = replace(seen, track=replace(track(made), hold=np.full(made.time.size, -1)))
    with refused(key="hold"):
        estimate(moving, sensor(), bench(), ())
    silent = replace(sensor(), axes=tuple(replace(a, noise=type(a.noise)()) for a in sensor().axes))
    with refused(key="[sensor.gyro] white"):
        estimate(seen, silent, bench(), ())
    alike = np.array([[1e-6, 5e-7], [5e-7, 1e-6]])
    both = Gaussian(("gx.scale", "ax.k1"), np.zeros(2), alike)
    with refused(names=("gx.scale", "ax.k1")):
        estimate(seen, sensor(), bench(), (), (both,))
    with refused(names=("ax.koq",)):
        estimate(seen, sensor().with_coefficients("bias", "scale", "ax.koq"), bench(), ())
