"""Find a step of an axis, or a thermometer that truncates toward zero, in a ramp's residuals.

Each cause adds a column c to the whitened rows. After the columns of the fit are projected out, the
cause explains the part (c·r)²/(c·c) of χ², and its size is c·r/(c·c). A step has one column for
each axis and block. A thermometer that truncates toward zero reads half a step too high below 0 °C
and half a step too low above, so its column is db/dT sign(T) step/2, and its size is 1.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS, format_quantity
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods.temperature_ramp.ramp_fit import RampModel
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.recordings import Finding

_GAIN, _SHARE = 50.0, 0.3  # a cause must explain this part of χ², and of its excess
_ONE = 0.4  # largest difference of the size of a truncation from 1
_SHIFT = 2.0  # U of a coefficient, above which the result is not to be relied on
_ENDS = 5  # blocks; a step this close to an end is not tested


def sudden_change(
    model: RampModel, x: Array, rows: tuple[Array, Array], std: Array
) -> list[Finding]:
    """Return a finding on the sudden change that explains the residuals best, if there is one.

    Parameters
    ----------
    model : RampModel
        The model with the fitted nodes.
    x, std : (p,) arrays
        The parameters and their standard uncertainties.
    rows : (n,) array and (n, q) array
        Whitened residuals and their derivatives by the parameters and then by the nodes; the
        residuals of the readings come first, axis after axis.
    """
    residual, jacobian = rows
    b, count, p = model.blocks.time.size, len(model.sensor.axes), len(model.sensor.coefficients)
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    q, upper = np.linalg.qr(jacobian / size)
    best, text, column = 0.0, "", residual
    for k, axis in enumerate(model.sensor.axes):
        own = slice(b * k, b * (k + 1))
        steps = np.cumsum(model.whitening[k][:, ::-1], axis=1)[:, ::-1]
        left = np.sum(steps**2, axis=0) - np.sum((q[own].T @ steps) ** 2, axis=0)
        jump = (steps.T @ residual[own])[_ENDS:-_ENDS] / left[_ENDS:-_ENDS]
        gain = jump**2 * left[_ENDS:-_ENDS]
        at = int(gain.argmax())
        if gain[at] > best:
            best, column = float(gain[at]), np.zeros(residual.size)
            column[own] = steps[:, at + _ENDS] * jump[at]
            shown = format_quantity(float(jump[at]), 0.0, BIAS_UNITS[axis.measures][1], 2)
            when = f"at {model.blocks.time[at + _ENDS]:.0f} s"
            text = f"{axis.name} jumps by {shown} {when}: use the part before or after it"
    celsius = model.temperature_offset(x) + model.sensor.reference_temperature - ZERO_CELSIUS
    if model.blocks.step and celsius.min() < 0 < celsius.max():
        half = 0.5 * model.blocks.step * np.sign(celsius)
        parts = [w @ (model.slope(x, k) * half) for k, w in enumerate(model.whitening)]
        cause = np.concatenate([*parts, np.zeros(residual.size - b * count)])
        unexplained = float(cause @ cause - np.sum((q.T @ cause) ** 2))
        found = float(cause @ residual) / unexplained
        if abs(found - 1) < _ONE and found**2 * unexplained > best:
            best, column = found**2 * unexplained, cause
            text = "the thermometer truncates toward 0 °C: round its readings when you record"
    excess = float(residual[: b * count] @ residual[: b * count]) - b * count
    if best < max(_GAIN, _SHARE * excess):
        return []
    moved = (np.linalg.lstsq(upper, q.T @ column, rcond=1e-12)[0] / size)[:p]
    severe = (np.abs(moved) > _SHIFT * COVERAGE * std[:p]).any()
    return [Finding("refused" if severe else "warning", "sudden change", text)]
