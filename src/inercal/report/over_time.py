"""The page of a sensor's history, and the section of it that a calibration's report takes."""

from dataclasses import dataclass

from markupsafe import Markup

from inercal.calibration.verdict import chance
from inercal.keys import CoefficientName
from inercal.report.over_time_figure import courses
from inercal.report.tables import minus
from inercal.report.templates import render
from inercal.store import History
from inercal.store.changes import Verdict
from inercal.store.history import Course
from inercal.store.words import drift, en, of_history, point, slope

_WORDS: dict[Verdict, str] = {"drifts": "drifting", "changed": "changed", "steady": "steady"}


@dataclass(frozen=True)
class Row:
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
class Group:
    """The coefficients of one axis: rows, figure, and the table of all calibrations."""

    axis: str
    rows: tuple[Row, ...]
    figure: Markup
    heads: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Entry:
    """One calibration as printed."""

    number: str
    date: str
    method: str
    bench: str
    run: str
    by: str
    p_value: str


def page(history: History) -> str:
    """Return the whole page, HTML."""
    groups = _groups(history)
    return render(
        "over_time.html",
        history=history,
        first=_date(history.entries[0].measured),
        last=_date(history.entries[-1].measured),
        tone="good" if set(history.verdicts) <= {"steady", "too few"} else "care",
        summary=lines(history)[0],
        lines=lines(history)[1:],
        section=_section(groups),
        groups=groups,
        entries=_entries(history),
    )


def section(history: History) -> Markup:
    """Return the figures and the table of verdicts, HTML."""
    return _section(_groups(history))


def lines(history: History) -> list[Markup]:
    """Return what the history says as a whole, in sentences; the first is the summary."""
    named = [
        f"{word}: {', '.join(names)}"
        for verdict, word in _WORDS.items()
        if verdict != "steady" and (names := history.verdicts.get(verdict, ()))
    ]
    told = [_summary(history), *named, *of_history(history)]
    return [_sentence(line) for line in told]


def _section(groups: list[Group]) -> Markup:
    return Markup(render("over_time_section.html", groups=groups))  # of a template that escapes


def _summary(history: History) -> str:
    told = [
        f"{len(names)} {word}"
        for verdict, word in _WORDS.items()
        if (names := history.verdicts.get(verdict, ()))
    ]
    return f"coefficients: {', '.join(told)}" if told else "one calibration: nothing to compare"


def _sentence(line: str) -> Markup:
    text = Markup.escape(minus(f"{line[0].upper()}{line[1:]}."))
    return text.replace("E_n", Markup("E<sub>n</sub>"))


def _groups(history: History) -> list[Group]:
    by_axis: dict[str, list[Course]] = {}
    for course in history.courses:
        by_axis.setdefault(CoefficientName(course.name).axis, []).append(course)
    return [
        Group(
            axis,
            tuple(map(_row, found)),
            courses(history, found, f"axis{k}"),
            tuple(f"{CoefficientName(one.name).term}\n{one.unit}" for one in found),
            tuple(
                (f"#{entry.id}", _date(entry.measured), *(_cell(one, place) for one in found))
                for place, entry in enumerate(history.entries)
            ),
        )
        for k, (axis, found) in enumerate(by_axis.items())
    ]


def _row(course: Course) -> Row:
    value, expanded = point(course, -1)
    rate, rate_expanded = slope(course)
    return Row(
        course.name,
        course.meaning,
        minus(value),
        expanded,
        course.unit,
        minus(en(float(course.normalised[-1]))),
        minus(rate),
        rate_expanded,
        course.verdict,
        minus(drift(course)),
    )


def _cell(course: Course, place: int) -> str:
    if place not in course.points:
        return ""
    k = course.points.index(place)
    star = " *" if abs(course.normalised[k]) > 1 else ""
    return minus(" ± ".join(point(course, k))) + star


def _entries(history: History) -> list[Entry]:
    return [
        Entry(
            f"#{entry.id}",
            _date(entry.measured),
            f"{entry.method}, {entry.estimator}",
            f"{entry.bench} ({entry.kind})" if entry.bench and entry.kind else entry.kind,
            "" if entry.run is None else str(entry.run),
            entry.by,
            "" if joint is None else chance(joint.p_value).removeprefix("= "),
        )
        for entry, joint in zip(history.entries, history.joint, strict=True)
    ]


def _date(time: str) -> str:
    return time.partition("T")[0]
