"""Output of `inercal store`: tables for the terminal, and JSON objects with numbers in SI."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from math import isnan
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from inercal.calibration.verdict import COVERAGE
from inercal.cli.terminal import terminal
from inercal.keys import CoefficientName
from inercal.sensors import SI_UNITS
from inercal.store import CalibrationEntry, RunEntry, SensorEntry, SensorHistory
from inercal.store.comparison import Comparison
from inercal.store.history import CoefficientTrend
from inercal.store.history_text import (
    comparison_lines,
    drift_text,
    format_en,
    format_point,
    format_slope,
    grade_text,
    history_lines,
)
from inercal.units import format_value_and_uncertainty

_TIME_SOURCES = {
    "stated": "as stated",
    "run": "start of the run",
    "created": "creation of the calibration",
}
_MAX_LINE, _MAX_CELL = 2000, 200  # characters
_RIGHT_ALIGNED = ("value", "±", "E_n", "difference", "newest", "drift", "calibrations")


def print_sensors(entries: Sequence[SensorEntry]) -> None:
    """Print sensors, one a row."""
    table = _table("sensor", "axes", "calibrations", "last", "entered by", "on")
    for one in entries:
        cells = (one.name, " ".join(one.axes), str(one.calibrations), one.last or "never", one.by)
        _row(table, *cells, _date(one.at))
    terminal().print(table)


def print_runs(entries: Sequence[RunEntry], limit: int | None = None) -> None:
    """Print runs, one a row; a line says that `limit` may have left out earlier ones."""
    table = _table("run", "sensor", "bench", "begun", "state", "folder", "entered by")
    for one in entries:
        begun = one.begun.replace("T", " ")[:16]
        bench = _bench_text(one.kind, one.bench)
        _row(table, str(one.id), one.sensor, bench, begun, one.state, one.folder, one.by)
    terminal().print(table)
    if len(entries) == limit:
        _print_line(f"the newest {limit} runs; --all lists all")


def print_sensor(
    sensor: SensorEntry,
    calibrations: Sequence[CalibrationEntry],
    runs: Sequence[RunEntry],
    limit: int | None = None,
) -> None:
    """Print a sensor, its calibrations and its runs; a line says what `limit` left out."""
    _print_line(
        f"{sensor.name}: {', '.join(sensor.axes)}; entered by {sensor.by} on {_date(sensor.at)}"
    )
    table = _table(
        "number", "measured", "method", "estimator", "bench", "verdict", "run", "entered by"
    )
    for one in calibrations:
        run = "" if one.run is None else str(one.run)
        bench = _bench_text(one.kind, one.bench)
        cells = (f"#{one.id}", _date(one.measured), one.method, one.estimator, bench)
        _row(table, *cells, grade_text(one.grade), run, one.by)
    if calibrations:
        terminal().print(table)
    if len(calibrations) < sensor.calibrations:
        _print_line(
            f"the newest {len(calibrations)} of {sensor.calibrations} calibrations; --all lists all"
        )
    if runs:
        print_runs(runs, limit)
    if not (calibrations or runs):
        _print_line("no calibrations and no runs yet")


def print_calibration(entry: CalibrationEntry, run: RunEntry | None) -> None:
    """Print one calibration: its origin, hashes and coefficients."""
    calibration = entry.calibration
    source = _TIME_SOURCES.get(entry.measured_from, entry.measured_from)
    facts = {
        "measured": f"{entry.measured} ({source})",
        "method": f"{entry.method}, {entry.estimator}",
        "bench": _bench_text(entry.kind, entry.bench),
        "verdict": grade_text(entry.grade),
        "frame": calibration.frame,
        **{name: text for name, text in calibration.conditions.items() if name != "bench"},
        **calibration.provenance,
        "calibration sha256": entry.sha256,
        "entered": f"by {entry.by}, {entry.at}",
    }
    if run is not None:
        facts["run"] = f"{run.id}, begun {run.begun}, {run.state}, {run.folder}"
        facts |= {f"{one.name} sha256": one.sha256 for one in run.files}
    _print_line(f"calibration #{entry.id} of {entry.sensor}")
    for name, text in facts.items():
        if text:
            _print_line(f"{name}: {text}")
    table = _table("coefficient", "meaning", "value", "± U (k = 2)", "unit")
    previous = ""
    rows = zip(calibration.sensor.coefficients, calibration.values, calibration.std, strict=True)
    for name, value, std in rows:
        previous = _begin_section(table, name, previous)
        line = calibration.sensor.coefficient(name)
        cells = format_value_and_uncertainty(value / line.si, COVERAGE * std / line.si)
        _row(table, name, line.meaning, *cells, line.unit)
    terminal().print(table)
    for note in calibration.notes:
        _print_line(f"· {note}")


def print_history(history: SensorHistory, *, detailed: bool) -> None:
    """Print a history: a row of each coefficient, or of each calibration where `detailed`."""
    first, last = (_date(history.entries[k].measured) for k in (0, -1))
    count = len(history.entries)
    times = f"calibrations, {first} to {last}" if count > 1 else f"calibration, {first}"
    _print_line(f"{history.sensor.name}: {count} {times}")
    if detailed:
        for trend in history.trends:
            _print_trend(history, trend)
    else:
        _print_trends(history)
    for line in history_lines(history):
        _print_line(line)


def _print_trends(history: SensorHistory) -> None:
    table = _table(
        "coefficient", "newest", "± U (k = 2)", "unit", "E_n", "drift a year", "± U", "verdict"
    )
    previous = ""
    for one in history.trends:
        previous = _begin_section(table, one.name, previous)
        last = format_en(float(one.normalised_errors[-1]))
        _row(
            table, one.name, *format_point(one, -1), one.unit, last, *format_slope(one), one.verdict
        )
    terminal().print(table)


def _print_trend(history: SensorHistory, trend: CoefficientTrend) -> None:
    table = _table("number", "measured", f"value, {trend.unit}", "± U (k = 2)", "E_n")
    table.title = f"{trend.name}, {trend.meaning}"
    for k, one in enumerate(trend.points):
        entry = history.entries[one]
        cells = (f"#{entry.id}", _date(entry.measured), *format_point(trend, k))
        _row(table, *cells, format_en(float(trend.normalised_errors[k])))
    terminal().print(table)
    _print_line(f"{trend.name}: {trend.verdict}; {drift_text(trend)}")


def print_comparison(compared: Comparison, names: tuple[str, str]) -> None:
    """Print two calibrations, coefficient by coefficient, and the tests of all."""
    table = _table(
        "coefficient", "value 1", "± U", "value 2", "± U", "difference", "± U", "unit", "E_n"
    )
    _print_line(f"1: {names[0]}; 2: {names[1]}; U with k = 2")
    previous = ""
    both, std = (compared.first, compared.second), compared.std
    for k, name in enumerate(compared.names):
        previous = _begin_section(table, name, previous)
        line = compared.second.sensor.coefficient(name)
        numbers = [(one.value(name), float(u[k])) for one, u in zip(both, std, strict=True)]
        numbers.append((float(compared.difference[k]), float(np.hypot(std[0][k], std[1][k]))))
        cells = [
            cell
            for x, u in numbers
            for cell in format_value_and_uncertainty(x / line.si, COVERAGE * u / line.si)
        ]
        _row(table, name, *cells, line.unit, format_en(float(compared.normalised_errors[k])))
    terminal().print(table)
    for line in comparison_lines(compared):
        _print_line(line)


def _bench_text(kind: str, name: str) -> str:
    return f"{name} ({kind})" if kind and name else kind or name


def _date(time: str) -> str:
    return time.partition("T")[0]


def _table(*heads: str) -> Table:
    table = Table()
    for head in heads:
        table.add_column(head, justify="right" if head.startswith(_RIGHT_ALIGNED) else "left")
    return table


def _row(table: Table, *cells: str) -> None:
    # Texts, not markup: names come from files.
    cells = tuple(cell if len(cell) <= _MAX_CELL else f"{cell[:_MAX_CELL]}…" for cell in cells)
    table.add_row(*(Text(cell, style="bold red" if cell.endswith(" *") else "") for cell in cells))


def _begin_section(table: Table, name: str, previous: str) -> str:
    """Begin a section of the table where another axis begins; return the axis."""
    axis = CoefficientName(name).axis
    if previous and axis != previous:
        table.add_section()
    return axis


def _print_line(text: str) -> None:
    """Print a line; one that no person reads to its end is cut."""
    if len(text) > _MAX_LINE:
        text = f"{text[:_MAX_LINE]}… ({len(text)} characters; --json prints all)"
    terminal(highlight=False).print(Text(text))


def entry_object(entry: SensorEntry | RunEntry | CalibrationEntry) -> dict[str, Any]:
    """Return an entry, without the file of a calibration."""
    result = asdict(entry)
    result.pop("content", None)
    if isinstance(entry, RunEntry):
        result["files"] = [file._asdict() for file in entry.files]
    return result


def calibration_object(
    entry: CalibrationEntry, rows: Sequence[tuple[str, float, float, str]]
) -> dict[str, Any]:
    """Return a calibration with its coefficients, and the content of its file.

    Raises
    ------
    InputError
        The register's text is not what was entered.
    """
    _ = entry.calibration  # proves the text
    listed = [{"name": n, "value": v, "std": s, "unit": u} for n, v, s, u in rows]
    return entry_object(entry) | {"coefficients": listed, "content": json.loads(entry.content)}


def comparison_object(compared: Comparison, names: tuple[str, str]) -> dict[str, Any]:
    """Return the comparison of two calibrations."""
    both, std = (compared.first, compared.second), compared.std
    first, second = (
        {"given": name, "sensor": each.sensor.name} for name, each in zip(names, both, strict=True)
    )
    return {
        "first": first,
        "second": second,
        "coefficients": [
            {
                "name": name,
                "unit": SI_UNITS[compared.second.sensor.coefficient(name).unit],
                "first": {"value": both[0].value(name), "std": float(std[0][k])},
                "second": {"value": both[1].value(name), "std": float(std[1][k])},
                "difference": float(compared.difference[k]),
                "en": float(compared.normalised_errors[k]),
            }
            for k, name in enumerate(compared.names)
        ],
        "one_recording": compared.same_recording,
        "beyond": compared.exceedances,
        "by_chance": compared.expected_exceedances,
        "joint": None if compared.joint_test is None else compared.joint_test._asdict(),
        "left_out": list(compared.exclusions),
    }


def history_object(history: SensorHistory) -> dict[str, Any]:
    """Return a history; slopes are per year of 365.25 days, `time` of a line belongs to `value`."""
    steps = zip(history.entries, history.joint_test, strict=True)
    return {
        "sensor": entry_object(history.sensor),
        "calibrations": [
            entry_object(entry) | {"joint": None if joint is None else joint._asdict()}
            for entry, joint in steps
        ],
        "coefficients": [_trend_object(history, trend) for trend in history.trends],
        "beyond": history.exceedances,
        "by_chance": history.expected_exceedances,
        "left_out": list(history.exclusions),
    }


def _trend_object(history: SensorHistory, trend: CoefficientTrend) -> dict[str, Any]:
    line = trend.line
    return {
        "name": trend.name,
        "unit": SI_UNITS[trend.unit],
        "points": [
            {
                "calibration": history.entries[k].id,
                "measured": history.entries[k].measured,
                "value": float(value),
                "std": float(std),
                "en": None if isnan(e) else float(e),
            }
            for k, value, std, e in zip(
                trend.points, trend.values, trend.std, trend.normalised_errors, strict=True
            )
        ],
        "line": None if line is None else line._asdict() | {"time": history.date(line.time)},
        "constancy": trend.constancy._asdict(),
        "verdict": trend.verdict,
    }
