"""The part of a report on temperature: curves with bands, a table, orders and soaks left out."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS, format_value_and_uncertainty
from inercal.calibration.temperature_curves import TemperatureCurve, temperature_curves
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.pipeline import Outcome
from inercal.pipeline.temperature_fit import SoakLeftOut
from inercal.pipeline.temperature_orders import OrderTest
from inercal.report import drawing
from inercal.report.report_tables import typeset_minus

_POINTS = 60
_TABLE_ROWS = 7
_COLUMNS = 3
_BEST_ORDERS = 5


@dataclass(frozen=True)
class TemperatureSection:
    """What the page shows of temperatures."""

    figure: Markup
    celsius: tuple[str, ...]
    rows: list[tuple[str, str, str, list[str]]]  # name, meaning, unit, value ± U at each
    orders: tuple[OrderTest, ...]
    left_out: tuple[SoakLeftOut, ...]
    zero: float = ZERO_CELSIUS


def temperature_section(outcome: Outcome) -> TemperatureSection | None:
    """Return the section; None where no coefficient depends on a temperature that varied."""
    calibration, found = outcome.calibration, outcome.temperature_fit
    limits = None if calibration.validity is None else calibration.validity.temperature
    if limits is None or not calibration.sensor.uses("dT") or limits[1] - limits[0] < 1.0:
        return None
    course: Array = np.linspace(limits[0], limits[1], _POINTS)
    stated = np.zeros(0) if found is None else np.unique(np.round(found.soaks, 1))
    if not 1 < stated.size <= _TABLE_ROWS:
        stated = np.linspace(limits[0], limits[1], _TABLE_ROWS)
    kelvin: Array = np.clip(stated, *limits)
    tests = () if found is None else tuple(sorted(found.tests, key=lambda one: one.excess))
    return TemperatureSection(
        curve_figure(temperature_curves(calibration, course), course),
        tuple(typeset_minus(f"{t - ZERO_CELSIUS:.1f} °C") for t in kelvin.tolist()),
        _temperature_rows(temperature_curves(calibration, kelvin)),
        tests[:_BEST_ORDERS],
        () if found is None else found.left_out,
    )


def _temperature_rows(
    curves: Sequence[TemperatureCurve],
) -> list[tuple[str, str, str, list[str]]]:
    rows: list[tuple[str, str, str, list[str]]] = []
    for one in curves:
        cells: list[str] = []
        for value, std in zip(one.value.tolist(), one.std.tolist(), strict=True):
            shown, expanded = format_value_and_uncertainty(value / one.si, COVERAGE * std / one.si)
            cells.append(f"{typeset_minus(shown)} ± {expanded}")
        change = "" if one.complete else ", change from the reference temperature"
        rows.append((one.name, one.meaning + change, one.unit, cells))
    return rows


@drawing.style
def curve_figure(curves: Sequence[TemperatureCurve], kelvin: Array) -> Markup:
    """Return the curves with bands of ±2 u, a panel for each coefficient of all axes."""
    named: dict[str, list[TemperatureCurve]] = {}
    for one in curves:
        axis, term = CoefficientName(one.name).parts
        named.setdefault(f"{axis[0]} {term}", []).append(one)
    figure, places = drawing.grid(1.7, 0.45, len(named), _COLUMNS)
    celsius = kelvin - ZERO_CELSIUS
    for axes, members in zip(places, named.values(), strict=True):
        for k, one in enumerate(members):
            colour = drawing.AXES[k % len(drawing.AXES)]
            y, reach = one.value / one.si, COVERAGE * one.std / one.si
            axes.fill_between(celsius, y - reach, y + reach, color=colour, alpha=0.25, lw=0)
            axes.plot(celsius, y, color=colour, lw=1.0, label=CoefficientName(one.name).axis)
        first = members[0]
        axes.set_title(CoefficientName(first.name).term)
        axes.set_ylabel(first.unit)
        axes.set_xlabel("temperature, °C")
        drawing.add_legend(axes)
    return drawing.svg(figure, "temperature", "Coefficients against temperature, with bands")
