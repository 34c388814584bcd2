"""Devices of the independent generator, calibrated by the methods of inercal from tables of means.

`recorded` makes the readings: a magnetometer with accelerometers, and with gyros whose samples
between the rests are simulated too. `calibrated` estimates accelerometers and gyros with a method,
and adds the magnetometers, as a calibration from a run file does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tests.magnetometer import generator as sim

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration.verdict import Verdict, verdict
from inercal.estimation import Estimate
from inercal.methods import METHODS, Fit
from inercal.physics.plan import Hold
from inercal.physics.sensors import Sensor, axes_along, imu
from inercal.recordings import Observations, Transitions
from inercal.recordings.magnetic import MagneticReadings

GRAVITY = 9.80665, 1e-5  # m/s², the stated value and its uncertainty
FIELD_SD, DIP_SD = 0.3e-6, np.radians(0.5)  # of the stated strength, T, and the stated dip
TILT = np.radians(0.5)  # of a face
LATITUDE = np.radians(52.5)
EARTH = 7.292115e-5 * np.array([np.cos(LATITUDE), 0.0, np.sin(LATITUDE)])  # north, west, up, rad/s
RATE_HZ, TURN, REST = 50.0, 2.0, 2.0  # samples of the gyros; duration of a turn and of a rest, s
GYRO_NOISE = sim.RANDOM_WALK * np.sqrt(RATE_HZ)  # of a sample, rad/s
FIELD_NAMES = tuple(f"m{i}.{q}" for i in "xyz" for q in ("bias", "scale", "delta_o", "delta_p"))
FACES = {
    (x, y, z): f"{'xyz'[int(np.argmax(np.abs([x, y, z])))]}_{'pa'[x + y + z < 0]}"
    for x, y, z in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
}


@dataclass(frozen=True)
class Calibrated:
    """A device, the sensor of its calibration and the estimate of all axes."""

    own: sim.Device
    sensor: Sensor
    estimate: Estimate

    @property
    def judged(self) -> Verdict:
        """The verdict without findings about a recording."""
        return verdict(self.estimate, self.sensor, ())

    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of the magnetometer's coefficients and the dip, and the covariance.

        If the strength is not stated, the coefficients are relative to the mean scale.
        """
        stated = not any("strength of the field is not stated" in n for n in self.estimate.notes)
        d = self.own.d if stated else self.own.d / np.mean(np.diag(self.own.d))
        true = dict(zip(FIELD_NAMES, coefficients(d, self.own.o), strict=True))
        true["dip"] = self.own.dip
        if not stated:
            del true["mx.scale"]  # the mean of the scales is zero
        at = [self.estimate.names.index(name) for name in true]
        error = self.estimate.value[at] - np.array([*true.values()])
        return error, self.estimate.covariance[np.ix_(at, at)]


