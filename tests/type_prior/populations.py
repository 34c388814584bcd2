"""Sensors of a type and their calibrations, drawn with NumPy alone: nothing of inercal is imported.

Sensor i has the values θ_i ~ N(μ, T). Its calibration reads θ_i + e_i + s, where e_i has a
covariance of its own and s is the error of the bench, the same for all sensors.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Drawn(NamedTuple):
    """What n calibrations with p values say, and the truth of a new sensor."""

    values: Array  # (n, p)
    own: Array  # (n, p, p)
    shared: Array  # (p,), 1σ of the bench error in each value
    new: Array  # (2, p), two new sensors


def draw(
    rng: np.random.Generator,
    n: int,
    scatter: Array,
    measured: Array,
    *,
    correlation: float = 0.0,
    shared: float = 0.0,
    spread: float = 0.3,
) -> Drawn:
    """Draw a type with the standard deviations `scatter` and `measured`, (p,) each.

    Parameters
    ----------
    rng : Generator
    n : int
        Number of sensors.
    scatter, measured : (p,) arrays
        Standard deviations between sensors, and typical ones of a calibration.
    correlation : float
        Correlation of the values of a sensor.
    shared : float
        Standard deviation of the bench error, in units of `measured`.
    spread : float
        Relative spread of the uncertainties from calibration to calibration.
    """
    p = len(scatter)
    mean = 100 * rng.standard_normal(p)
    alike = (1 - correlation) * np.eye(p) + correlation
    sensors = mean + rng.multivariate_normal(np.zeros(p), alike * np.outer(scatter, scatter), n + 2)
    sd = measured * np.exp(spread * rng.standard_normal((n, 1)))
    # Errors of one calibration are correlated, as those of k1 and k3.
    errors_alike = np.full((p, p), -0.5) + 1.5 * np.eye(p) if p == 2 else np.eye(p)
    own = errors_alike * sd[:, :, None] * sd[:, None, :]
    errors = np.array([rng.multivariate_normal(np.zeros(p), one) for one in own])
    column = shared * measured
    values = sensors[:n] + errors + column * rng.standard_normal()
    return Drawn(values, own, column, sensors[n:])
