"""Know units and their SI sizes, and read and print quantities such as "0.5 m ± 5 µm".

All values inside the package are in SI (m, s, rad, K, V, A, and counts); only this subpackage reads
text with units. Three choices differ from a general units library:

- "g" is standard gravity, 9.80665 m/s² exactly (CGPM 1901), and "mg", "µg" are its multiples. There
  is no gram, and a unit accepts only the prefixes that are commonly used with it (no "kg", no
  "Mg").
- Angle is a dimension: rad/s is not 1/s and a tilt is not a plain number.
- A stated uncertainty is a standard uncertainty (k = 1) unless a factor such as "(k=2)" follows.
"""

from inercal.basics.units.expression import ZERO_CELSIUS, si_factor, to_si
from inercal.basics.units.quantity import (
    LARGEST_NUMBER,
    Measured,
    format_count,
    format_duration,
    format_interval,
    format_number,
    format_quantity,
    format_value_and_uncertainty,
    parse_quantity,
)

__all__ = [
    "LARGEST_NUMBER",
    "ZERO_CELSIUS",
    "Measured",
    "format_count",
    "format_duration",
    "format_interval",
    "format_number",
    "format_quantity",
    "format_value_and_uncertainty",
    "parse_quantity",
    "si_factor",
    "to_si",
]
