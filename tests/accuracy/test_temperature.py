"""Coefficients of temperature on soaks and slow ramps, made from the physics alone.

Errors are held against the stated covariance: over all devices the normalised error squared (NEES)
is χ² of as many degrees of freedom as there are coefficients.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtri
from tests.accuracy import ferraris, handheld, turntable
from tests.accuracy import temperature as thermal
from tests.accuracy.inercal_inputs import make_bench, make_hold
from tests.base_seeds import SEEDS, evidence, sampled, slow
from tests.methods import turntable_cases

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.hand_likelihood import ml
from inercal.physics.sensors import Sensor, imu
from inercal.recordings import Mark, Observations, Recording
from inercal.recordings.segments import (
    average_sections,
    holds_from_marks,
    holds_from_observations,
    transitions_between_rests,
)

Array = NDArray[np.float64]
DEVICES = 100
BOTH = ("k0_dT", "k1_dT")
ALL = (*BOTH, "bias_dT", "scale_dT")
COLD_AND_HOT = np.repeat([-10.0, 20.0, 50.0], 6) + thermal.ZERO
RAMP = thermal.temperature_ramp(18, 0, 40)
TILT = 5e-4
PLATE = Hand(Measured(9.81, 1e-4), None, tilt=TILT)
PATH: list[turntable.Stand | turntable.Turn] = [
    ("warm-up", (0, 0, 0), 30.0),
    *turntable.positions(15.0),
    *turntable.turns(360, 30, back=True)[:-1],
    ("rest", (0, 0, 0), 20.0),
]
SMOOTH = turntable.Table(jerk=radians(30))


def assert_nees(error: Array, covariance: Array) -> None:
    """Fail beyond the two-sided 99.9 % band of χ², over errors (trials, p)."""
    weighed = np.linalg.solve(covariance, error[..., None])[..., 0]
    nees, dof = float((error * weighed).sum()), error.size
    low, high = (float(chdtri(dof, tail)) for tail in (0.9995, 0.0005))
    print(f"NEES {nees / dof:.3f} in {low / dof:.3f} to {high / dof:.3f}")
    assert low < nees < high


def part(
    estimate: Estimate, sensor: Sensor, truth: Array, of: Sequence[str] = ALL
) -> tuple[Array, Array]:
    """Return errors and covariance of some terms' coefficients alone."""
    at = [k for k, name in enumerate(sensor.coefficients) if name.partition(".")[2] in of]
    error = estimate.value[..., : truth.shape[-1]] - truth
    return error[..., at], estimate.stated_covariance[..., at, :][..., at]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("temperature", [COLD_AND_HOT, RAMP], ids=["soaks", "ramp"])
def test_six_positions_from_means_find_bias_and_scale_against_temperature(
    seed: int, temperature: Array
):
    made = thermal.faces(np.random.default_rng([seed, 6]), DEVICES, temperature, tilt=TILT)
    sensor = METHODS["six_position"].prepare(imu().select_axes("f"), also=BOTH)
    sd = 30e-6 * thermal.G0
    r = len(made.labels)
    seen = Observations(
        made.labels,
        made.mean,
        np.tile(sd**2 * np.eye(3), (r, 1, 1)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        sensor.channels,
        temperature=made.temperature,
    )
    steps = [make_hold(label, up) for label, up in zip(made.labels, made.up, strict=True)]
    found = ml(seen, sensor, PLATE, steps)
    truth = np.array([made.truth[name] for name in sensor.coefficients]).T
    p = len(sensor.coefficients)
    assert_nees(found.value[:, :p] - truth, found.covariance[:, :p, :p])
    error, covariance = part(found, sensor, truth)
    assert_nees(error, covariance)
    worst = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).max(axis=0)
    assert (2 * worst < np.tile([5e-6 * thermal.G0, 5e-6], 3)).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("soaked", [True, slow(False)], ids=["soaks", "ramp"])
def test_six_positions_of_a_recording_find_the_same(seed: int, soaked: bool):
    rng = np.random.default_rng([seed, 7])
    faces = {
        f"{name}{soak}": up
        for soak in ("", " (2)", " (3)")
        for name, up in ferraris.POSITIONS.items()
    }
    hands = ferraris.Handling(gravity_sd=1e-4, tilt=TILT)
    device = ferraris.mems(rng)
    made = ferraris.record(
        device, hands, rng, trials=DEVICES, rate_hz=20.0, hold_seconds=6.0, faces=faces, turns={}
    )
    n = made.time.size
    temperature = (
        thermal.soak_temperatures(n, (-10, 20, 50))
        if soaked
        else thermal.temperature_ramp(n, 0, 40)
    )
    warm = thermal.draw(rng, DEVICES)
    data = thermal.warm_imu_readings(device, made.data, warm, temperature)[..., :3]
    sensor = METHODS["six_position"].prepare(imu().select_axes("f"), also=BOTH)
    recording = Recording(made.time, data, sensor.channels, ("m/s²",) * 3, temperature=temperature)
    steps = [make_hold(label, up) for label, up in faces.items()]
    marks = [Mark(label, *span) for label, span in made.marks.items()]
    seen = average_sections(recording, sensor, marks, steps, found=True)
    assert seen.temperature is not None
    assert seen.temperature == pytest.approx(
        [temperature[mark.start : mark.stop].mean() for mark in marks]
    )
    found = ml(seen, sensor, make_bench(hands), steps)
    truth = known(device, warm, sensor)
    p = len(sensor.coefficients)
    assert_nees(found.value[:, :p] - truth, found.covariance[:, :p, :p])
    assert_nees(*part(found, sensor, truth))


