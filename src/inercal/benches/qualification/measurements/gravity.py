"""Gravity at the sensor: measured absolutely, tied to a network point, or computed.

    g = g_point + δ − γ h + tide

Here h is the height of the sensor above the measured point and γ the gradient. In free air γ is
0.3086 mGal/m; in a building it differs by a few percent. A tie measures δ with a gravimeter whose
zero drifts, so the gravimeter must be read at the first point again. Each reading without tide
correction has u = 0.15 mGal/√3. A value for use on any day also has this uncertainty, unless the
run is corrected for the tide.
"""

from math import sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches.qualification.linear_fit import (
    LinearFit,
    MeasuredParameters,
    from_fit,
    linear_fit,
)

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
        raise InputError(
            "the gravimeter was not read again at "
            f"{'the laboratory' if before else 'the point of the network'}, so the drift of its "
            "zero cannot be distinguished from the difference; close the loop",
            key="[measurement] file",
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
