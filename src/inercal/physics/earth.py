"""Normal gravity of the WGS 84 ellipsoid and the Earth's rotation.

Somigliana's closed formula gives gravity on the ellipsoid at the geodetic latitude φ. Above the
ellipsoid, gravity is a series to second order in the height h (the free-air gradient and its
change)::

    γ(φ) = γe (1 + k sin²φ) / sqrt(1 − e² sin²φ)                                  (4-1)
    γ(φ, h) = γ(φ) (1 − 2/a (1 + f + m − 2 f sin²φ) h + 3/a² h²)                  (4-3)

This is the magnitude that a gravimeter would read on a smooth Earth, including the centrifugal
part. The series agrees with the ellipsoid's exact field to 5e-7 m/s² up to 5 km and to 1.5e-6 m/s²
up to 20 km. Both errors are negligible compared with the local anomaly.

Source: NIMA TR8350.2, Department of Defense World Geodetic System 1984, 3rd edition, amendment 1
(2000), equations 4-1 and 4-3, and the constants of its chapter 3.
"""

from math import cos, degrees, hypot, pi, sin, sqrt

from inercal.basics.errors import InputError
from inercal.basics.units import Measured

EARTH_RATE = 7.292115e-5
"""Angular rate of the Earth relative to inertial space, rad/s (a defining constant of WGS 84)."""

_EQUATOR = 9.7803253359  # γe, m/s²
_K = 0.00193185265241  # b γp / (a γe) − 1
_E2 = 6.69437999014e-3  # first eccentricity squared
_A = 6378137.0  # semi-major axis, m
_F = 1 / 298.257223563  # flattening
_M = 0.00344978650684  # ω² a² b / GM

# Rock and relief make true gravity differ from the formula: point free-air anomalies have a
# variance of 1795 mGal² (Tscherning and Rapp, Report 208, Ohio State University, 1974), which is 40
# mGal when rounded.
COMPUTED_GRAVITY_SD = 40e-5
"""Standard uncertainty of gravity computed from latitude and height, m/s²."""

_LOWEST, _HIGHEST = -1e3, 20e3  # m: every laboratory and aircraft
UNKNOWN_HEIGHT = (0.0, 2000.0)
"""Range of heights assumed for a laboratory whose height is not stated, m."""


def normal_gravity(latitude_rad: float, height_m: float) -> Measured:
    """Return gravity computed from the location only; a measured value is far better.

    Parameters
    ----------
    latitude_rad : float
        Geodetic latitude.
    height_m : float
        Height above the ellipsoid. Height above sea level can be used instead: the two differ by at
        most 100 m (30 mGal).

    Returns
    -------
    Measured
        Gravity, m/s². The standard uncertainty, 40 mGal, covers the local anomaly that the formula
        ignores.

    Raises
    ------
    InputError
        The latitude is outside −90° … 90° or the height outside −1 km … 20 km.

    Examples
    --------
    >>> normal_gravity(0.0, 0.0)
    Measured(value=9.7803253359, sd=0.0004)
    """
    if not _LOWEST <= height_m <= _HIGHEST:
        raise InputError(
            f"height {height_m:g} m is not possible; give −1 km to 20 km above the ellipsoid",
            key="height",
        )
    s2 = sin(_checked_latitude(latitude_rad)) ** 2
    on_ellipsoid = _EQUATOR * (1 + _K * s2) / sqrt(1 - _E2 * s2)
    h = height_m / _A
    return Measured(
        on_ellipsoid * (1 - 2 * (1 + _F + _M - 2 * _F * s2) * h + 3 * h**2), COMPUTED_GRAVITY_SD
    )


def gravity_at_unknown_height(latitude_rad: float) -> Measured:
    """Return gravity when only the latitude is known, assuming a height between 0 and 2000 m.

    All heights in this range are treated as equally likely (GUM 4.3.7): the value is the middle of
    the bounds, and the standard uncertainty is their half-width divided by √3. The uncertainty from
    the local anomaly is added to it.

    Parameters
    ----------
    latitude_rad : float
        Geodetic latitude.

    Returns
    -------
    Measured
        Gravity, m/s².

    Raises
    ------
    InputError
        The latitude is outside −90° … 90°.

    Examples
    --------
    >>> known = gravity_at_unknown_height(0.0)
    >>> round(known.value, 5), round(known.sd, 5)
    (9.77724, 0.00183)
    """
    high, low = (normal_gravity(latitude_rad, height).value for height in UNKNOWN_HEIGHT)
    return Measured(0.5 * (high + low), hypot(0.5 * (high - low) / sqrt(3), COMPUTED_GRAVITY_SD))


def earth_rate_up_north(latitude_rad: float) -> tuple[float, float]:
    """Return the upward and northward components of the Earth's rotation rate, rad/s.

    Parameters
    ----------
    latitude_rad : float
        Geodetic latitude, positive in the north.

    Raises
    ------
    InputError
        The latitude is outside −90° … 90°.
    """
    latitude = _checked_latitude(latitude_rad)
    return EARTH_RATE * sin(latitude), EARTH_RATE * cos(latitude)


def _checked_latitude(latitude: float) -> float:
    # A pole given as 90 degrees may be too large by one rounding error after a conversion.
    if not abs(latitude) <= pi / 2 * (1 + 1e-12):
        raise InputError(
            f"[bench] latitude: {degrees(latitude):g}° is not possible; give −90° to 90°",
            key="latitude",
        )
    return latitude
