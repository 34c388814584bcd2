"""An accelerometer on a dividing head from the physics alone: nothing of inercal is imported.

The spindle lies level along −y of the room, z is up. Turned by ψ about the spindle the case's own
axes are I = (cos ψ, 0, sin ψ) and P = (−sin ψ, 0, cos ψ); what holds the accelerometer against
gravity is (0, 0, g).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Device:
    """Reading = k0 + (1 + k1) a + k2 a² + k3 a³ + kip a p, everything in units of g.

    `turned` is an accelerometer whose I and P are both turned by `delta`, rad, in its case;
    otherwise it feels the case's axes and reads delta · p besides: the same to first order.
    """

    k0: float = 0.0
    k1: float = 0.0
    delta: float = 0.0
    k2: float = 0.0
    kip: float = 0.0
    k3: float = 0.0
    turned: bool = False

    def reading(self, angle: Array, gravity: Array | float = 1.0) -> Array:
        """Return readings, in g, at true angles of the spindle, rad, and gravity in g."""
        psi = angle + (self.delta if self.turned else 0.0)
        i = np.stack([np.cos(psi), np.zeros_like(psi), np.sin(psi)], axis=-1)
        p = np.stack([-np.sin(psi), np.zeros_like(psi), np.cos(psi)], axis=-1)
        held = np.array([0.0, 0.0, 1.0])
        a, b = gravity * (i @ held), gravity * (p @ held)
        beside = 0.0 if self.turned else self.delta * b
        return (
            self.k0 + (1 + self.k1) * a + beside + a**2 * (self.k2 + self.k3 * a) + self.kip * a * b
        )


@dataclass(frozen=True)
class Scale:
    """A dividing head: its angle errs by Σ sin[h] sin hθ + cos[h] cos hθ, rad."""

    sin: Mapping[int, float] = field(default_factory=dict[int, float])
    cos: Mapping[int, float] = field(default_factory=dict[int, float])

    def true(self, nominal: Array) -> Array:
        """Return the true angle at nominal ones, rad."""
        error = np.zeros_like(nominal)
        for h, size in self.sin.items():
            error = error + size * np.sin(h * nominal)
        for h, size in self.cos.items():
            error = error + size * np.cos(h * nominal)
        return nominal + error


def amplitudes(reading: Array, highest: int) -> tuple[Array, Array]:
    """Return the sine and cosine amplitudes 0 … highest of readings at 2πk/n, by the FFT."""
    spectrum = np.fft.rfft(reading) / len(reading) * 2
    spectrum[0] /= 2
    return -spectrum.imag[: highest + 1], spectrum.real[: highest + 1]


def bound(mean: Array, design: Array, covariance: Array) -> Array:
    """Return the Cramér-Rao bound of parameters whose readings are Gaussian about `mean`.

    design : (r, p) derivative of the mean; covariance : (r, r) of the readings.
    """
    assert len(mean) == len(design)
    return np.asarray(np.linalg.inv(design.T @ np.linalg.solve(covariance, design)), dtype=float)
