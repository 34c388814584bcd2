"""Determine gravity at the sensor, and the azimuth of a table by the earth's rate.

Gravity is measured absolutely, tied to a network point, or computed::

    g = g_point + δ − γ h + tide

Here h is the height of the sensor above the measured point and γ the gradient. In free air γ is
0.3086 mGal/m; in a building it differs by a few percent. A tie measures δ with a gravimeter whose
zero drifts, so the gravimeter must be read at the first point again. Each reading without tide
correction has u = 0.15 mGal/√3. A value for use on any day also has this uncertainty, unless the
run is corrected for the tide.

Azimuth: the input axis of a gyro is level and has the azimuth α + ψ − θ when the table is turned by
θ about the vertical (counter-clockwise seen from above). The gyro reads::

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
from math import atan2, hypot, pi, sqrt

import numpy as np
from scipy import special

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.qualification.linear_fit import (
    LinearFit,
    MeasuredParameters,
    from_fit,
    linear_fit,
    readings_error,
)
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.physics.earth import earth_rate_up_north

MILLIGAL = 1e-5  # m/s²
GRADIENT = 0.3086 * MILLIGAL  # 1/s², free air
TIDE = 0.15 * MILLIGAL  # m/s², largest
_GRADIENT_SHARE = 0.1  # relative standard uncertainty of the gradient in a building
NO_FIT = LinearFit(np.zeros(0), np.zeros((0, 0)), 0.0, 0)


def local_gravity(
    point: Measured,
    height: float,
    *,
    gradient: Measured | None = None,
    tide: bool,
    fit: LinearFit = NO_FIT,
) -> MeasuredParameters:
    """Return the parameter "g" at a height above the point where gravity is known, m/s².

    Parameters
    ----------
    point : Measured
        Gravity at the point, m/s².
    height : float
        Height of the sensor above the point, m.
    gradient : Measured, optional
        Decrease of gravity with height, 1/s²; by default the free-air gradient ± 10 %.
    tide : bool
        Whether runs are corrected for the tide; otherwise its standard deviation is added.
    fit : LinearFit
        Fit of the measurement at the point, which provides the tests.
    """
    slope = gradient or Measured(GRADIENT, _GRADIENT_SHARE * GRADIENT)
    value = point.value - slope.value * height
    variance = point.sd**2 + (slope.sd * height) ** 2 + (0.0 if tide else TIDE**2 / 3)
    unseen = () if tide else ("the tide on the day; the uncertainty includes ± 0.15 mGal",)
    return from_fit(fit, ("g",), "m/s²", np.array([value]), np.array([[variance]]), unseen)


def tied_gravity(
    known: Measured, site: Array, hours: Array, reading: Array, sd: float, scale_sd: float = 0.0
) -> tuple[Measured, LinearFit]:
    """Return gravity at the laboratory, measured with a gravimeter, and the fit of its readings.

    Parameters
    ----------
    known : Measured
        Gravity at the network point, m/s².
    site : (m,) array
        1 at the laboratory, 0 at the network point.
    hours : (m,) array
        Time of each reading, h.
    reading : (m,) array
        Readings of the gravimeter except for a constant, m/s².
    sd : float
        Standard deviation of one reading, m/s².
    scale_sd : float
        Relative standard uncertainty of the gravimeter's scale.

    Raises
    ------
    InputError
        There is no reading at one of the two points, or no repeated reading that shows the drift.
    """
    before = site[0] != 0 if len(site) else False
    changes = int(np.count_nonzero(np.diff(site)))
    if len(set(site.tolist())) < 2 or changes < 2:
        raise readings_error(
            "the gravimeter was not read again at "
            f"{'the laboratory' if before else 'the point of the network'}, so the drift of its "
            "zero cannot be distinguished from the difference; close the loop",
        )
    time = hours - hours.mean()
    columns = np.stack([site, np.ones_like(time), time], axis=-1)
    missing = {"the drift of the zero is not steady": MILLIGAL * (time**2)[:, None]}
    fit = linear_fit(
        columns, reading, np.full(len(reading), sd), missing, "read more often at both points"
    )
    step = float(fit.value[0])
    variance = known.sd**2 + float(fit.covariance[0, 0]) + (scale_sd * step) ** 2
    return Measured(known.value + step, sqrt(variance)), fit


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
        raise readings_error(
            f"the earth's rate was not detected: an amplitude of {hour * amplitude:.3g} °/h "
            f"with u = {hour * u:.2g} °/h; read longer or at more angles",
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
