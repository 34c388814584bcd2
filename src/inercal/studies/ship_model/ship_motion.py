"""A ship model in waves: the specific force on an accelerometer.

Axes of the model: x forward, y to port, z up. It heaves by z, pitches by θ (bow down) and rolls by
φ (to starboard)::

    R = R_y(θ) R_x(φ),   ω = (φ', θ' cos φ, −θ' sin φ)
    f = Rᵀ (0, 0, z'' + g) + ω' × ℓ + ω × (ω × ℓ)

ℓ leads from the centre of the motion to the accelerometer. In regular waves each motion is one
sine of the wave's period. In irregular ones each has the spectrum of Bretschneider,

    S(ω) ∝ ω⁻⁵ exp(−1.25 (ω_p/ω)⁴),   0.6 ω_p < ω < 1.8 ω_p

its amplitude being the significant one, twice the root of the variance.
"""

from dataclasses import dataclass
from math import pi, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import G0

_COMPONENTS = 60
_FREQUENCY_BAND = (0.6, 1.8)  # of ω_p; a model does not follow waves much shorter than itself


@dataclass(frozen=True)
class OscillationParameters:
    """One motion: amplitude, m or rad; period, s; and phase in regular waves, rad."""

    amplitude: float
    period: float
    phase: float = 0.0


@dataclass(frozen=True)
class WaveConditions:
    """How a model moves, and where on it the accelerometer sits, m."""

    heave: OscillationParameters
    pitch: OscillationParameters
    roll: OscillationParameters
    place: tuple[float, float, float]
    regular: bool


SENSOR_POSITION = (1.2, 0.1, 0.15)  # m
REGULAR_WAVES = WaveConditions(
    OscillationParameters(0.04, 1.6),
    OscillationParameters(radians(3), 1.6, pi / 2),
    OscillationParameters(radians(8), 1.6, 1.0),
    SENSOR_POSITION,
    True,
)
IRREGULAR_WAVES = WaveConditions(
    OscillationParameters(0.04, 1.6),
    OscillationParameters(radians(3), 1.5),
    OscillationParameters(radians(8), 2.2),
    SENSOR_POSITION,
    False,
)
"""Of a model of 4 m in waves of 4 m and 0.1 m height, and in a sea of that significant height."""


def motion_derivatives(swing: OscillationParameters, t: Array, seed: int | None = None) -> Array:
    """Return a motion and its first two derivatives at t (n,), (3, n); irregular with a seed."""
    peak = 2 * pi / swing.period
    if seed is None:
        w, amplitude, phase = np.array([peak]), np.array([swing.amplitude]), swing.phase
    else:
        rng = np.random.default_rng(seed)
        edges = peak * np.linspace(*_FREQUENCY_BAND, _COMPONENTS + 1)
        # Anywhere in its band: evenly spaced ones would repeat within minutes.
        w = rng.uniform(edges[:-1], edges[1:])
        power = w**-5 * np.exp(-1.25 * (peak / w) ** 4)
        amplitude = swing.amplitude * np.sqrt(power / power.sum() / 2)
        phase = rng.uniform(0, 2 * pi, len(w))
    angle = w * t[:, None] + phase
    sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
    return np.stack([sine.sum(-1), (w * cosine).sum(-1), -(w**2 * sine).sum(-1)])


@dataclass(frozen=True, eq=False)
class ShipMotion:
    """Heave, pitch and roll with their derivatives, (3, n) each, and specific force, (n, 3)."""

    heave: Array
    pitch: Array
    roll: Array
    f: Array  # m/s²

    @property
    def attitude(self) -> Array:
        """R, model to basin, (n, 3, 3)."""
        return _axis_rotation(1, self.pitch[0]) @ _axis_rotation(0, self.roll[0])


def simulate_ship_motion(waves: WaveConditions, t: Array, seed: int = 0) -> ShipMotion:
    """Return the motion at t (n,) s and the specific force on the accelerometer."""
    seeds = (None,) * 3 if waves.regular else (3 * seed, 3 * seed + 1, 3 * seed + 2)
    swings = (waves.heave, waves.pitch, waves.roll)
    heave, pitch, roll = (motion_derivatives(s, t, k) for s, k in zip(swings, seeds, strict=True))
    c, s = np.cos(roll[0]), np.sin(roll[0])
    rate = np.stack([roll[1], pitch[1] * c, -pitch[1] * s], axis=-1)
    turning = np.stack(
        [
            roll[2],
            pitch[2] * c - pitch[1] * roll[1] * s,
            -pitch[2] * s - pitch[1] * roll[1] * c,
        ],
        axis=-1,
    )
    place = np.array(waves.place)
    result = ShipMotion(heave, pitch, roll, np.zeros((len(t), 3)))
    # Rᵀ (0, 0, z'' + g) is the last row of R.
    held = result.attitude[:, 2] * (heave[2] + G0)[:, None]
    f = held + np.cross(turning, place) + np.cross(rate, np.cross(rate, place))
    return ShipMotion(heave, pitch, roll, f)


def _axis_rotation(axis: int, angle: Array) -> Array:
    return exp_so3(angle[:, None] * np.eye(3)[axis])