def calibrated(
    rng: np.random.Generator,
    attitude: np.ndarray,
    own: sim.Device,
    *,
    method: str = "multi_position",
    gyros: bool = False,
    strength: bool = True,
    dip: bool = False,
    noise: float = 1.0,
    **disturbed: Any,
) -> Calibrated:
    """Return the calibration of a device from rests in these attitudes, (n, 3, 3).

    With `noise` 0 the readings are exact, although their stated noise is the same. The stated
    strength and dip are drawn with their uncertainties. `disturbed` is that of `generator.rests`.
    """
    n = len(attitude)
    data = sim.rests(rng, attitude, own, noise=noise, **disturbed)
    m, b = sim.accelerometer(0.005 * rng.standard_normal(9))
    f = sim.G * attitude[:, 2] @ m.T + b + noise * sim.SIGMA_F * rng.standard_normal((n, 3))
    stated = own.strength + noise * FIELD_SD * rng.standard_normal()
    angle = own.dip + noise * DIP_SD * rng.standard_normal()
    bench = Hand(
        Measured(sim.G + noise * GRAVITY[1] * rng.standard_normal(), GRAVITY[1]),
        LATITUDE,
        tilt=TILT,
        field=Measured(stated, FIELD_SD) if strength else None,
        dip=Measured(angle, DIP_SD) if dip else None,
        hemisphere="north",
    )
    steps = _steps(attitude, method)
    chosen = METHODS[method]
    inertial = imu("nine") if gyros else Sensor("nine", axes_along("xyz", "f", "a"))
    sensor = chosen.prepare(inertial)
    field = Sensor("nine", axes_along("xyz", "m", "m"))
    field = field.with_coefficients("bias", "scale", "misalignment")
    mean, variance = f, np.full((n, 3), sim.SIGMA_F**2)
    transitions = None
    if gyros:
        rates, transitions = _gyros(rng, attitude, noise)
        mean = np.hstack([f, rates])
        samples = REST * RATE_HZ
        variance = np.hstack([variance, np.full((n, 3), GYRO_NOISE**2 / samples)])
    time = np.asarray(np.arange(n) * (REST + TURN), dtype=np.float64)
    seen = Observations(
        tuple(step.label for step in steps),
        mean,
        variance[:, :, None] * np.eye(len(sensor.axes)),
        np.full(n, REST),
        np.full(n, int(REST * RATE_HZ)),
        time,
        sensor.channels,
        transitions=transitions,
        timed=gyros,
        magnetic=MagneticReadings(
            field.channels,
            np.arange(n),
            data.reading,
            np.tile(sim.SIGMA_M**2 * np.eye(3), (n, 1, 1)),
            time,
            np.ones(n),
            np.zeros((3, 3)),
        ),
    )
    name, estimator = next(iter(chosen.estimators.items()))
    estimate = estimator(seen, sensor, bench, steps)
    fit = Fit(name, sensor, bench, seen, steps, (), estimate)
    assert chosen.add_magnetometers is not None
    whole, _ = chosen.add_magnetometers(fit, field)
    both = replace(
        sensor, axes=sensor.axes + field.axes, coefficients=sensor.coefficients + field.coefficients
    )
    return Calibrated(own, both, whole)


def coefficients(d: np.ndarray, o: np.ndarray) -> Sequence[float]:
    return [x for i in range(3) for x in (o[i], d[i, i] - 1, d[i, (i + 1) % 3], -d[i, (i + 2) % 3])]


def _steps(attitude: np.ndarray, method: str) -> tuple[Hold, ...]:
    if method == "multi_position":
        return tuple(Hold(f"rest {k + 1}", (0, 0, 1), REST) for k in range(len(attitude)))
    steps, visits = list[Hold](), dict[str, int]()
    for x, y, z in np.rint(attitude[:, 2]).astype(int).tolist():
        label = FACES[x, y, z]
        visits[label] = visits.get(label, 0) + 1
        visit = f" ({visits[label]})" if visits[label] > 1 else ""
        steps.append(Hold(f"{label}{visit}", (float(x), float(y), float(z)), REST))
    return tuple(steps)


def _gyros(
    rng: np.random.Generator, attitude: np.ndarray, noise: float
) -> tuple[np.ndarray, Transitions]:
    """Return the mean rates at the rests, (n, 3), and the samples of the turns between them.

    Each turn is about a fixed axis of the body, with a smooth rate, on the turning earth.
    """
    gain = np.eye(3) + 0.005 * rng.standard_normal((3, 3))
    bias = np.radians(0.3) * rng.standard_normal(3)
    still, moving = int(REST * RATE_HZ), int(TURN * RATE_HZ)
    part = np.arange(1, moving) / moving
    angle = part - np.sin(2 * np.pi * part) / (2 * np.pi)
    rate = (1 - np.cos(2 * np.pi * part)) / TURN
    pieces: list[np.ndarray] = []
    vectors = sim.turns_between(attitude)
    for k, one in enumerate(attitude):
        pieces.append(np.tile(EARTH @ one, (still, 1)))
        if k < len(vectors):
            way = one @ sim.rotation(angle[:, None] * vectors[k])
            pieces.append(rate[:, None] * vectors[k] + EARTH @ way)
    w = np.concatenate(pieces)
    w = w @ gain.T + bias + noise * GYRO_NOISE * rng.standard_normal(w.shape)
    first = np.arange(len(attitude)) * (still + moving - 1)
    rates = np.array([w[k : k + still].mean(axis=0) for k in first])
    begin = first[:-1]
    return rates, Transitions(
        time=np.arange(len(w)) / RATE_HZ,
        output=np.hstack([np.zeros_like(w), w]),
        rest=np.arange(len(begin)),
        start=begin,
        left=begin + still - 1,
        reached=first[1:],
        stop=first[1:] + still - 1,
    )
