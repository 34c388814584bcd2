"""The page of a sensor's history, and the section of it that a calibration's report takes."""

from dataclasses import dataclass

from markupsafe import Markup

from inercal.calibration.verdict import p_value_text
from inercal.keys import CoefficientName
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render
from inercal.report.trend_figures import trend_figure
from inercal.store import SensorHistory
from inercal.store.changes import TrendVerdict
from inercal.store.history import CoefficientTrend
from inercal.store.history_text import (
    drift_text,
    format_en,
    format_point,
    format_slope,
    history_lines,
)

_VERDICT_WORDS: dict[TrendVerdict, str] = {
    "drifts": "drifting",
    "changed": "changed",
    "steady": "steady",
}


@dataclass(frozen=True)
class CoefficientHistory:
    """One coefficient: its newest value, E_n, drift a year, verdict and the same in words."""

    name: str
    meaning: str
    value: str
    expanded: str
    unit: str
    en: str
    slope: str
    slope_expanded: str
    verdict: str
    words: str


@dataclass(frozen=True)
class AxisHistory:
    """The coefficients of one axis: rows, figure, and the table of all calibrations."""

    axis: str
    rows: tuple[CoefficientHistory, ...]
    figure: Markup
    heads: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class PrintedCalibration:
    """One calibration as printed."""

    number: str
    date: str
    method: str
    bench: str
    run: str
    by: str
    p_value: str


def page(history: SensorHistory) -> str:
    """Return the whole page, HTML."""
    groups = _axis_histories(history)
    return render(
        "over_time.html",
        history=history,
        first=_date(history.entries[0].measured),
        last=_date(history.entries[-1].measured),
        tone="good" if set(history.verdicts) <= {"steady", "too few"} else "care",
        summary=summary_lines(history)[0],
        lines=summary_lines(history)[1:],
        section=_render_section(groups),
        groups=groups,
        entries=_entry_rows(history),
    )


def history_section(history: SensorHistory) -> Markup:
    """Return the figures and the table of verdicts, HTML."""
    return _render_section(_axis_histories(history))


def summary_lines(history: SensorHistory) -> list[Markup]:
    """Return what the history says as a whole, in sentences; the first is the summary."""
    named = [
        f"{word}: {', '.join(names)}"
        for verdict, word in _VERDICT_WORDS.items()
        if verdict != "steady" and (names := history.verdicts.get(verdict, ()))
    ]
    told = [_verdict_counts(history), *named, *history_lines(history)]
    return [_sentence(line) for line in told]


def _render_section(groups: list[AxisHistory]) -> Markup:
    return Markup(render("over_time_section.html", groups=groups))  # of a template that escapes


def _verdict_counts(history: SensorHistory) -> str:
    told = [
        f"{len(names)} {word}"
        for verdict, word in _VERDICT_WORDS.items()
        if (names := history.verdicts.get(verdict, ()))
    ]
    return f"coefficients: {', '.join(told)}" if told else "one calibration: nothing to compare"


def _sentence(line: str) -> Markup:
    text = Markup.escape(typeset_minus(f"{line[0].upper()}{line[1:]}."))
    return text.replace("E_n", Markup("E<sub>n</sub>"))


def _axis_histories(history: SensorHistory) -> list[AxisHistory]:
    by_axis: dict[str, list[CoefficientTrend]] = {}
    for course in history.trends:
        by_axis.setdefault(CoefficientName(course.name).axis, []).append(course)
    return [
        AxisHistory(
            axis,
            tuple(map(_coefficient_row, found)),
            trend_figure(history, found, f"axis{k}"),
            tuple(f"{CoefficientName(one.name).term}\n{one.unit}" for one in found),
            tuple(
                (f"#{entry.id}", _date(entry.measured), *(_cell(one, place) for one in found))
                for place, entry in enumerate(history.entries)
            ),
        )
        for k, (axis, found) in enumerate(by_axis.items())
    ]


def _coefficient_row(course: CoefficientTrend) -> CoefficientHistory:
    value, expanded = format_point(course, -1)
    rate, rate_expanded = format_slope(course)
    return CoefficientHistory(
        course.name,
        course.meaning,
        typeset_minus(value),
        expanded,
        course.unit,
        typeset_minus(format_en(float(course.normalised_errors[-1]))),
        typeset_minus(rate),
        rate_expanded,
        course.verdict,
        typeset_minus(drift_text(course)),
    )


def _cell(course: CoefficientTrend, place: int) -> str:
    if place not in course.points:
        return ""
    k = course.points.index(place)
    star = " *" if abs(course.normalised_errors[k]) > 1 else ""
    return typeset_minus(" ± ".join(format_point(course, k))) + star


def _entry_rows(history: SensorHistory) -> list[PrintedCalibration]:
    return [
        PrintedCalibration(
            f"#{entry.id}",
            _date(entry.measured),
            f"{entry.method}, {entry.estimator}",
            f"{entry.bench} ({entry.kind})" if entry.bench and entry.kind else entry.kind,
            "" if entry.run is None else str(entry.run),
            entry.by,
            "" if joint is None else p_value_text(joint.p_value).removeprefix("= "),
        )
        for entry, joint in zip(history.entries, history.joint_test, strict=True)
    ]


def _date(time: str) -> str:
    return time.partition("T")[0]
