"""Recognise that only the scale factors of a triad changed, all by the same amount.

If gravity g is stated wrongly by Δg, the scale factors 1 + k1 of all accelerometers are wrong by
the factor g/(g + Δg), and no residual shows it. A wrong unit, rate or clock acts in the same way.
The mean of the relative changes must exceed 3 u. The deviations from this mean, and the changes of
all other coefficients, must stay below 3 u.
"""

from collections.abc import Iterator

import numpy as np

from inercal.basics.units import format_quantity
from inercal.calibration.comparison import Comparison
from inercal.physics.quantities import ANGULAR_RATE, SPECIFIC_FORCE
from inercal.physics.sensors import G0

_LIMIT = 3.0  # u
_AXES = 3
_PPM = 1e-6


def common_scale_lines(compared: Comparison) -> Iterator[str]:
    """Yield a line for each triad of which only the scale factors changed, by the same amount."""
    if not compared.states_uncertainty:
        return
    measures = compared.second.sensor.measures
    u, changed = compared.difference_std, np.abs(compared.difference) > 0
    for kind in (SPECIFIC_FORCE, ANGULAR_RATE):
        names = [f"{axis}.{kind.scale}" for axis, one in measures.items() if one == kind.symbol]
        at = [k for k, name in enumerate(compared.names) if name in names]
        others = np.delete(np.abs(compared.difference) - _LIMIT * u, at)
        if len(at) != _AXES or not changed[at].all() or (others > 0).any():
            continue
        scale = np.array([1 + compared.first.value(compared.names[k]) for k in at])
        change = compared.difference[at] / scale
        covariance = compared.difference_covariance[np.ix_(at, at)] / np.outer(scale, scale)
        mean, ones = float(change.mean()), np.full((_AXES, _AXES), 1 / _AXES)
        apart = np.eye(_AXES) - ones
        limits = _LIMIT * np.sqrt(np.diag(apart @ covariance @ apart.T))
        if abs(mean) <= _LIMIT * np.sqrt(covariance.mean()) or (abs(change - mean) > limits).any():
            continue
        change_text = f"{mean / _PPM:+.0f} ppm".replace("-", "−")
        text = f"all scale factors of the {kind.sensors} changed by {change_text}"
        cause = "a wrong rate, angle of the turns, clock or unit in one of them"
        if kind is SPECIFIC_FORCE:
            size = format_quantity(abs(mean) * G0, 0.0, "mm/s²", 2)
            first, second = ("high", "low") if mean > 0 else ("low", "high")
            cause = (
                f"gravity stated {size} too {first} in the first, or too {second} in the second, "
                "or a wrong unit"
            )
        yield f"{text}, and nothing else did; the likely cause is {cause}"