def known(device: ferraris.Imu, warm: thermal.TemperatureSensitivity, sensor: Sensor) -> Array:
    """Return the truth of a sensor's coefficients, (trials, p)."""
    named, trials = device.coefficients(), len(warm.k0)
    return np.array(
        [
            warm.of(name) if name.endswith("_dT") else np.full(trials, named[name])
            for name in sensor.coefficients
        ]
    ).T


def in_hand(seed: int, trials: int, *, soaked: bool) -> tuple[Array, Array, Sensor]:
    """Return errors and covariance of IMUs in a hand, and their sensor."""
    rng = np.random.default_rng([seed, 8, soaked])
    device = handheld.triangular(ferraris.mems(rng, G=np.zeros((3, 3))))
    session = handheld.Session(
        latitude=0.8, gravity_sd=2e-4, positions=24, rate_hz=50.0, hold_seconds=2.0
    )
    made = handheld.record(device, session, rng, trials=trials)
    n, ends = made.time.size, made.rests
    temperature = thermal.temperature_ramp(n, 0, 40)
    if soaked:  # it changes on the way to rests 9 and 17
        edges = [0, ends[7][1], ends[8][0], ends[15][1], ends[16][0], n]
        levels = np.repeat([0.0, 20.0, 40.0], 2)
        temperature = thermal.ZERO + np.interp(np.arange(n), edges, levels)
    warm = thermal.draw(rng, trials)
    sensor = METHODS["multi_position"].prepare(imu(), also=ALL)
    marks = [Mark(f"r{k:02d}", a + 5, b - 5) for k, (a, b) in enumerate(ends)]
    plate = Hand(Measured(session.gravity, session.gravity_sd), session.latitude, timebase=0.0)
    found: list[Estimate] = []
    for data in thermal.warm_imu_readings(device, made.data, warm, temperature):
        units = ("m/s²",) * 3 + ("rad/s",) * 3
        recording = Recording(made.time, data, sensor.channels, units, temperature=temperature)
        seen = average_sections(
            recording, sensor, marks, holds_from_marks(marks), by_hand=True, found=True
        )
        seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
        estimate = METHODS["multi_position"].estimator("joint")(
            seen, sensor, plate, holds_from_observations(seen, sensor)
        )
        assert estimate.converged
        found.append(estimate)
    p = len(sensor.coefficients)
    truth = known(device, warm, sensor)
    error = np.array([one.value[:p] for one in found]) - truth
    return error, np.array([one.covariance[:p, :p] for one in found]), sensor


def on_table(
    seed: int, trials: int, method: str, *, soaked: bool, hz: float = 25.0
) -> tuple[Array, Array, Sensor]:
    """Return errors and covariance of IMUs on a turntable, and their sensor."""
    rng = np.random.default_rng([seed, 9, soaked])
    made = turntable.draw(2 * seed + soaked, trials, PATH, table=SMOOTH, hz=hz)
    n = made.time.size
    temperature = (
        thermal.soak_temperatures(n, (0, 40)) if soaked else thermal.temperature_ramp(n, 0, 40)
    )
    warm = thermal.draw(rng, trials)
    hot = thermal.warm_turntable_recordings(made, warm, temperature)
    sensor = turntable_cases.sensor(turntable.T, *ALL)
    seen = turntable_cases.observations(hot, sensor)
    assert seen.track is not None
    rows = np.array([temperature[made.labels == label].mean() for label in seen.labels])
    seen = replace(seen, track=replace(seen.track, temperature=temperature), temperature=rows)
    steps = turntable_cases.steps(PATH, seen.labels)
    found = METHODS[method].estimator("")(seen, sensor, turntable_cases.BENCH, steps)
    error, covariance = turntable_cases.errors(found, made, sensor)
    for k, name in enumerate(sensor.coefficients):
        if name.endswith("_dT"):
            error[:, k] -= warm.of(name)
    return error, covariance, sensor


def assert_each_within(error: Array, covariance: Array, sensor: Sensor) -> None:
    """Fail where a coefficient of temperature of one device is off by more than 4 u."""
    at = [k for k, name in enumerate(sensor.coefficients) if name.endswith("_dT")]
    u = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert (np.abs(error / u)[:, at] < 4).all()


