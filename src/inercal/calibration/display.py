"""Show a calibration as a table: as text, HTML for notebooks, LaTeX, or a pandas DataFrame.

Its coefficients are also evaluated as functions of temperature, k(T) = Σ_j c_j ΔT^j, with their
uncertainty. A curve combines the terms of an axis whose basis functions differ only in the power of
ΔT. For the bias, these are `k0`, `k0_dT`, `k0_dT2` and `k0_dT3`.
"""

import re
from html import escape
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import require_extra
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration import Calibration
from inercal.calibration.validity import require_inside
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.sensors.coefficient_tables import TABLES

_HEADINGS = ("coefficient", "meaning", "value", f"U (k = {COVERAGE:g})", "unit")
_LATEX_CHARACTERS = {
    **{c: rf"\{c}" for c in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "−": "$-$",
    "±": r"$\pm$",
    "µ": r"$\mu$",
    "°": r"$^\circ$",
    "′": r"$'$",
    "″": r"$''$",
    "√": r"$\surd$",
    "·": r"$\cdot$",
    "χ": r"$\chi$",
    "²": r"$^2$",
    "³": r"$^3$",
    "⁻¹": r"$^{-1}$",
}
_LATEX_PATTERN = re.compile("|".join(map(re.escape, _LATEX_CHARACTERS)))


class CoefficientLine(NamedTuple):
    """A coefficient for printing; value and U (k = 2) are rounded to the digits of U.

    Parameters
    ----------
    name, meaning, value, expanded, unit : str
        `expanded` is empty if the calibration states no uncertainties.
    si : float
        Size of the unit in SI units.
    """

    name: str
    meaning: str
    value: str
    expanded: str
    unit: str
    si: float

    @property
    def axis(self) -> str:
        """The sensor axis of the coefficient."""
        return CoefficientName(self.name).axis


def coefficient_lines(calibration: Calibration) -> tuple[CoefficientLine, ...]:
    """Return the coefficients for printing, in the units of the coefficient table."""
    lines: list[CoefficientLine] = []
    for name, value, std in zip(
        calibration.sensor.coefficients, calibration.values, calibration.std, strict=True
    ):
        row = calibration.sensor.coefficient(name)
        value, expanded = format_value_and_uncertainty(value / row.si, COVERAGE * std / row.si)
        if not calibration.states_uncertainty:
            expanded = ""
        lines.append(CoefficientLine(name, row.meaning, value, expanded, row.unit, row.si))
    return tuple(lines)


def title(calibration: Calibration) -> str:
    """Return a line with the name of the sensor, the method and the estimator."""
    way = ", ".join(text for text in (calibration.method, calibration.estimator) if text)
    return f"{calibration.sensor.name}: {way}" if way else calibration.sensor.name


def to_html(calibration: Calibration) -> str:
    """Return the table and the verdict as HTML without styles; without a verdict, the notes."""
    head = "".join(f"<th>{escape(text)}</th>" for text in _HEADINGS)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in line[:5]) + "</tr>"
        for line in coefficient_lines(calibration)
    )
    judged = calibration.verdict
    first, *others = judged.lines if judged else ("", *calibration.notes)
    notes = "".join(f"<li>{escape(note)}</li>" for note in others)
    verdict = f"<p><strong>{escape(first)}</strong></p>" if first else ""
    return (
        f"<p>{escape(title(calibration))}</p><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table>{verdict}<ul>{notes}</ul>"
    )


def to_latex(calibration: Calibration) -> str:
    """Return the table as a LaTeX tabular with rules of the package booktabs."""

    def row(cells: tuple[str, ...]) -> str:
        return " & ".join(map(_latex, cells)) + r" \\"

    lines = [row(line[:5]) for line in coefficient_lines(calibration)]
    return "\n".join(
        [
            f"% {title(calibration)}",
            r"\begin{tabular}{llrrl}",
            r"\toprule",
            row(_HEADINGS),
            r"\midrule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


def _latex(text: str) -> str:
    """Replace special characters in a text by LaTeX commands."""
    return _LATEX_PATTERN.sub(lambda found: _LATEX_CHARACTERS[found[0]], text)


def to_dataframe(calibration: Calibration) -> Any:
    """Return a DataFrame with the value, u (k = 1) and U (k = 2) of each coefficient.

    Raises
    ------
    InputError
        If pandas is not installed.
    """
    with require_extra("pandas", "a DataFrame needs pandas", ("pandas",)):
        import pandas as pd  # pyright: ignore[reportMissingTypeStubs]
    lines = coefficient_lines(calibration)
    si = np.array([line.si for line in lines])
    return pd.DataFrame(
        {
            "meaning": [line.meaning for line in lines],
            "value": calibration.values / si,
            "u": calibration.std / si,
            "U": COVERAGE * calibration.std / si,
            "unit": [line.unit for line in lines],
        },
        index=pd.Index([line.name for line in lines], name="coefficient"),
    )


class TemperatureCurve(NamedTuple):
    """A coefficient of an axis at n temperatures.

    Parameters
    ----------
    name : str
        Full name, such as "ax.k0".
    meaning, unit : str
        Meaning and unit from the table of coefficients.
    si : float
        Size of the unit in SI units.
    value, std : (n,) arrays
        Values and standard uncertainties (k = 1), SI.
    complete : bool
        Whether the term of order 0 was estimated. If not, the values are changes relative to the
        reference temperature.
    """

    name: str
    meaning: str
    unit: str
    si: float
    value: Array
    std: Array
    complete: bool


def temperature_curves(calibration: Calibration, kelvin: Array) -> tuple[TemperatureCurve, ...]:
    """Return the temperature-dependent coefficients at some temperatures, (n,), in K.

    Raises
    ------
    InputError
        If a temperature is more than a kelvin outside the range of the calibration's data.
    """
    require_inside(calibration.sensor, calibration.validity, kelvin, "give one in this range")
    sensor = calibration.sensor
    dT = kelvin - sensor.reference_temperature
    found: list[TemperatureCurve] = []
    for axis in sensor.axes:
        own = [n for n in sensor.coefficients if CoefficientName(n).axis == axis.name]
        terms = {n: sensor.coefficient(n) for n in own}
        warm = [one.without_temperature for one in terms.values() if one.temperature_order]
        for base in dict.fromkeys(warm):
            line = next(
                one
                for one in TABLES[axis.measures]
                if one.without_temperature == base and not one.temperature_order
            )
            by = np.zeros((kelvin.size, len(sensor.coefficients)))
            for name, one in terms.items():
                if one.without_temperature == base:
                    by[:, sensor.coefficients.index(name)] = dT**one.temperature_order
            variance = np.einsum("ni,ij,nj->n", by, calibration.covariance, by)
            found.append(
                TemperatureCurve(
                    f"{axis.name}.{line.name}",
                    line.meaning,
                    line.unit,
                    line.si,
                    by @ calibration.values,
                    np.sqrt(np.maximum(variance, 0.0)),
                    f"{axis.name}.{line.name}" in own,
                )
            )
    return tuple(found)
