"""Accelerometer triads on six faces at several temperatures: imports nothing of inercal.

    y = b(T) + [I + S(T)] f,   b to order 3, the diagonal of S to order 2, the rest to order 1

Sizes are those of a usual MEMS triad. The bias comes back from soak to soak with a scatter, and the
temperature of a soak is known to .1 K. A face stands off by a tilt that is the same in all soaks,
and by a smaller one each time the triad is set down.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G0 = 9.80665
ZERO = 273.15
REFERENCE = ZERO + 25.0
DEGREE = np.pi / 180
FACES = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
NAMES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
SOAKS = tuple(np.linspace(-40.0, 85.0, 7).tolist())
LEFT_OUT = (-30.0, -10.0, 12.0, 35.0, 55.0, 75.0)
# 1σ per axis about 25 °C, SI: bias, scale factor, misalignment by order
BIAS = (20e-3 * G0, 0.3e-3 * G0, 3e-6 * G0, 0.03e-6 * G0)
SCALE = (3000e-6, 100e-6, 0.5e-6)
MISALIGNMENT = (3e-3, 5e-6)
NOISE = 35e-6 * G0  # of a mean
REPEATABILITY = 50e-6 * G0
TEMPERATURE_SD = 0.1
GRAVITY = (9.81, 9.81 * 10e-6)
FIXTURE, PLACEMENT = 0.05 * DEGREE, 0.01 * DEGREE


@dataclass(frozen=True, eq=False)
class SoakedTriads:
    """Means of (trials) triads, r = 6 × soaks rows.

    Parameters
    ----------
    labels : tuple of r str
    up : (r, 3) array
    temperature : (r,) array
        K, as recorded.
    mean : (trials, r, 3) array
        m/s².
    bias : (4, trials, 3), matrix (3, trials, 3, 3) arrays
        Coefficients of (T − 25 °C)^k, SI.
    """

    labels: tuple[str, ...]
    up: Array
    temperature: Array
    mean: Array
    bias: Array
    matrix: Array

    def truth(self, name: str) -> Array:
        """Return a coefficient by its name, such as "ax.k0_dT2", (trials,)."""
        axis, _, term = name.partition(".")
        i = "xyz".index(axis[-1])
        base, _, order = term.partition("_dT")
        k = 0 if "_dT" not in term else int(order or 1)
        if base == "k0":
            return self.bias[k, :, i]
        column = {"k1": i, "delta_o": (i + 1) % 3, "delta_p": (i + 2) % 3}[base]
        return (-1.0 if base == "delta_p" else 1.0) * self.matrix[k, :, i, column]


def triads(
    rng: np.random.Generator, trials: int, soaks: tuple[float, ...] = SOAKS, *, fourth: float = 0.0
) -> SoakedTriads:
    """Return triads on all faces at all soaks, °C; `fourth` is a bias of order 4 at 50 K, m/s²."""
    up = np.tile(FACES, (len(soaks), 1))
    stated = np.repeat(np.array(soaks) + ZERO, 6)
    bias = np.stack([size * rng.standard_normal((trials, 3)) for size in BIAS])
    matrix = np.zeros((3, trials, 3, 3))
    across = ~np.eye(3, dtype=bool)
    for k, size in enumerate(SCALE):
        matrix[k][:, np.eye(3, dtype=bool)] = size * rng.standard_normal((trials, 3))
    for k, size in enumerate(MISALIGNMENT):
        matrix[k][:, across] = size * rng.standard_normal((trials, 6))
    of_soak = np.repeat(np.arange(len(soaks)), 6)
    off = TEMPERATURE_SD * rng.standard_normal((trials, len(soaks)))[:, of_soak]
    warmth = stated + off - REFERENCE
    fixture = np.tile(FIXTURE * rng.standard_normal((trials, 6, 3)), (1, len(soaks), 1))
    lean = fixture + PLACEMENT * rng.standard_normal((trials, up.shape[0], 3))
    true = up + np.cross(lean, up)
    true /= np.linalg.norm(true, axis=-1, keepdims=True)
    f = (GRAVITY[0] + GRAVITY[1] * rng.standard_normal((trials, 1, 1))) * true
    powers = [warmth[..., None] ** k for k in range(5)]
    mean = f + sum(powers[k] * bias[k][:, None] for k in range(4))
    mean = mean + sum(powers[k] * (f @ np.swapaxes(matrix[k], -1, -2)) for k in range(3))
    mean += fourth * rng.choice([-1.0, 1.0], (trials, 1, 3)) * powers[4] / 50.0**4
    mean += REPEATABILITY * rng.standard_normal((trials, len(soaks), 3))[:, of_soak]
    mean += NOISE * rng.standard_normal(mean.shape)
    labels = [n + (f" ({k + 1})" if k else "") for k in range(len(soaks)) for n in NAMES]
    return SoakedTriads(tuple(labels), up, stated, mean, bias, matrix)
