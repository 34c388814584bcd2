"""Write the HTML page with the statistics of a fleet."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan

import numpy as np
from markupsafe import Markup

from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_count
from inercal.calibration.specification import limit_text
from inercal.fleet.figures import control_figure, date_text, distribution_figure
from inercal.fleet.findings import rule_text, summary_lines
from inercal.fleet.statistics import (
    Capability,
    CoefficientStatistics,
    FleetStatistics,
    GroupStatistics,
    RuleYield,
)
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render

_LISTED = 30  # largest number of outliers, lots or stations in a table
_CHARTS = 12  # largest number of stations with a chart
_BELOW_U = "below u"


@dataclass(frozen=True)
class PrintedTable:
    """A table with headings and rows of cells; the first cell is the name of its row."""

    heads: tuple[str, ...]
    rows: list[tuple[str, ...]]
    more: int = 0


def fleet_page(found: FleetStatistics, line: str) -> str:
    """Return the page with a fleet's statistics as HTML.

    Parameters
    ----------
    found : FleetStatistics
    line : str
        Name of the line.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing.
    """
    population = found.population
    limited = [one for one in found.coefficients if one.limits is not None]
    shown = sorted(found.charts, key=lambda one: -one.beyond)[:_CHARTS]
    timed = bool(np.isfinite(population.days).all())
    summary, remarks = summary_lines(found)
    return render(
        "fleet.html",
        package="inercal.fleet",
        line=line,
        under=_under(found),
        summary=summary,
        remarks=[typeset_minus(text) for text in remarks],
        tone="good" if not remarks else "care",
        left_out=population.left_out,
        coefficients=_coefficient_table(found),
        components=_component_table(found),
        capabilities=_capability_table(found, limited),
        yields=_yield_table(found.yields),
        figures=_distribution_figures(found),
        outliers=_outlier_table(found),
        outliers_searched=found.outliers_searched,
        outliers_by_chance=f"{found.outliers_by_chance:g}",
        contrasts=_contrast_table(found),
        contrast_count=len(found.contrasts),
        groups=[
            (name, _group_table(found, groups))
            for name, groups in (("Lots", found.lots), ("Stations", found.stations))
            if groups
        ],
        charts=control_figure(found.centre, shown, "charts", timed) if shown else None,
        chart_count=len(found.charts),
        charts_shown=len(shown),
        centre=f"{found.centre:.2f}",
    )


def _under(found: FleetStatistics) -> str:
    population = found.population
    parts = [
        format_count(len(population.ids), "sensor"),
        format_count(len(population.names), "coefficient"),
    ]
    for grouping, word in ((population.lots, "lots"), (population.stations, "stations")):
        if grouping.several:
            parts.append(f"{len(grouping.names)} {word}")
    days = population.days[np.isfinite(population.days)]
    if days.size:
        parts.append(f"measured {date_text(days.min())} to {date_text(days.max())}")
    return " · ".join(parts)


def _number(value: float, digits: int = 4) -> str:
    """Format a number with some significant digits; only a million or more gets an exponent."""
    return "" if isnan(value) else typeset_minus(f"{float(f'{value:.{digits}g}'):g}")


def _coefficient_table(found: FleetStatistics) -> PrintedTable:
    heads = ("coefficient", "unit", "n", "median", "robust σ", "mean", "sd", "u", "σ in truth",
             "1 %", "99 %")  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for one, term in zip(found.coefficients, found.population.terms, strict=True):
        each = one.summary
        cells = (each.median, each.robust_sd, each.mean, each.sd, each.mean_u)
        truth = _BELOW_U if isnan(each.truth_sd) else _number(each.truth_sd / term.si)
        rows.append(
            (
                one.name, term.unit, str(each.n), *(_number(x / term.si) for x in cells), truth,
                _number(one.quantiles[0] / term.si), _number(one.quantiles[-1] / term.si),
            )
        )  # fmt: skip
    return PrintedTable(heads, rows)


def _component_table(found: FleetStatistics) -> PrintedTable | None:
    if not any(one.components.lots for one in found.coefficients):
        return None
    heads = ("coefficient", "unit", "σ within lots", "95 %", "σ between lots", "95 %")
    rows: list[tuple[str, ...]] = []
    for one, term in zip(found.coefficients, found.population.terms, strict=True):
        cells: list[str] = []
        for part in (one.components.within, one.components.lots):
            low_high = () if part is None else (part.low / term.si, part.high / term.si)
            cells.append("" if part is None else _number(part.sd / term.si))
            cells.append(" to ".join(map(_number, low_high)))
        rows.append((one.name, term.unit, *cells))
    return PrintedTable(heads, rows)


def _capability_table(
    found: FleetStatistics, limited: Sequence[CoefficientStatistics]
) -> PrintedTable:
    terms = dict(zip(found.population.names, found.population.terms, strict=True))
    rows = [
        (
            one.name,
            typeset_minus(limit_text(*one.limits, terms[one.name])),
            *_capability_cells(one.observed),
            *_capability_cells(one.truth),
        )
        for one in limited
        if one.limits is not None
    ]
    return PrintedTable(("coefficient", "limit", "Cpk", "95 %", "Cpk in truth", "95 %"), rows)


def _capability_cells(one: Capability | None) -> tuple[str, str]:
    if one is None:
        return "", ""
    return typeset_minus(f"{one.value:.2f}"), typeset_minus(f"{one.low:.2f} to {one.high:.2f}")


def _yield_table(yields: Sequence[RuleYield]) -> PrintedTable:
    heads = ("rule", "yield", "pass", "conditional pass", "conditional fail", "fail",
             "without a usable result")  # fmt: skip
    rows = [
        (
            rule_text(one),
            f"{100 * one.share:.4g} %",
            *map(str, (*one.counts.values(), one.unjudged)),
        )
        for one in yields
    ]
    return PrintedTable(heads, rows)


def _distribution_figures(found: FleetStatistics) -> list[tuple[str, Markup]]:
    by_axis: dict[str, list[CoefficientStatistics]] = {}
    for one in found.coefficients:
        by_axis.setdefault(CoefficientName(one.name).axis, []).append(one)
    return [
        (axis, distribution_figure(found, chosen, f"axis{k}"))
        for k, (axis, chosen) in enumerate(by_axis.items())
    ]


def _outlier_table(found: FleetStatistics) -> PrintedTable:
    terms = dict(zip(found.population.names, found.population.terms, strict=True))
    rows = [
        (one.id, f"{one.distance:.4g}", one.coefficient,
         f"{_number(one.value / terms[one.coefficient].si)} {terms[one.coefficient].unit}")
        for one in found.outliers[:_LISTED]
    ]  # fmt: skip
    more = max(len(found.outliers) - _LISTED, 0)
    return PrintedTable(("sensor", "squared distance", "largest part", "its value"), rows, more)


def _contrast_table(found: FleetStatistics) -> PrintedTable:
    terms = dict(zip(found.population.names, found.population.terms, strict=True))
    significant = [one for one in found.contrasts if one.significant]
    chosen = sorted(significant, key=lambda one: (one.p_value, -abs(one.value) / one.std))
    rows = [
        (one.coefficient, one.of, _number(one.value / terms[one.coefficient].si),
         _number(2 * one.std / terms[one.coefficient].si, 2), terms[one.coefficient].unit,
         f"{one.p_value:.1g}")
        for one in chosen[:_LISTED]
    ]  # fmt: skip
    heads = ("coefficient", "over, or station", "change", "U (k = 2)", "unit", "p")
    return PrintedTable(heads, rows, max(len(chosen) - _LISTED, 0))


def _group_table(found: FleetStatistics, groups: Sequence[GroupStatistics]) -> PrintedTable:
    """Return a table of groups, with the coefficient that differs most from the fleet."""
    names, terms = found.population.names, found.population.terms
    whole = [one.summary for one in found.coefficients]
    ranked: list[tuple[float, tuple[str, ...]]] = []
    for group in groups:
        off = [
            abs(own.mean - all_.mean) / all_.sd if all_.sd > 0 else 0.0
            for own, all_ in zip(group.summaries, whole, strict=True)
        ]
        k = int(np.argmax([x if isfinite(x) else 0.0 for x in off]))
        own, si = group.summaries[k], terms[k].si
        cells = (_number(x / si) for x in (own.median, own.robust_sd, own.mean, own.sd))
        truth = _BELOW_U if isnan(own.truth_sd) else _number(own.truth_sd / si)
        difference = typeset_minus(f"{(own.mean - whole[k].mean) / (whole[k].sd or 1.0):+.2f}")
        row = (group.name or "(none)", str(own.n), names[k], terms[k].unit, *cells, truth,
               difference)  # fmt: skip
        ranked.append((off[k], row))
    ranked.sort(key=lambda one: -one[0])
    heads = ("name", "n", "farthest coefficient", "unit", "median", "robust σ", "mean", "sd",
             "σ in truth", "from fleet, sd")  # fmt: skip
    return PrintedTable(heads, [row for _, row in ranked[:_LISTED]], max(len(ranked) - _LISTED, 0))
