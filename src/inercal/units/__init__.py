"""SI sizes of units, and quantities as people write them: "0.5 m ± 5 µm", "2″", "0.1 °/√h".

Everything inside the package is in SI (m, s, rad, K, V, A, and counts); text with units is read
here, at the edge, and nowhere else. Three choices differ from a general units library:

- "g" is standard gravity, 9.80665 m/s² exactly (CGPM 1901), and "mg", "µg" are its multiples.
  There is no gram, and a unit takes only the prefixes that are used with it (no "kg", no "Mg").
- Angle is a dimension of its own, so that rad/s is not 1/s and a tilt is not a plain number.
- A stated uncertainty is a standard uncertainty (k = 1) unless "(k=2)" or the like follows.
"""

from inercal.units.expression import ZERO_CELSIUS, si_factor, to_si
from inercal.units.quantity import (
    Measured,
    format_quantity,
    format_value_and_uncertainty,
    parse_quantity,
)

__all__ = [
    "ZERO_CELSIUS",
    "Measured",
    "format_quantity",
    "format_value_and_uncertainty",
    "parse_quantity",
    "si_factor",
    "to_si",
]
