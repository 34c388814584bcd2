"""Perfect data of every bench, with an error of the bench in them where that is wanted."""

from dataclasses import replace
from math import radians
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from inercal.benches.turntable.attitude import ideal_readback, motion
from inercal.benches.turntable.simulation import path_profile
from inercal.estimation import Estimate, Gaussian
from inercal.methods import METHODS
from inercal.physics.plan import Position, Rotation
from inercal.physics.sensors import Noise, Sensor, imu
from inercal.recordings import Observations, Track

Array = NDArray[np.float64]
G = Measured(9.81, 1e-4)
BENCHES: tuple[Bench, ...] = (
    Hand(G, Measured(0.8, 1e-3), tilt=1e-4, turn_angle=1e-4, turn_tilt=1e-4, timebase=1e-4),
    Centrifuge(
        G, Measured(1.0, 1e-5), Measured(0.8, 1e-3), Measured(2e-7, 1e-8), rate=1e-6, tilt=1e-4
    ),
    DividingHead(G, (1e-6, 2e-6), 1e-6, autocollimator=1e-6, collimated="every", base=5e-5),
    RateTable(G, Measured(0.25, 1e-4), pose=1e-4, rate=1e-5, speed=1e-6),
    RatePlatform(G, Measured(0.8, 1e-3), 1e-5, 1e-6, 1e-6, setting=1e-5),
    Turntable(
        G,
        0.7,
        Measured(0.1, 1e-4),
        lean=2e-5,
        square=1e-5,
        harmonics=(1e-5,),
        white=1e-6,
        latency=Measured(0, 1e-4),
        clock=1e-6,
    ),
)
# Of the run file's own keys; errors without one are stated as 0 ± u.
STATED = {
    "g": "gravity",
    "radius": "radius",
    "stretch": "stretch",
    "azimuth": "azimuth",
    "latency": "latency",
}
STEP = 0.01  # s
_TURN, _RATE = radians(360), radians(30)
_UP = {
    "y_p": (0, 90, 0), "z_a": (0, 180, 0), "y_a": (0, 270, 0), "x_a": (0, 0, 90),
    "x_p": (0, 0, -90), "slanted": (90, 45, 0), "askew": (180, -45, 45),
}  # fmt: skip
PATH = (
    Position("start", (0.0, 0.0, 0.0), 30.0),
    *(Position(name, (radians(a), radians(b), radians(c)), 8.0) for name, (a, b, c) in _UP.items()),
    *(
        Rotation(f"{axis}{sign}", k, angle, _RATE, (0.0, 0.0, 0.0))
        for k, axis in enumerate("zxy")
        for sign, angle in (("+", _TURN), ("-", -_TURN))
    ),
    Position("rest", (0.0, 0.0, 0.0), 10.0),
)


class Case(NamedTuple):
    """A method with one of its estimators, what it is to find, and on what bench."""

    method: str
    estimator: str
    bench: Bench
    sensor: Sensor
    truth: Array
    steps: tuple[Any, ...]
    priors: tuple[Gaussian, ...]

    def found(self, q: dict[str, float] | None = None, bench: Bench | None = None) -> Estimate:
        """Return the estimate by a bench with its errors at q, of data of another bench."""
        made = observed(self, q or {})
        return self.by(made, bench or self.bench)

    def by(self, made: Observations, bench: Bench) -> Estimate:
        """Return the estimate of data by a bench as stated."""
        solve = METHODS[self.method].estimator(self.estimator)
        return solve(made, self.sensor, bench, self.steps, self.priors)


def case(method: str, estimator: str) -> Case:
    """Return a method's case with a sensor that errs a little in all that it finds."""
    chosen = METHODS[method]
    (bench,) = (b for b in BENCHES if isinstance(b, chosen.bench))
    whole = imu().select_axes("f") if chosen.unknown_attitudes else imu()
    if isinstance(bench, DividingHead):
        whole = mounted_sensor(axes="a" if method == "tumble" else "ab")
        whole = replace(whole, form="reference" if estimator == "fourier" else "tilted")
    if isinstance(bench, Turntable):
        quiet = tuple(replace(axis, noise=Noise(white=1e-6)) for axis in whole.axes)
        whole = replace(whole, axes=quiet)
    sensor = chosen.prepare(whole)
    p = len(sensor.coefficients)
    truth = 1e-4 * np.random.default_rng(5).normal(size=p) * sensor.unit_scale
    priors: tuple[Gaussian, ...] = ()
    if method == "dual_orthogonal":
        truth[sensor.coefficients.index("b.delta_o")] *= -1
        known = [k for k, name in enumerate(sensor.coefficients) if name[2:] in ("kip", "k3")]
        names = tuple(sensor.coefficients[k] for k in known)
        priors = (Gaussian.independent(names, truth[known], 1e-5 * sensor.unit_scale[known]),)
    if isinstance(bench, Centrifuge):
        # At tens of g a quadratic term of this size would fold the reading.
        truth[[name.endswith("k2") for name in sensor.coefficients]] *= 1e-2
    steps = PATH if isinstance(bench, Turntable) else chosen.plan()
    return Case(method, estimator, bench, sensor, truth, tuple(steps), priors)


def observed(of: Case, q: dict[str, float]) -> Observations:
    """Return what is read with the bench's errors at q, those missing as stated, without noise."""
    declared = of.bench.nuisances(of.steps, of.sensor)
    values = {name: np.array(p.value) for name, p in declared.items()}
    values |= {name: np.array(value) for name, value in q.items()}
    steps, sensor = of.steps, of.sensor
    if isinstance(of.bench, Turntable):
        return _followed(of, values)
    assert isinstance(of.bench, MeanBench)
    made = of.bench.mean_motion(steps, values).motion
    r, m = len(steps), len(sensor.axes)
    return Observations(
        tuple(step.label for step in steps),
        sensor.forward(made, of.truth),
        np.tile(1e-10 * np.eye(m), (r, 1, 1)),
        np.array([step.seconds for step in steps]),
        np.full(r, 1000),
        np.arange(r, dtype=float),
        sensor.channels,
    )


def _followed(of: Case, values: dict[str, Array]) -> Observations:
    assert isinstance(of.bench, Turntable)
    way = path_profile(of.bench, of.steps)
    time = np.arange(0, way.ends[-1], STEP)
    angles, rates, accelerations = way.evaluate(time)
    late = time * (1 - values["clock"]) - values["latency"]
    section = np.searchsorted(way.ends, time)
    positions = [step.label for step in of.steps if isinstance(step, Position)]
    held = [k for k, label in enumerate(way.labels) if label in positions]
    hold = np.where(np.isin(section, held), section, -1)
    made = motion(of.bench, angles, rates, accelerations, values)
    reading = of.sensor.forward(made, of.truth)
    read = ideal_readback(of.bench, way.evaluate(np.clip(late, 0, time[-1]))[0], values)
    at = [np.flatnonzero(section == way.labels.index(step.label)) for step in of.steps]
    m = len(of.sensor.axes)
    return Observations(
        tuple(step.label for step in of.steps),
        np.array([reading[rows].mean(axis=0) for rows in at]),
        np.tile(1e-10 * np.eye(m), (len(at), 1, 1)),
        np.array([rows.size * STEP for rows in at]),
        np.array([rows.size for rows in at]),
        np.array([time[rows].mean() for rows in at]),
        of.sensor.channels,
        track=Track(time, reading, read, hold),
    )
