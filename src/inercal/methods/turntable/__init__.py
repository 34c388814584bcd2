"""What the methods of a turntable share: the model of a triad, and its attitude by the gyros.

The methods are `turntable_kalman`, `turntable_discrete` and `turntable_trajectory`.
"""

from collections.abc import Mapping

from inercal.methods._base import Kind

_TRIAD = ("bias", "scale", "misalignment")
DEFAULT_COEFFICIENTS: Mapping[Kind, tuple[str, ...]] = {"f": _TRIAD, "w": _TRIAD}
FURTHER_COEFFICIENTS: Mapping[Kind, tuple[str, ...]] = {
    "f": ("k2", "temperature"),
    "w": ("g", "temperature"),
}