@pytest.mark.slow
def test_an_imu_in_a_hand_finds_biases_and_scales_against_temperature():
    assert_each_within(*in_hand(4, 2, soaked=False))


@pytest.mark.evidence
@pytest.mark.parametrize("method", [evidence("turntable_kalman"), "turntable_trajectory"])
def test_an_imu_on_a_turntable_finds_biases_and_scales_against_temperature(method: str):
    assert_each_within(*on_table(4, 1, method, soaked=True, hz=50.0))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "devices"), sampled(16, DEVICES))
def test_imus_in_a_hand_err_by_what_they_state(seed: int, devices: int):
    halves = [in_hand(seed, devices // 2, soaked=soaked) for soaked in (True, False)]
    error = np.concatenate([half[0] for half in halves])
    covariance = np.concatenate([half[1] for half in halves])
    assert_nees(error, covariance)
    at = [k for k, name in enumerate(halves[0][2].coefficients) if name.endswith("_dT")]
    assert_nees(error[:, at], covariance[:, at][:, :, at])


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "devices"), sampled(40, DEVICES))
def test_imus_followed_on_a_turntable_err_by_what_they_state(seed: int, devices: int):
    halves = [
        on_table(seed, devices // 2, "turntable_kalman", soaked=soaked) for soaked in (True, False)
    ]
    error = np.concatenate([half[0] for half in halves])
    covariance = np.concatenate([half[1] for half in halves])
    for kind in "ag":
        names = halves[0][2].coefficients
        at = [k for k, name in enumerate(names) if name[0] == kind]
        assert_nees(error[:, at], covariance[:, at][:, :, at])
        at = [k for k in at if names[k].endswith("_dT")]
        assert_nees(error[:, at], covariance[:, at][:, :, at])


@pytest.mark.slow
def test_what_follows_the_temperature_is_a_suspect_on_a_turntable():
    nothing = np.zeros((1, 3))
    strong = thermal.TemperatureSensitivity(
        nothing, nothing, nothing + 30 * turntable.DEG_H, nothing
    )
    made = turntable.draw(3, 1, PATH, table=SMOOTH, hz=25.0)
    temperature = thermal.temperature_ramp(made.time.size, 0, 40)
    sensor = turntable_cases.sensor(turntable.T)
    seen = turntable_cases.observations(
        thermal.warm_turntable_recordings(made, strong, temperature), sensor
    )
    assert seen.track is not None
    one = replace(
        seen, mean=seen.mean[0], track=replace(seen.track.trial(0), temperature=temperature)
    )
    steps = turntable_cases.steps(PATH, seen.labels)
    found = METHODS["turntable_kalman"].estimator("")(one, sensor, turntable_cases.BENCH, steps)
    by_name = {score.name: score.chi2 for score in found.score_tests.scores}
    assert by_name["bias_dT"] > 0.9 * max(by_name.values())
    silent = replace(one, track=seen.track.trial(0))
    told = METHODS["turntable_kalman"].estimator("")(silent, sensor, turntable_cases.BENCH, steps)
    assert not [score for score in told.score_tests.scores if "_dT" in score.name]


@pytest.mark.slow
def test_what_follows_the_temperature_is_a_suspect_in_a_hand():
    rng = np.random.default_rng(3)
    device = handheld.triangular(ferraris.mems(rng, G=np.zeros((3, 3))))
    session = handheld.Session(positions=18, rate_hz=50.0, hold_seconds=2.0)
    made = handheld.record(device, session, rng)
    temperature = thermal.temperature_ramp(made.time.size, 0, 40)
    nothing = np.zeros((1, 3))
    strong = thermal.TemperatureSensitivity(
        nothing, nothing, nothing + 300 * turntable.DEG_H, nothing
    )
    data = thermal.warm_imu_readings(device, made.data, strong, temperature)[0]
    sensor = METHODS["multi_position"].prepare(imu())
    marks = [Mark(f"r{k:02d}", a + 5, b - 5) for k, (a, b) in enumerate(made.rests)]
    recording = Recording(
        made.time, data, sensor.channels, ("m/s²",) * 3 + ("rad/s",) * 3, temperature=temperature
    )
    seen = average_sections(
        recording, sensor, marks, holds_from_marks(marks), by_hand=True, found=True
    )
    seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
    solve = METHODS["multi_position"].estimator("joint")
    plate = Hand(Measured(session.gravity, 0.0), None)
    found = solve(seen, sensor, plate, holds_from_observations(seen, sensor))
    by_name = {score.name: score.chi2 for score in found.score_tests.scores}
    assert by_name["bias_dT"] > 0.9 * max(by_name.values())
    again = solve(
        replace(seen, temperature=None), sensor, plate, holds_from_observations(seen, sensor)
    )
    assert not [score for score in again.score_tests.scores if "_dT" in score.name]
