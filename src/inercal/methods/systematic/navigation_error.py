"""Navigation errors that a calibration leaves, and those without it.

Over a rest of T seconds, from its own attitude, errors δf and δω of the body make a velocity::

    v = C δf T − ½ g e_up × C δω T²

A navigation at rest and level, body axes east, north and up, from a true start, has the errors
(Schuler's oscillation by the radius R of the Earth, vertical channel left out)::

    ṗ = v,   v̇ = −g e_up × ψ − 2 ω_ie × v + δf,   ψ̇ = −ω_ie × ψ − e_up × v/R + δω

Source: Titterton and Weston, Strapdown Inertial Navigation Technology, 2nd edition, 12.2.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.methods.systematic.navigation import earth_rate
from inercal.methods.systematic.segments import Segments
from inercal.physics.frames import skew
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor

EARTH_RADIUS = 6_371_000.0  # m, mean
HOUR = 3600.0
_STEP = 4.0  # s
_UP = np.array([0.0, 0.0, 1.0])


class VelocityErrors(NamedTuple):
    """Length of the level velocity at the end of each rest, (m,) m/s."""

    before: Array
    after: Array


class PositionDrift(NamedTuple):
    """Position error of one hour at rest, level, along east and north, m."""

    before: Array  # (2,)
    expanded: Array  # (2,) U after calibration


def velocity_errors(
    segments: Segments, sensor: Sensor, c: Array, attitudes: Array, gravity: float, latitude: float
) -> VelocityErrors:
    """Return the velocity errors over each rest, with nominal and with estimated coefficients.

    Parameters
    ----------
    segments : Segments
    sensor : Sensor
    c : (p,) array
        Estimated coefficients, SI.
    attitudes : (m, 3, 3) array
        C at each rest.
    gravity, latitude : float
        m/s² and rad.
    """
    back = np.swapaxes(attitudes, -1, -2)
    earth = earth_rate(latitude)
    f, w = gravity * back @ _UP, back @ earth
    at = sensor.linearise(Motion(f, w), c)
    slope = np.broadcast_to(at.slope, (len(f), 6, 6))
    off = (segments.mean - at.reading)[..., None]
    sensed = np.asarray(np.linalg.solve(slope, off)[..., 0], dtype=float)
    nominal = segments.mean - np.concatenate([f, w], axis=1)
    seconds = segments.rest_seconds[:, None]

    def velocity(error: Array) -> Array:
        force, rate = (
            (attitudes @ error[:, part, None])[..., 0] for part in (slice(0, 3), slice(3, 6))
        )
        v = force * seconds - 0.5 * gravity * np.cross(_UP, rate) * seconds**2
        return np.linalg.norm(v[:, :2], axis=1)

    return VelocityErrors(velocity(nominal), velocity(sensed))


def position_drift(
    sensor: Sensor, c: Array, covariance: Array, gravity: float, latitude: float
) -> PositionDrift:
    """Return the position error after an hour, without calibration, and U with it.

    Parameters
    ----------
    sensor : Sensor
        Three accelerometers, then three gyros.
    c, covariance : (p,) and (p, p) arrays
        Of its coefficients, SI.
    gravity, latitude : float
        m/s² and rad.
    """
    earth = earth_rate(latitude)
    design = sensor.design(Motion(gravity * _UP[None], earth[None]), np.zeros(len(c)))[0]
    by = _response(gravity, earth) @ design
    variance = np.einsum("ip,pq,iq->i", by, covariance, by)
    return PositionDrift(by @ c, COVERAGE * np.sqrt(variance))


def _response(gravity: float, earth: Array) -> Array:
    """Return ∂(position east, north)/∂(δf, δω) after an hour, (2, 6)."""
    level = np.diag([1.0, 1.0, 0.0])
    up = skew(_UP)
    a: NDArray[np.float64] = np.zeros((9, 9))
    a[:3, 3:6] = level
    a[3:6, 3:6] = -2 * level @ skew(earth)
    a[3:6, 6:] = -gravity * level @ up
    a[6:, 3:6] = -up / EARTH_RADIUS
    a[6:, 6:] = -skew(earth)
    b = np.zeros((9, 6))
    b[3:6, :3], b[6:, 3:] = level, np.eye(3)
    x = np.zeros((9, 6))
    for _ in range(round(HOUR / _STEP)):  # fourth order: the motion takes 84 min
        k = [a @ x + b]
        for share in (0.5, 0.5, 1.0):
            k.append(a @ (x + share * _STEP * k[-1]) + b)
        x = x + _STEP / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])
    return x[:2]
