"""The effect of temperature on sensors, for the other generators: imports nothing of inercal.

A device's bias and scale factor are lines in T − 20 °C; its readings are those of another generator
with the difference added, y + b_T ΔT + s_T ΔT u, u being what the axis felt. In a chamber the
temperature stands still over a soak, or rises evenly along a ramp.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.ferraris import Imu
from tests.accuracy.turntable import DEG_H, Draw

Array = NDArray[np.float64]
G0 = 9.80665
ZERO = 273.15
REFERENCE = ZERO + 20.0
FACES = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
NAMES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")


@dataclass(frozen=True, eq=False)
class TemperatureSensitivity:
    """Coefficients of temperature of (trials) devices, SI per K, (trials, 3) each."""

    k0: Array
    k1: Array
    bias: Array
    scale: Array

    def accelerometers(self, f: Array, warmth: Array) -> Array:
        """Return what is added to readings of forces (trials, n, 3) at ΔT, (n,) K."""
        return warmth[:, None] * (self.k0[:, None] + self.k1[:, None] * f)

    def gyros(self, w: Array, warmth: Array) -> Array:
        """Return what is added to readings of rates (trials, n, 3) at ΔT, (n,) K."""
        return warmth[:, None] * (self.bias[:, None] + self.scale[:, None] * w)

    def of(self, name: str) -> Array:
        """Return the truth of a coefficient such as "ax.k0_dT", (trials,)."""
        axis, _, term = name.partition(".")
        return np.asarray(getattr(self, term.removesuffix("_dT")))[:, "xyz".index(axis[-1])]


def draw(rng: np.random.Generator, trials: int) -> TemperatureSensitivity:
    """Return devices of a usual MEMS IMU: .3 mg/K, 100 ppm/K, 10 °/h/K, 100 ppm/K."""
    sizes = 0.3e-3 * G0, 100e-6, 10 * DEG_H, 100e-6
    return TemperatureSensitivity(*(size * rng.standard_normal((trials, 3)) for size in sizes))


def soak_temperatures(n: int, temperatures: tuple[float, ...]) -> Array:
    """Return the temperature of n samples, constant at one value after the other, K."""
    at = np.arange(n) * len(temperatures) // n
    return ZERO + np.array(temperatures)[at]


def temperature_ramp(n: int, first: float, last: float) -> Array:
    """Return the temperature of n samples, linear from one value (°C) to another, K."""
    return ZERO + np.linspace(first, last, n)


@dataclass(frozen=True, eq=False)
class SixFaceMeans:
    """Means of (trials) accelerometer triads on their six faces, once at each temperature.

    Parameters
    ----------
    labels : tuple of r str
    up : (r, 3) array
        As meant.
    temperature : (r,) array
        K.
    mean : (trials, r, 3) array
        m/s².
    truth : mapping of str to (trials,) array
        By name.
    """

    labels: tuple[str, ...]
    up: Array
    temperature: Array
    mean: Array
    truth: dict[str, Array]


def faces(
    rng: np.random.Generator,
    trials: int,
    temperature: Array,
    *,
    noise: float = 30e-6 * G0,
    tilt: float = 5e-4,
    gravity: tuple[float, float] = (9.81, 1e-4),
) -> SixFaceMeans:
    """Return triads set down on six faces, anew each time, at temperatures (soaks × 6,) K.

    Each time the face stands off by `tilt` about both level axes; gravity is drawn for the trial.
    """
    r = temperature.size
    up = np.tile(FACES, (r // 6, 1))
    off = rng.standard_normal((trials, r, 3)) * tilt
    level = np.cross(off, up)
    true = up + level
    true /= np.linalg.norm(true, axis=-1, keepdims=True)
    g = gravity[0] + gravity[1] * rng.standard_normal((trials, 1, 1))
    warm = draw(rng, trials)
    matrix = np.eye(3) + 0.01 * rng.standard_normal((trials, 3, 3))
    bias = 0.02 * G0 * rng.standard_normal((trials, 3))
    f = g * true
    mean = f @ matrix.swapaxes(1, 2) + bias[:, None]
    mean += warm.accelerometers(f, temperature - REFERENCE)
    mean += noise * rng.standard_normal(mean.shape)
    truth: dict[str, Array] = {}
    for i, axis in enumerate("xyz"):
        p, o = (i + 1) % 3, (i + 2) % 3
        truth |= {
            f"a{axis}.k0": bias[:, i],
            f"a{axis}.k1": matrix[:, i, i] - 1,
            f"a{axis}.delta_o": matrix[:, i, p],
            f"a{axis}.delta_p": -matrix[:, i, o],
            f"a{axis}.k0_dT": warm.k0[:, i],
            f"a{axis}.k1_dT": warm.k1[:, i],
        }
    names = [NAMES[k % 6] + (f" ({k // 6 + 1})" if k >= 6 else "") for k in range(r)]
    return SixFaceMeans(tuple(names), up, temperature, mean, truth)


def warm_turntable_recordings(made: Draw, warm: TemperatureSensitivity, temperature: Array) -> Draw:
    """Return a turntable's recordings of devices at a temperature (n,) K."""
    warmth = temperature - REFERENCE
    forces = _corrected_motion(made.forces, made.acc)
    rates = _corrected_motion(made.rates, made.gyro)
    return replace(
        made,
        forces=made.forces + warm.accelerometers(forces, warmth),
        rates=made.rates + warm.gyros(rates, warmth),
    )


def _corrected_motion(readings: Array, truth: Array) -> Array:
    """Return the specific force, but for noise, of readings (trials, n, 3) and 3 biases, then S."""
    matrix = np.eye(3) + truth[:, 3:].reshape(-1, 3, 3)
    back = np.linalg.inv(matrix).swapaxes(1, 2)
    return (readings - truth[:, None, :3]) @ back


def warm_imu_readings(
    imu: Imu, data: Array, warm: TemperatureSensitivity, temperature: Array
) -> Array:
    """Return the readings (trials, n, 6) of an IMU that depends on temperature, (n,) K."""
    warmth = temperature - REFERENCE
    f = (data[..., :3] - imu.b_a) @ np.linalg.inv(imu.M_a).T
    w = (data[..., 3:] - imu.b_g - f @ imu.G.T) @ np.linalg.inv(imu.M_g).T
    return data + np.concatenate([warm.accelerometers(f, warmth), warm.gyros(w, warmth)], axis=-1)
