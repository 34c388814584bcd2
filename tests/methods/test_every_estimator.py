"""Every method with each of its estimators recovers a sensor, from means of perfect positions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.base_seeds import slow
from tests.magnetometer import generator
from tests.magnetometer.calibrations import FIELD_NAMES, coefficients
from tests.magnetometer.motion import motion
from tests.magnetometer.motion_calibrations import BIASES, calibrated_motion
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import (
    Bench,
    Centrifuge,
    DividingHead,
    Hand,
    MeanBench,
    RatePlatform,
    RateTable,
    Turntable,
)
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.benches.turntable.attitude import motion as on_turntable
from inercal.benches.turntable.simulation import path_profile
from inercal.estimation import Gaussian
from inercal.methods import METHODS
from inercal.physics.motion import Motion
from inercal.physics.plan import Position, TableStep
from inercal.physics.sensors import Noise, Sensor, imu
from inercal.physics.sensors.affine import to_affine
from inercal.recordings import Observations, Track

BENCH = Hand(Measured(9.81, 1e-4), np.pi / 2, tilt=1e-4, turn_angle=1e-4, turn_tilt=1e-4)
TABLE = RateTable(Measured(9.81, 1e-4), Measured(0.25, 1e-6), pose=1e-4, speed=1e-6)
PLATFORM = RatePlatform(
    Measured(9.81, 1e-4),
    Measured(np.pi / 2, 0.0),
    1e-6,
    1e-6,
    1e-6,
    setting=1e-5,
    attitude=1e-5,
    mounting=1e-5,
)
HEAD = DividingHead(Measured(9.81, 1e-4), autocollimator=1e-6, collimated="every")
ARM = Centrifuge(Measured(9.81, 1e-4), Measured(1.0, 1e-5), Measured(np.pi / 2, 0.0), rate=1e-6)
AXES = Turntable(
    Measured(9.81, 1e-4), 0.7, Measured(0.1, 1e-4), latency=Measured(0, 1e-4), white=1e-8
)


def bench_of(method: str) -> Bench:
    all_benches = (BENCH, ARM, HEAD, TABLE, PLATFORM, AXES)
    (bench,) = (b for b in all_benches if isinstance(b, METHODS[method].bench))
    return bench


def perfect(sensor: Sensor, c: np.ndarray, method: str) -> Observations:
    steps = METHODS[method].plan()
    bench = bench_of(method)
    if METHODS[method].follows_rest:
        return warmed(sensor, c)
    if isinstance(bench, Turntable):
        return followed(bench, steps, sensor, c)
    assert isinstance(bench, MeanBench)
    motion = bench.mean_motion(steps, {}).motion
    m = len(sensor.axes)
    return Observations(
        tuple(step.label for step in steps),
        sensor.forward(motion, c),
        np.broadcast_to(1e-10 * np.eye(m), (len(steps), m, m)),
        np.array([step.seconds for step in steps]),
        np.full(len(steps), 1000),
        np.arange(len(steps), dtype=float),
        sensor.channels,
    )


def warmed(sensor: Sensor, c: np.ndarray) -> Observations:
    time = np.arange(0, 3600.0, 0.5)
    kelvin = 293.15 + 30 * np.sin(2 * np.pi * time / 3600)
    resting = Motion(np.array([[0.0, 0.0, 9.81]]), dT=kelvin - sensor.reference_temperature)
    reading = sensor.forward(resting, c)
    m, still = len(sensor.axes), np.zeros(time.size, dtype=np.int64)
    return Observations(
        ("rest",),
        reading.mean(axis=0)[None],
        np.zeros((1, m, m)),
        np.array([3600.0]),
        np.array([time.size]),
        np.array([1800.0]),
        sensor.channels,
        track=Track(time, reading, np.zeros((time.size, 0)), still, kelvin),
    )


def followed(
    bench: Turntable, steps: Sequence[TableStep], sensor: Sensor, c: np.ndarray
) -> Observations:
    # A rate whose slope jumps is not known between two samples.
    limits = [replace(one, jerk=np.radians(300.0)) for one in bench.axis_motion_limits]
    smooth = replace(bench, limits=tuple(limits))
    way = path_profile(smooth, steps)
    time = np.arange(0, way.ends[-1], 0.01)
    angles, *rates = way.evaluate(time)
    section = np.searchsorted(way.ends, time)
    positions = [step.label for step in steps if isinstance(step, Position)]
    held = [k for k, label in enumerate(way.labels) if label in positions]
    hold = np.where(np.isin(section, held), section, -1)
    made = on_turntable(bench, angles, rates[0], rates[1], {})
    reading = sensor.forward(made, c)
    m, labels = len(sensor.axes), [step.label for step in steps]
    at = [np.flatnonzero(section == way.labels.index(label)) for label in labels]
    return Observations(
        tuple(labels),
        np.array([reading[rows].mean(axis=0) for rows in at]),
        np.tile(1e-10 * np.eye(m), (len(labels), 1, 1)),
        np.array([rows.size / 100 for rows in at]),
        np.array([rows.size for rows in at]),
        np.array([time[rows].mean() for rows in at]),
        sensor.channels,
        track=Track(time, reading, angles, hold),
    )


# The truth comes out without noise in test_ship_global, test_systematic, test_systematic_filter and
# test_turntable_trajectory too.
SHOWN_ELSEWHERE = ("global", "batch", "kalman", "trajectory")
# The estimator of `field_and_rates` only states what is known before; see the next test.
CASES = [
    slow(name, estimator) if estimator in SHOWN_ELSEWHERE else (name, estimator)
    for name, m in METHODS.items()
    if "m" not in m.needs
    for estimator in m.estimators
]


@pytest.mark.parametrize(("method", "estimator"), CASES)
def test_each_estimator_recovers_the_sensor(method: str, estimator: str):
    chosen = METHODS[method]
    # Free attitudes tell of the gyros only by the way between them, which means do not hold.
    whole = imu().select_axes("f") if chosen.unknown_attitudes else imu()
    if chosen.bench is DividingHead:
        whole = mounted_sensor(axes="a" if method == "tumble" else "ab")
        whole = replace(whole, form="reference" if estimator == "fourier" else "tilted")
    if chosen.bench is Turntable or chosen.follows_rest:
        # Navigation through a turn that starts between two samples is less exact than its noise.
        white = 1e-5 if method == "systematic" else 1e-7
        quiet = [replace(axis, noise=Noise(white=white)) for axis in whole.axes]
        whole = replace(whole, axes=tuple(quiet))
    sensor = chosen.prepare(whole)
    p = len(sensor.coefficients)
    c = 0.02 * np.random.default_rng(5).normal(size=p) * sensor.unit_scale
    priors: list[Gaussian] = []
    if method == "dual_orthogonal":
        c *= 0.01  # the patent's way is exact for small errors, to their squares
        c[sensor.coefficients.index("b.delta_o")] = -c[sensor.coefficients.index("a.delta_o")]
        known = [k for k, name in enumerate(sensor.coefficients) if name[2:] in ("kip", "k3")]
        names = tuple(sensor.coefficients[k] for k in known)
        priors = [Gaussian.independent(names, c[known], 1e-3 * sensor.unit_scale[known])]
    if chosen.bench is Centrifuge:
        # At tens of g a quadratic term of this size would fold the reading.
        c[[name.endswith("k2") for name in sensor.coefficients]] *= 1e-3
    if method == "systematic":  # an arm of its natural size is 10 m long
        c[[".arm" in name for name in sensor.coefficients]] *= 1e-2
    made = perfect(sensor, c, method)
    found = chosen.estimator(estimator)(made, sensor, bench_of(method), chosen.plan(), priors)
    if estimator == "global":
        # Norms alone: the triad may come out turned.
        models = [to_affine(sensor, x)[0].matrix for x in (found.value[:p], c)]
        squares = [matrix.T @ matrix for matrix in models]
        np.testing.assert_allclose(squares[0], squares[1], atol=1e-4)
        return
    # At a pole the vertical part of earth's rate, 7e-5 rad/s, is all that classical leaves out.
    # The closed formulas of the centrifuge fold what they cut off into k0, k1 and k2.
    left_out = {"classical": 1e-4, "series": 1e-2, "series_weighted": 1e-2, "paper": 1e-2}
    atol = left_out.get(estimator, 1e-6)
    if chosen.bench is Turntable:
        # Rates are linear between samples, which is not so where an axis starts; the others have
        # room for that besides the readback.
        atol = {"paper": 2e-5, "batch": 5e-6}.get(estimator, 1e-6)
    np.testing.assert_allclose(
        found.value[:p] / sensor.unit_scale, c / sensor.unit_scale, atol=atol
    )


@pytest.mark.slow
def test_gyros_and_magnetometers_are_recovered_from_a_perfect_motion():
    rng = np.random.default_rng(5)
    own = generator.device(rng)
    one = calibrated_motion(rng, motion(rng, own, noise=0.0))
    error, covariance = one.errors()
    names = [*FIELD_NAMES, *BIASES, "delay"]
    found = dict(zip(names, (error / np.sqrt(np.diagonal(covariance))).tolist(), strict=True))
    # The stated strength is drawn; it scales all fields, so that other errors are proportional.
    strength = one.estimate.value[one.estimate.names.index("strength")]
    matrix = own.d * own.strength / strength
    for name, value in zip(FIELD_NAMES, coefficients(matrix, own.o), strict=True):
        k = one.estimate.names.index(name)
        found[name] = float((one.estimate.value[k] - value) / one.estimate.std[k])
    assert max(map(abs, found.values())) < 0.1, found


def test_classical_refuses_the_tilted_form_that_it_does_not_find():
    sensor = METHODS["six_position"].prepare(Sensor("t", imu().axes, form="tilted"))
    made = perfect(sensor, np.zeros(len(sensor.coefficients)), "six_position")
    with refused(key="[sensor] form"):
        METHODS["six_position"].estimator("classical")(
            made, sensor, BENCH, METHODS["six_position"].plan()
        )
