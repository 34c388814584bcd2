"""Determine the characteristics that standards define for a sensor, as data and in words.

A bench gives a table of inputs and readings for each axis. The characteristics are those that the
table can show: the line needs three different inputs, the asymmetry both senses, the hysteresis an
input that was reached from both sides, and threshold, dead band and resolution a series of small
inputs (`inercal.estimation.response_band`). The largest loop shows the hysteresis: a series of
small inputs is a small loop of its own.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_quantity
from inercal.estimation.input_output_tests import (
    Figure,
    InputOutput,
    asymmetry,
    composite_error,
    hysteresis,
    linearity_error,
    scale_factor,
)
from inercal.estimation.response_band import Band, response_band, small_inputs

DEFINITIONS: Mapping[str, str] = {
    "scale factor": "slope of the least-squares line over all inputs (IEEE Std 528)",
    "linearity error": "largest residual of the line, of full scale (IEEE Std 528)",
    "asymmetry": "difference between the slopes of both senses, of their mean (IEEE Std 528)",
    "composite error": (
        "largest difference from the nominal output, of half the output span (IEEE Std 528)"
    ),
    "hysteresis": (
        "separation of the readings after a higher and a lower input, in the middle of the loop "
        "(IEEE Std 528)"
    ),
    "threshold": "least input about zero that gives half of the expected output (IEEE Std 528)",
    "dead band": "half width of the region about zero without a change of output (IEEE Std 528)",
    "resolution": (
        "least change of a larger input that gives half of the expected change of output "
        "(IEEE Std 528)"
    ),
    "warm-up drift": "last minus first of the repeated readings after turn-on (IEEE Std 1293)",
    "warm-up time constant": "time constant of the exponential that describes the warm-up drift",
    "warm-up time": "time after turn-on until the reading stays within the stated band of the last",
    "short-term stability": "scatter (1 σ) of the same readings beyond their noise (IEEE Std 1293)",
}
BAND_NOTE = (
    "The small inputs do not enter the fit of the coefficients, because a threshold, a dead band "
    "or a limited resolution was detected."
)
_FEWEST = 3  # different inputs
_LARGER = 5.0  # times the small inputs: full scale of a line that predicts their output


@dataclass(frozen=True)
class Characteristic:
    """A characteristic of one axis.

    Parameters
    ----------
    axis, name : str
    figure : Figure
        Value and uncertainty, SI.
    unit : str
        Unit in which it is shown.
    about : float or None
        Input about which a resolution was determined, SI.
    rows : tuple of int
        Rows with the small inputs that show a threshold, dead band or resolution.
    """

    axis: str
    name: str
    figure: Figure
    unit: str
    about: float | None = None
    rows: tuple[int, ...] = ()

    @property
    def definition(self) -> str:
        """Definition in words, with its standard."""
        return DEFINITIONS[self.name]

    @property
    def title(self) -> str:
        """Name, and the input about which it holds."""
        if self.about is None:
            return self.name
        unit = "°/s" if self.unit == "°/h" else "g"
        return f"{self.name} about {format_quantity(self.about, 0.0, unit, 4)}".replace("-", "−")

    @property
    def text(self) -> str:
        """Value with U at 95 %, or the upper limit of an effect that was not detected."""
        found = self.figure
        if not found.detected:
            return f"not detected, below {format_quantity(found.bound, 0.0, self.unit, 2)}"
        half = (found.high - found.low) / 2
        return format_quantity(found.value, half, self.unit).replace("-", "−")

    @property
    def detectable(self) -> str:
        """Smallest detectable size, or nothing if it is not known."""
        size = self.figure.detectable
        return format_quantity(size, 0.0, self.unit, 2) if isfinite(size) else ""

    def as_object(self) -> dict[str, object]:
        """Return the characteristic for JSON; all numbers in SI units."""
        found = self.figure
        return {
            "axis": self.axis,
            "name": self.name,
            "about": self.about,
            "detected": found.detected,
            "value": found.value,
            "u": found.u,
            "interval_95": [found.low, found.high],
            "upper_limit_95": found.bound,
            "smallest_detectable": found.detectable if isfinite(found.detectable) else None,
            "definition": self.definition,
        }


def table_characteristics(
    axis: str,
    table: InputOutput,
    reach: float,
    unit: str,
    *,
    line: bool = True,
    zero_sd: float = 0.0,
) -> tuple[Characteristic, ...]:
    """Return the characteristics that a table of inputs and readings can show.

    Parameters
    ----------
    axis : str
    table : InputOutput
        In SI units.
    reach : float
        Largest input that counts as small, SI.
    unit : str
        Unit in which inputs are shown.
    line : bool
        Whether the readings depend on nothing but the input, so that a line describes them.
    zero_sd : float
        Standard deviation of the error that small inputs about zero have in common, SI.
    """
    found = list(_of_line(axis, table) if line else ())
    series = small_inputs(table, reach)
    small = {row for _, rows in series for row in rows.tolist()}
    main = np.setdiff1d(np.arange(len(table.x)), list(small)).astype(np.int64)
    loop = (hysteresis(table.rows(main)) if main.size else None) or hysteresis(table)
    if loop is not None:
        found.append(Characteristic(axis, "hysteresis", loop, unit))
    for centre, rows in series:
        found += _of_small_inputs(axis, table, centre, rows, unit, zero_sd)
    return tuple(found)


def _of_line(axis: str, table: InputOutput) -> Iterator[Characteristic]:
    if len(set(np.round(table.x / table.full_scale, 9).tolist())) < _FEWEST:
        return
    yield Characteristic(axis, "scale factor", scale_factor(table), "1")
    yield Characteristic(axis, "linearity error", linearity_error(table), "ppm")
    difference = asymmetry(table)
    if difference is not None:
        yield Characteristic(axis, "asymmetry", difference, "ppm")
    yield Characteristic(axis, "composite error", composite_error(table), "%")


def _of_small_inputs(
    axis: str, table: InputOutput, centre: float, rows: Indices, unit: str, zero_sd: float
) -> list[Characteristic]:
    own = table.rows(rows)
    top = float(np.abs(own.x - centre).max())
    line = scale_factor(table) if table.full_scale > _LARGER * top else None
    band: Band = response_band(own, centre, line, 0.0 if centre else zero_sd)
    used = tuple(rows.tolist())
    if centre:
        return [Characteristic(axis, "resolution", band.threshold, unit, centre, used)]
    return [
        Characteristic(axis, "threshold", band.threshold, unit, None, used),
        Characteristic(axis, "dead band", band.width, unit, None, used),
    ]


def rows_of_bands(found: Iterable[Characteristic]) -> set[int]:
    """Return the rows with small inputs of the axes with a dead band or a limited resolution."""
    return {row for one in found if one.figure.detected for row in one.rows}


def characteristic_notes(found: Iterable[Characteristic]) -> tuple[str, ...]:
    """Describe the characteristics in words, with one note for each axis."""
    by_axis: dict[str, list[str]] = {}
    for one in found:
        by_axis.setdefault(one.axis, []).append(f"{one.title} {one.text}")
    return tuple(
        f"{axis}, characteristics by IEEE Std 528 (U at 95 %): {'; '.join(texts)}"
        for axis, texts in by_axis.items()
    )


def error_covariance(
    slopes: Mapping[str, Array], declared: Mapping[str, Parameter], rows: Sequence[int]
) -> Array:
    """Return the covariance of readings due to the errors of a bench, (n, n).

    Parameters
    ----------
    slopes : mapping of str to (r,) array
        Derivatives of the readings of one axis with respect to each error.
    declared : mapping of str to Parameter
        The errors that act, with their standard deviations.
    rows : sequence of n int
        The rows of the readings.
    """
    total = np.zeros((len(rows), len(rows)))
    for name, parameter in declared.items():
        if name in slopes and parameter.sd > 0:
            column = parameter.sd * slopes[name][list(rows)]
            total += np.outer(column, column)
    return total
