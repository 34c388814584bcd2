"""Show what `inercal store` finds, as tables on the terminal or as JSON objects in SI."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from inercal.basics.documents import attributes
from inercal.basics.units import format_count
from inercal.calibration.comparison.courses import CourseFit
from inercal.calibration.comparison.run_to_run import format_en, grade_text
from inercal.cli.calibration_view import print_calibration_table, run_to_run_object
from inercal.cli.console import axis_of, number_heads, print_line, print_lines, print_table
from inercal.laboratory.store import (
    CalibrationEntry,
    RunEntry,
    SensorEntry,
    SensorHistory,
    history_text,
)
from inercal.laboratory.store.history import CoefficientTrend
from inercal.laboratory.store.noise_history import NoiseEntry, noise_entry_object, noise_trends
from inercal.laboratory.store.recalibration import Recalibration
from inercal.physics.sensors import SI_UNITS

_TIME_SOURCES = {
    "stated": "as stated",
    "run": "start of the run",
    "created": "creation of the calibration",
}
_RIGHT_ALIGNED = ("value", "±", "E_n", "newest", "drift", "calibrations")
_NOISE_NUMBERS = ("number", "first", "newest", "value", "U (k = 2)", "E_n")


def print_sensors(entries: Sequence[SensorEntry]) -> None:
    """Print sensors, one per row."""
    _print(
        ("sensor", "axes", "calibrations", "last", "entered by", "on"),
        [
            (one.name, " ".join(one.axes), str(one.calibrations), one.last or "never", one.by,
             _date(one.at))
            for one in entries
        ],
    )  # fmt: skip


def print_runs(entries: Sequence[RunEntry], limit: int | None = None) -> None:
    """Print runs, one per row, with a note if earlier runs may be missing because of `limit`."""
    _print(
        ("run", "sensor", "bench", "begun", "state", "folder", "entered by"),
        [
            (str(one.id), one.sensor, _bench_text(one.kind, one.bench),
             one.begun.replace("T", " ")[:16], one.state, one.folder, one.by)
            for one in entries
        ],
    )  # fmt: skip
    if len(entries) == limit:
        print_line(f"the newest {limit} runs; --all lists all")


def print_sensor(
    sensor: SensorEntry,
    calibrations: Sequence[CalibrationEntry],
    runs: Sequence[RunEntry],
    limit: int | None = None,
) -> None:
    """Print a sensor, its calibrations and its runs, with a note about entries beyond `limit`."""
    print_line(
        f"{sensor.name}: {', '.join(sensor.axes)}; entered by {sensor.by} on {_date(sensor.at)}"
    )
    if calibrations:
        _print(
            ("number", "measured", "method", "estimator", "bench", "verdict", "run", "entered by"),
            [
                (f"#{one.id}", _date(one.measured), one.method, one.estimator,
                 _bench_text(one.kind, one.bench), grade_text(one.grade),
                 "" if one.run is None else str(one.run), one.by)
                for one in calibrations
            ],
        )  # fmt: skip
    if len(calibrations) < sensor.calibrations:
        print_line(
            f"the newest {len(calibrations)} of {sensor.calibrations} calibrations; --all lists all"
        )
    if runs:
        print_runs(runs, limit)
    if not (calibrations or runs):
        print_line("no calibrations or runs yet")


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
        **calibration.job,
        **{name: text for name, text in calibration.conditions.items() if name != "bench"},
        **calibration.provenance,
        "calibration sha256": entry.sha256,
        "entered": f"by {entry.by}, {entry.at}",
    }
    if run is not None:
        facts["run"] = f"{run.id}, begun {run.begun}, {run.state}, {run.folder}"
        facts |= {f"{one.name} sha256": one.sha256 for one in run.files}
    print_line(f"calibration #{entry.id} of {entry.sensor}")
    print_lines(f"{name}: {text}" for name, text in facts.items() if text)
    print_calibration_table(calibration)


def print_history(history: SensorHistory, *, detailed: bool) -> None:
    """Print a history with a row per coefficient or, if `detailed`, per calibration."""
    first, last = (_date(history.entries[k].measured) for k in (0, -1))
    count = len(history.entries)
    until = f" to {last}" if count > 1 else ""
    print_line(f"{history.sensor.name}: {format_count(count, 'calibration')}, {first}{until}")
    if detailed:
        for trend in history.trends:
            _print_trend(history, trend)
    else:
        _print(
            ("coefficient", "newest", "± U (k = 2)", "unit", "E_n", "± U of the mean",
             "± U of the next use", "drift per year", "± U", "verdict"),
            [
                (one.name, *history_text.format_point(one, -1), one.unit,
                 format_en(float(one.normalised_errors[-1])), *history_text.format_bands(one),
                 *history_text.format_slope(one), one.verdict)
                for one in history.trends
            ],
            section=axis_of,
        )  # fmt: skip
    print_lines(history_text.history_lines(history))


def _print_trend(history: SensorHistory, trend: CoefficientTrend) -> None:
    rows: list[tuple[str, ...]] = []
    for k, one in enumerate(trend.points):
        entry, en = history.entries[one], format_en(float(trend.normalised_errors[k]))
        rows.append(
            (f"#{entry.id}", _date(entry.measured), *history_text.format_point(trend, k), en)
        )
    heads = ("number", "measured", f"value, {trend.unit}", "± U (k = 2)", "E_n")
    _print(heads, rows, title=f"{trend.name}, {trend.meaning}")
    print_line(f"{trend.name}: {trend.verdict}; {history_text.drift_text(trend)}")


def print_recalibration(found: Recalibration) -> None:
    """Print the calibration interval for each coefficient in days, and the next date."""
    if found.rows:
        heads, cells = history_text.interval_table(found)
        rows = zip(found.rows, cells, strict=True)
        print_table(
            ("coefficient", "limit", *(f">{head}" for head in heads)),
            [(one.name, history_text.limit_text(found, one), *row) for one, row in rows],
        )
    print_lines(history_text.recalibration_lines(found))


def print_newest_noise(entries: Sequence[NoiseEntry]) -> None:
    """Print the newest value of each noise coefficient, with its date and U."""
    if entries:
        rows = history_text.newest_rows(noise_trends(tuple(entries)))
        print_table(
            number_heads(history_text.NEWEST_HEADS, _NOISE_NUMBERS),
            rows,
            title="noise",
            section=str,
        )


def print_noise_history(entries: Sequence[NoiseEntry]) -> None:
    """Print the noise coefficients over time, and which of them changed."""
    if not entries:
        return
    first, last = (_date(one.measured) for one in (entries[0], entries[-1]))
    count = format_count(len(entries), "noise analysis", "noise analyses")
    print_line(f"{count}, {first}" + (f" to {last}" if last != first else ""))
    trends = noise_trends(tuple(entries))
    print_table(number_heads(history_text.HEADS, _NOISE_NUMBERS), history_text.trend_rows(trends))
    print_lines(history_text.change_lines(trends))


def _bench_text(kind: str, name: str) -> str:
    return f"{name} ({kind})" if kind and name else kind or name


def _date(time: str) -> str:
    return time.partition("T")[0]


def _print(heads: Sequence[str], rows: Sequence[Sequence[str]], **options: Any) -> None:
    print_table(number_heads(heads, _RIGHT_ALIGNED), rows, **options)


def entry_object(entry: SensorEntry | RunEntry | CalibrationEntry) -> dict[str, Any]:
    """Return an entry for JSON, without the contents of a calibration file."""
    result = asdict(entry)
    result.pop("content", None)
    if isinstance(entry, RunEntry):
        result["files"] = [file._asdict() for file in entry.files]
    return result


def calibration_object(
    entry: CalibrationEntry, rows: Sequence[tuple[str, float, float, str]]
) -> dict[str, Any]:
    """Return a calibration for JSON, with its coefficients and the contents of its file.

    Raises
    ------
    InputError
        The text in the register differs from the text that was entered.
    """
    _ = entry.calibration  # verifies the text
    listed = [{"name": n, "value": v, "std": s, "unit": u} for n, v, s, u in rows]
    return entry_object(entry) | {"coefficients": listed, "content": json.loads(entry.content)}


def history_object(history: SensorHistory) -> dict[str, Any]:
    """Return a history for JSON; slopes are per year of 365.25 days.

    The `time` of a line belongs to its `value`.
    """
    steps = zip(history.entries, history.joint_test, strict=True)
    return {
        "sensor": entry_object(history.sensor),
        "calibrations": [
            entry_object(entry) | {"joint": None if joint is None else joint._asdict()}
            for entry, joint in steps
        ],
        "coefficients": [_trend_object(history, trend) for trend in history.trends],
        "run_to_run": run_to_run_object(history_text.newest_run_to_run(history)),
        "beyond": history.exceedances,
        "by_chance": history.expected_exceedances,
        "left_out": list(history.exclusions),
    }


def _line_object(history: SensorHistory, line: CourseFit) -> dict[str, Any]:
    return {
        "time": history.date(line.time),
        "value": float(line.beta[0]),
        "value_U": float(line.expanded(np.array([line.time]))[0]),
        "slope": line.slope.slope,
        "slope_std": line.slope.std,
        "slope_U": line.slope.expanded,
        "scatter": line.tau,
        "chi2": line.chi2,
        "dof": line.dof,
    }


def _bands_object(trend: CoefficientTrend) -> dict[str, Any] | None:
    """Return the mean and both U at the newest calibration, and the trends that were compared."""
    course, courses = trend.course, trend.courses
    if course is None or courses is None:
        return None
    at = trend.time[-1:]
    return {
        "value": float(course.evaluate(at)[0]),
        "mean_U": float(course.expanded(at)[0]),
        "next_use_U": float(course.expanded(at, next_use=True)[0]),
        "scatter": course.tau,
        "walk": courses.walk.walk,
        "dof": course.dof,
        "log_likelihood": courses.likelihood,
        "best": courses.best,
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
                "en": float(e),
            }
            for k, value, std, e in zip(
                trend.points, trend.values, trend.std, trend.normalised_errors, strict=True
            )
        ],
        "line": None if line is None else _line_object(history, line),
        "next_use": _bands_object(trend),
        "constancy": trend.constancy._asdict(),
        "verdict": trend.verdict,
    }


def recalibration_object(found: Recalibration) -> dict[str, Any]:
    """Return the next calibration for JSON; intervals are in years of 365.25 days."""
    return {
        **attributes(found, "date years decided_by longest hours_in_use operating_hours"),
        "pool": None
        if found.pool is None
        else {
            "type": found.pool.type_name,
            "sensors": list(found.pool.sensors),
            "longest": found.pool.longest,
        },
        "coefficients": [
            {
                "name": one.name,
                "lower": one.limit.lower,
                "upper": one.limit.upper,
                "U": one.limit.expanded,
                "predicted_U": one.expanded,
                **attributes(one, "prediction chart staircase hours sensors"),
            }
            for one in found.rows
        ],
    }


def noise_object_list(entries: Sequence[NoiseEntry]) -> list[dict[str, Any]]:
    """Return noise entries for JSON, oldest first, each with E_n relative to the previous one."""
    errors = {
        (entry.id, trend.channel, trend.symbol): en
        for trend in noise_trends(tuple(entries))
        for entry, en in zip(trend.entries, trend.normalised_errors, strict=True)
    }
    found = [noise_entry_object(one) for one in entries]
    for entry in found:
        for one in entry["coefficients"]:
            one["en"] = errors.get((entry["id"], one["channel"], one["symbol"]))
    return found
