"""Simulate the turntable with an IMU of grade T.

The bench model gives the motion and the readback (`simulate_turntable_motion`), and the sensor
model gives the readings, with white noise and a Gauss–Markov drift of the biases. The filters know
the sizes of the table's errors; they know only that the delay is within 5 ms.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.simulation import simulate_turntable_motion
from inercal.physics.motion import Motion
from inercal.physics.plan import Position, TableStep
from inercal.physics.sensors import G0, Noise, Sensor
from inercal.physics.sensors.catalogue import imu
from inercal.pipeline.run_simulation import read_out
from inercal.recordings import Observations, Track

RATE_HZ = 100.0
ARCSEC = pi / 648_000  # rad
DEG_MIN, DEG_H = radians(1) / 60, radians(1) / 3600  # rad/s
PPM = 1e-6
MICRO_G = 1e-6 * G0
ARW = 0.1  # °/√h
CORRELATION = 200.0  # s
GYRO = Noise(white=radians(ARW) / 60, bias_instability=0.5 * DEG_H, correlation=CORRELATION)
ACCELEROMETER = Noise(white=60 * MICRO_G, bias_instability=15 * MICRO_G, correlation=CORRELATION)
SIZES = {  # 1σ of the devices, SI
    "bias": radians(0.3),
    "scale": 5000e-6,
    "k0": 10e-3 * G0,
    "k1": 5000e-6,
    "delta_o": radians(15 / 60),
    "delta_p": radians(15 / 60),
}
LATENCY, LARGE_LATENCY = 2e-3, 20e-3  # s
G_SENSITIVITY = 10 * DEG_H / G0  # for each of nine coefficients
TABLE = Turntable(
    Measured(G0, 0.0),
    radians(38),
    Measured(0.0, radians(0.1)),
    lean=5 * ARCSEC,
    square=2 * ARCSEC,
    harmonics=(2 / sqrt(2) * ARCSEC, 1 / sqrt(2) * ARCSEC),
    white=0.5 * ARCSEC,
    latency=Measured(LATENCY, 0.0),
)
ASSUMED_TABLE = replace(TABLE, latency=Measured(0.0, 5e-3))
_SETTLING_SECONDS = 0.25  # s by which a hold is shortened at both ends


def tactical_imu(*also: str) -> Sensor:
    """Return the IMU with grade-T noise and with bias, scale and misalignment to estimate."""
    result = imu()
    noise = {"w": GYRO, "f": ACCELEROMETER}
    axes = tuple(replace(axis, noise=noise[axis.measures]) for axis in result.axes)
    return replace(result, axes=axes).with_coefficients("bias", "scale", "misalignment", *also)


SENSOR = tactical_imu()


@dataclass(frozen=True, eq=False)
class TurntableCase:
    """One simulated device on one path.

    Parameters
    ----------
    track : Track
        Recording that the filters process.
    labels : (n,) array of str
        Step of each sample; empty during a move between steps.
    truth : (24,) array
        True coefficients of `SENSOR`, in SI units.
    bench_errors : dict of str to float
        Errors of the table, in SI units.
    motion : Motion
        Specific force f and angular rate ω, (n, 3) each.
    """

    track: Track
    labels: NDArray[np.str_]
    truth: Array
    bench_errors: dict[str, float]
    motion: Motion

    def of(self, kind: str) -> Array:
        """Return the true coefficients of the gyros ("g") or the accelerometers ("a"), (12,)."""
        return self.truth[[name[0] == kind for name in SENSOR.coefficients]]

    def first(self, label: str) -> int:
        """Return the last sample before a step."""
        return max(int(np.flatnonzero(self.labels == label)[0]) - 1, 0)

    def with_g_sensitivity(self, seed: int) -> "TurntableCase":
        """Return the same device with g-sensitive gyros, nine coefficients of 10 °/h/g."""
        mat = G_SENSITIVITY * np.random.default_rng([seed, 2]).standard_normal((3, 3))
        reading = self.track.reading.copy()
        reading[:, 3:] += self.motion.f @ mat.T
        return replace(self, track=replace(self.track, reading=reading))


def simulate(steps: Sequence[TableStep], seed: int, table: Turntable = TABLE) -> TurntableCase:
    """Simulate one device, drawn with the seed, on a path of the table."""
    rng = np.random.default_rng([seed, 1])
    sd = np.array([SIZES[CoefficientName(name).term] for name in SENSOR.coefficients])
    truth = sd * rng.standard_normal(sd.size)
    done = simulate_turntable_motion(table, steps, RATE_HZ, rng)
    said = done.readback
    motion = Motion(done.motion.f[0], done.motion.w[0])
    white = tuple(
        replace(axis, noise=replace(axis.noise, bias_instability=0.0)) for axis in SENSOR.axes
    )
    drift = _gauss_markov_drift(
        rng, np.array([a.noise.bias_instability for a in SENSOR.axes]), done.time.size
    )
    reading = read_out(replace(SENSOR, axes=white), motion, truth, RATE_HZ, rng, drift)
    angles = np.stack([one[0] for one in said.values()], axis=-1)
    track = Track(done.time, reading, angles, _hold_numbers(steps, done.labels))
    drawn = {name: float(values[0]) for name, values in done.bench_errors.items()}
    return TurntableCase(track, done.labels, truth, drawn, motion)


def _gauss_markov_drift(rng: np.random.Generator, sd: Array, n: int) -> Array:
    """Return Gauss–Markov processes, (n, m) SI, which are stationary from the start."""
    kept = np.exp(-1 / (RATE_HZ * CORRELATION))
    noise = np.sqrt(1 - kept**2) * rng.standard_normal((n, sd.size))
    noise[0] /= np.sqrt(1 - kept**2)
    return sd * np.asarray(lfilter([1.0], [1.0, -kept], noise, axis=0), dtype=float)


def _hold_numbers(steps: Sequence[TableStep], labels: NDArray[np.str_]) -> NDArray[np.int64]:
    hold, cut = np.full(labels.size, -1), round(_SETTLING_SECONDS * RATE_HZ)
    for k, step in enumerate(one for one in steps if isinstance(one, Position)):
        hold[np.flatnonzero(labels == step.label)[cut:-cut]] = k
    return hold


def step_means(case: TurntableCase, steps: Sequence[TableStep]) -> Observations:
    """Return the means over steps, with their numbers of samples."""
    at = [np.flatnonzero(case.labels == step.label) for step in steps]
    seconds = np.array([one.size for one in at]) / RATE_HZ
    white = np.diag([axis.noise.white**2 for axis in SENSOR.axes])
    return Observations(
        tuple(step.label for step in steps),
        np.stack([case.track.reading[one].mean(axis=0) for one in at]),
        white / seconds[:, None, None],
        seconds,
        np.array([one.size for one in at]),
        np.array([case.track.time[one].mean() for one in at]),
        SENSOR.channels,
        track=case.track,
    )
