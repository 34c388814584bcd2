"""The error of a calibration on new poses, by its own covariance.

Residuals of the fit show how well the model follows the fitted readings. A user needs the error of
the corrected vector in other poses, δf = −S⁻¹ ∂h/∂c δc: a free direction shows only there.
"""

from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_value_and_uncertainty
from inercal.benches.rate_table.bench import RateTable
from inercal.estimation import Estimate
from inercal.methods._base import Fit, Remarks
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, Sensor

_POSE_COUNT = 300
_MILLI_G = 1e-3 * G0


def pose_forces(fastest: float, radius: float, g: float) -> Array:
    """Return the specific force in attitudes all round at rates from rest on, (300, 3) m/s².

    Parameters
    ----------
    fastest : float
        Largest rate of the table, rad/s; the rates are evenly spaced from 0.
    radius : float
        m.
    g : float
        m/s².
    """
    rng = np.random.default_rng(0)  # the same poses in every call
    up, across = rng.standard_normal((2, _POSE_COUNT, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    across -= np.sum(across * up, axis=-1, keepdims=True) * up
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    rate = np.linspace(0.0, fastest, _POSE_COUNT)[:, None]
    return g * up + radius * rate**2 * across


def expected_error(sensor: Sensor, estimate: Estimate, f: Array) -> float:
    """Return the root mean square of the corrected vector's error over poses f, (n, 3), m/s²."""
    p = len(sensor.coefficients)
    _, result, slope = sensor.linearise(Motion(f), estimate.value[:p])
    by_coefficient = np.asarray(np.linalg.solve(slope[..., :3], result), dtype=float)
    covariance = estimate.stated_covariance[:p, :p]
    return float(
        np.sqrt(np.einsum("nip,pq,niq->", by_coefficient, covariance, by_coefficient) / len(f))
    )


def prediction_note(
    sensor: Sensor, estimate: Estimate, fastest: float, radius: float, g: float
) -> str:
    """Return the note on the error of fresh poses and on the residuals of the fit, in mg."""
    error = expected_error(sensor, estimate, pose_forces(fastest, radius, g)) / _MILLI_G
    inside = float(np.sqrt(np.mean(estimate.residual**2))) / _MILLI_G
    frame = "" if sensor.frame == "mount" else f", in the {sensor.frame} frame,"
    return (
        f"on fresh poses, in any attitude at up to {fastest * 30 / pi:.3g} r/min, the corrected "
        f"vector{frame} is off by {format_value_and_uncertainty(0.0, error)[1]} mg (rms, k = 1); "
        f"each residual in the sample is {format_value_and_uncertainty(0.0, inside)[1]} mg rms"
    )


def remarks(fit: Fit[RateTable, Spin]) -> Remarks:
    """Return the note on the error of fresh poses, for a fit that converged."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    fastest = max(abs(step.rate) for step in fit.steps)
    radius, g = fit.bench.radius.value, fit.bench.gravity.value
    return Remarks(notes=(prediction_note(fit.sensor, fit.estimate, fastest, radius, g),))
