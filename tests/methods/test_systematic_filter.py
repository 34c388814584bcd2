"""The Kalman form of systematic calibration: values, uncertainties, refusals, live estimate."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.methods import systematic_table as made
from tests.methods.systematic_cases import (
    METHOD,
    errors_of,
    group_of,
    observations_of,
    sensor_of,
    solved,
    table_of,
    unit_of,
)
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.estimation import Estimate, Gaussian
from inercal.methods.systematic.filter_estimators import LiveNavigation, solve_by_filter
from inercal.physics.sensors import Sensor
from inercal.recordings import Track

SHORT = made.Table(rest=12.0, first=12.0, last=12.0)
SENSOR = sensor_of(made.TACTICAL)
# Stated deviations of the filter with a velocity of rests known to 0.01 mm/s, navigation grade, in
# the units of the tables, from an independent program
KNOWN = {
    "gyro bias": 0.0062, "gyro scale": 1.52, "gyro delta": 0.52, "accelerometer k0": 2.8,
    "accelerometer k1": 0.84, "accelerometer delta": 0.52, "accelerometer k2": 2.0,
    "accelerometer arm": 0.79, "lag": 0.0065,
}  # fmt: skip


@cache
def device(
    grade: str, seed: int = 1, table: made.Table = SHORT, *, noisy: bool = True, rate: float = 20.0
) -> made.Recorded:
    rng = np.random.default_rng(seed)
    truth, lag = made.draw_truth(made.GRADES[grade], rng)
    noise = made.GRADES[grade] if noisy else None
    return made.record(truth, lag, table, rng, grade=noise, rate_hz=rate)


@cache
def tactical() -> tuple[made.Recorded, Estimate]:
    """Return a device of tactical grade, and its estimate by the filter."""
    recorded = device("T", 3)
    return recorded, solved(recorded, SENSOR, table_of(SHORT), estimator="kalman")


def track_of(recorded: made.Recorded, sensor: Sensor) -> Track:
    track = observations_of(recorded, sensor).track
    assert track is not None
    return track


@pytest.mark.slow
@pytest.mark.parametrize("grade", ["N", evidence("T")])
def test_without_noise_the_filter_finds_every_coefficient(grade: str):
    sensor = sensor_of(made.GRADES[grade])
    recorded = device(grade, noisy=False, rate=100.0)
    estimate = solved(recorded, sensor, table_of(SHORT), estimator="kalman")
    error, covariance = errors_of(estimate, recorded, sensor)
    assert np.all(estimate.converged)
    assert np.abs(error / np.sqrt(np.diag(covariance))).max() < 0.005


@pytest.mark.slow
def test_filter_and_batch_agree_and_the_batch_is_no_worse():
    sensor, (recorded, by_filter) = SENSOR, tactical()
    batch = solved(recorded, sensor, table_of(SHORT))
    p = len(sensor.coefficients) + 1
    u, least = (np.sqrt(np.diag(one.covariance))[:p] for one in (by_filter, batch))
    assert np.all(least < 1.05 * u)
    assert np.abs((by_filter.value - batch.value[: by_filter.value.size])[:p] / u).max() < 2
    assert 0.9 < float(by_filter.chi2) / by_filter.dof < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("grade", ["N", evidence("T")])
def test_deviations_are_those_of_an_independent_filter_and_cover_the_errors(grade: str):
    table, sensor, count = made.Table(), sensor_of(made.GRADES[grade]), 6
    nees: list[float] = []
    deviations: list[np.ndarray] = []
    for seed in range(count):
        recorded = device(grade, seed, table)
        estimate = solved(recorded, sensor, table_of(table), estimator="kalman")
        error, covariance = errors_of(estimate, recorded, sensor)
        nees.append(float(error @ np.linalg.solve(covariance, error)) / error.size)
        deviations.append(np.sqrt(np.diag(covariance)))
    assert 0.8 < np.mean(nees) < 1.3  # 99.9 %: ± .34
    if grade == "N":
        groups: dict[str, list[float]] = {}
        for name, one in zip(
            (*sensor.coefficients, "lag"), np.mean(deviations, axis=0), strict=True
        ):
            groups.setdefault(group_of(name), []).append(one / unit_of(name))
        found = {name: float(np.sqrt(np.mean(np.square(ones)))) for name, ones in groups.items()}
        assert found == pytest.approx(KNOWN, rel=0.1)


@pytest.mark.slow
def test_a_prior_is_part_of_the_estimate():
    sensor, (recorded, plain) = SENSOR, tactical()
    k = sensor.coefficients.index("gx.scale")
    stated = Gaussian.independent(("gx.scale",), [plain.value[k]], [1e-6])
    with_prior = solved(recorded, sensor, table_of(SHORT), priors=(stated,), estimator="kalman")
    assert np.sqrt(with_prior.covariance[k, k]) == pytest.approx(1e-6, rel=0.01)
    assert np.sqrt(plain.covariance[k, k]) > 10e-6
    assert with_prior.value[k] == pytest.approx(plain.value[k], abs=1e-7)


def test_coefficients_that_the_run_leaves_open_are_named():
    # All turns about x and y: only misalignments sense the gyro z.
    table = replace(SHORT, path=("+y", "+y", "+x", "+x", "-y", "-y", "-x", "-x"))
    sensor, recorded = sensor_of(made.NAVIGATION), device("N", table=table)
    track, labels = track_of(recorded, sensor), tuple(f"p{k + 1}" for k in range(9))
    with pytest.raises(NotObserved) as refusal:
        solve_by_filter(track, labels, sensor, table_of(table))
    assert "gz.scale" in refusal.value.names


@pytest.mark.slow
def test_the_live_filter_begins_when_rests_show_the_azimuth():
    table, sensor = made.Table(rest=12.0, first=12.0, last=12.0), sensor_of(made.TACTICAL)
    track = track_of(device("T", seed=5), sensor)
    live = LiveNavigation(sensor, table_of(table), (), float(track.time[-1]), 20.0)
    ends = (np.flatnonzero((track.hold[:-1] >= 0) & (track.hold[1:] < 0)) + 1).tolist()
    begun, start = 0, 0
    for k, end in enumerate(ends):
        live.feed(track.slice(start, end + 1))
        start = end + 1
        begun += not live.estimate()
        assert bool(live.estimate()) == (k >= 7), k  # the first seven rests turn about y alone
    live.feed(track.slice(start, track.time.size))
    found = live.estimate()["all"]
    assert found.components > 0.8 * 3 * (track.hold >= 0).sum() / 4
    assert found.nis / found.components == pytest.approx(1, abs=0.1)


def test_a_live_run_with_a_reversed_axis_is_refused_by_name():
    sensor = sensor_of(made.TACTICAL)
    track = track_of(device("T", seed=5), sensor)
    reading = track.reading.copy()
    reading[:, 1] *= -1
    live = LiveNavigation(sensor, table_of(SHORT), (), float(track.time[-1]), 20.0)
    with pytest.raises(InputError, match="y of the accelerometers were reversed"):
        live.feed(replace(track, reading=reading))


@pytest.mark.slow
def test_a_live_run_refuses_samples_missing_in_a_turn_but_not_in_a_rest():
    sensor = sensor_of(made.TACTICAL)
    track = track_of(device("T", seed=5), sensor)
    rest = int(np.flatnonzero(track.hold == 2)[50])
    turn = int(np.flatnonzero(track.hold < 0)[-100])
    for at, wanted in ((rest, False), (turn, True)):
        live = LiveNavigation(sensor, table_of(SHORT), (), float(track.time[-1]), 20.0)
        live.feed(track.slice(0, at))
        after = track.slice(at + 5, track.time.size)
        if wanted:
            with refused(key="[data]"):
                live.feed(after)
        else:
            live.feed(after)
            assert live.estimate()


def test_a_live_run_needs_both_triads():
    part = sensor_of(made.TACTICAL).select_axes("w")
    assert METHOD.sequential is not None
    with pytest.raises(InputError, match="three accelerometers and three gyros"):
        LiveNavigation(part, table_of(SHORT), (), 100.0, 20.0)


@pytest.mark.slow
def test_what_is_stated_of_gravity_and_latitude_is_part_of_u():
    sensor, (recorded, without) = SENSOR, tactical()
    exact = table_of(SHORT)
    stated = replace(
        exact,
        gravity=replace(exact.gravity, sd=4e-4),
        latitude=replace(exact.latitude, sd=np.radians(0.5)),
    )
    by_filter = solved(recorded, sensor, stated, estimator="kalman")
    batch = solved(recorded, sensor, stated)
    assert {"g", "latitude"} <= set(by_filter.names)
    assert not {"g", "latitude"} & set(without.names)
    g = by_filter.names.index("g")
    assert np.sqrt(by_filter.covariance[g, g]) == pytest.approx(4e-4, rel=1e-3)
    for name in ("ax.k1", "ay.k1", "az.k1"):
        k = sensor.coefficients.index(name)
        added = by_filter.covariance[k, k] - without.covariance[k, k]
        assert added == pytest.approx((4e-4 / SHORT.gravity) ** 2, rel=0.02)
        # As in the batch, whose columns by gravity other calibrations share
        other = batch.covariance[k, batch.names.index("g")]
        assert by_filter.covariance[k, g] == pytest.approx(other, rel=0.02)


def verdict_of(grade: str, recorded: made.Recorded, bench: Any, sensor: Any = None) -> float:
    """Return the smallest p of χ² and of the tests of the innovations."""
    estimate = solved(recorded, sensor or sensor_of(made.GRADES[grade]), bench, estimator="kalman")
    return min(float(estimate.p_value), *(test.p_value for test in estimate.tests))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "latitude"),
    [
        pytest.param(made.Table(creep=(10 * made.ARCSEC, 10.0)), 0.0, id="table creeps 10″"),
        pytest.param(made.Table(), np.radians(1), id="latitude off 1°"),
    ],
)
def test_what_is_not_still_or_not_there_is_seen_in_the_innovations(
    table: made.Table, latitude: float
):
    bench = table_of(made.Table(), latitude=made.Table().latitude + latitude)
    assert verdict_of("N", device("N", 7, table), bench) < 1e-20
    assert verdict_of("N", device("N", 7, made.Table()), table_of(made.Table())) > 0.001


@pytest.mark.slow
@pytest.mark.parametrize("grade", ["N", evidence("T")])
def test_a_lost_sample_and_noise_stated_at_half_are_seen(grade: str):
    table, g = made.Table(), made.GRADES[grade]
    recorded = device(grade, 8, table)
    half = replace(
        g, gyro_white=g.gyro_white / 2, force_white=g.force_white / 2,
        gyro_drift=g.gyro_drift / 2, force_drift=g.force_drift / 2,
    )  # fmt: skip
    assert verdict_of(grade, recorded, table_of(table), sensor_of(half)) < 1e-20
    lost = replace(
        recorded, reading=np.delete(recorded.reading, 1500, axis=0), time=recorded.time[:-1]
    )
    assert verdict_of(grade, lost, table_of(table)) < 1e-20


@pytest.mark.slow
def test_a_knock_at_rest_harms_the_batch_and_not_the_filter():
    table = made.Table(knock=(20 * made.ARCSEC, 400.0))
    sensor, recorded = sensor_of(made.NAVIGATION), device("N", 3, table)
    largest: list[float] = []
    for name in ("batch", "kalman"):
        estimate = solved(recorded, sensor, table_of(table), estimator=name)
        error, covariance = errors_of(estimate, recorded, sensor)
        largest.append(float(np.abs(error / np.sqrt(np.diag(covariance))).max()))
    assert largest[0] > 5  # which its χ² shows
    assert largest[1] < 4.5


@pytest.mark.slow
def test_a_lag_of_several_samples_is_found():
    sensor, rng = sensor_of(made.NAVIGATION), np.random.default_rng(2)
    truth, _ = made.draw_truth(made.NAVIGATION, rng)
    recorded = made.record(truth, 0.13, SHORT, rng, grade=made.NAVIGATION)
    estimate = solved(recorded, sensor, table_of(SHORT), estimator="kalman")
    error, covariance = errors_of(estimate, recorded, sensor)
    assert abs(error[-1]) < 1e-4
    assert np.abs(error / np.sqrt(np.diag(covariance))).max() < 4.5


@pytest.mark.slow
def test_lever_arms_that_are_left_out_are_seen_in_the_turns():
    full = sensor_of(made.TACTICAL)
    kept = [name for name in full.coefficients if ".arm_" not in name]
    recorded = device("T", 4)
    left = sensor_of(made.TACTICAL, coefficients=kept)
    assert verdict_of("T", recorded, table_of(SHORT), left) < 1e-6
    assert verdict_of("T", recorded, table_of(SHORT), full) > 0.001
