"""Determine the azimuth of a table by the earth's rate.

The input axis of a gyro is level and has the azimuth α + ψ − θ when the table is turned by θ about
the vertical (counter-clockwise seen from above). The gyro reads::

    reading = b + K Ω cos φ cos(α + ψ − θ) + e

α is the azimuth of a body axis at the angle zero, clockwise from north. ψ is the angle from that
axis to the input axis, clockwise seen from above, and φ is the latitude. With n positions evenly
spaced over a turn, u(α) = σ √(2/n)/(K Ω cos φ). The expected amplitude is known, so a wrong scale
factor or latitude is detected.

Source: IEEE Std 1431, 12.13 (north by a rate gyro).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import replace
from math import atan2, hypot, pi

import numpy as np
from scipy import special

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.qualification.linear_fit import MeasuredParameters, from_fit, linear_fit
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.physics.earth import earth_rate_up_north

_FLAT = 5.0  # standard uncertainties: a smaller amplitude is not detected


def earth_rate_azimuth(
    angle: Array,
    reading: Array,
    sd: float,
    latitude: float,
    offset: tuple[float, float],
    scale_sd: float = 0.01,
) -> MeasuredParameters:
    """Estimate the parameter "azimuth", rad.

    Parameters
    ----------
    angle : (m,) array
        Angles of the table, rad.
    reading : (m,) array
        Readings of the gyro, rad/s.
    sd : float
        Standard deviation of one reading, rad/s.
    latitude : float
        Latitude, rad.
    offset : two float
        ψ and its standard uncertainty, rad.
    scale_sd : float
        Relative standard uncertainty of the gyro's scale factor.

    Raises
    ------
    InputError
        The angles do not determine the azimuth, or the earth's rate is not detected.
    """
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=-1)
    hour = 180 / pi * 3600
    missing = {
        f"harmonic {k} of the angle ({{size:.2g}} °/h) is not due to the earth's rate: check the "
        "level and the magnetic sensitivity of the gyro": np.stack(
            [np.cos(k * angle), np.sin(k * angle)], axis=-1
        )
        / hour
        for k in (2, 3)
    }
    fit = linear_fit(
        columns,
        reading,
        np.full(len(reading), sd),
        missing,
        "read the gyro at four or more angles, evenly spaced over a turn",
        level=SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL,
    )
    c, s = fit.value[:2]
    amplitude = hypot(c, s)
    across = np.array([-s, c]) / amplitude
    u = float(np.sqrt(across @ fit.covariance[:2, :2] @ across))
    if amplitude < _FLAT * u:
        raise InputError(
            f"the earth's rate was not detected: an amplitude of {hour * amplitude:.3g} °/h "
            f"with u = {hour * u:.2g} °/h; read longer or at more angles",
            key="[measurement] file",
        )
    _, level = earth_rate_up_north(latitude)
    expected = abs(level)
    suspects = fit.suspects
    radial = float(np.sqrt(fit.value[:2] @ fit.covariance[:2, :2] @ fit.value[:2])) / amplitude
    pull = (amplitude - expected) / hypot(radial, scale_sd * expected)
    if 2 * special.ndtr(-abs(pull)) < (1 - SCORE_TEST_SHARE) * SIGNIFICANCE_LEVEL:
        suspects = (
            *suspects,
            f"the amplitude is {hour * amplitude:.4g} °/h instead of {hour * expected:.4g} °/h for "
            f"the earth's rate, {abs(pull):.1f} standard deviations off: check scale factor, "
            "latitude and the level",
        )
    # cos(α + ψ − θ) = cos(α + ψ) cos θ + sin(α + ψ) sin θ
    value = (atan2(s, c) - offset[0] + pi) % (2 * pi) - pi
    variance = (u / amplitude) ** 2 + offset[1] ** 2
    unseen = (
        "the direction of the gyro's input axis in the body: it is assumed to be offset as stated",
    )
    remarks = (f"amplitude {hour * amplitude:.4g} °/h, expected {hour * expected:.4g} °/h",)
    result = from_fit(
        fit, ("azimuth",), "rad", np.array([value]), np.array([[variance]]), unseen, remarks
    )
    return replace(result, suspects=suspects)
