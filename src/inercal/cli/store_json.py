"""What `inercal store` prints for programs, JSON; numbers in SI."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from math import isnan
from typing import Any

from inercal.sensors import SI_UNITS
from inercal.store import CalibrationEntry, RunEntry, SensorEntry, SensorHistory
from inercal.store.comparison import Comparison
from inercal.store.history import CoefficientTrend


def entry_object(entry: SensorEntry | RunEntry | CalibrationEntry) -> dict[str, Any]:
    """Return an entry; of a calibration not its content."""
    result = asdict(entry)
    result.pop("content", None)
    if isinstance(entry, RunEntry):
        result["files"] = [one._asdict() for one in entry.files]
    return result


def calibration_object(
    entry: CalibrationEntry, rows: Sequence[tuple[str, float, float, str]]
) -> dict[str, Any]:
    """Return a calibration with its coefficients, and the whole of its file as `content`."""
    listed = [{"name": n, "value": v, "std": s, "unit": u} for n, v, s, u in rows]
    return entry_object(entry) | {"coefficients": listed, "content": json.loads(entry.content)}


def comparison_object(compared: Comparison, names: tuple[str, str]) -> dict[str, Any]:
    """Return two calibrations compared."""
    both, std = (compared.first, compared.second), compared.std
    first, second = (
        {"given": name, "sensor": one.sensor.name} for name, one in zip(names, both, strict=True)
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
    """Return a history; slopes are a year of 365.25 days, a line's `time` is at its `value`."""
    steps = zip(history.entries, history.joint_test, strict=True)
    return {
        "sensor": entry_object(history.sensor),
        "calibrations": [
            entry_object(entry) | {"joint": None if joint is None else joint._asdict()}
            for entry, joint in steps
        ],
        "coefficients": [_trend_object(history, one) for one in history.trends],
        "beyond": history.exceedances,
        "by_chance": history.expected_exceedances,
        "left_out": list(history.exclusions),
    }


def _trend_object(history: SensorHistory, course: CoefficientTrend) -> dict[str, Any]:
    line = course.line
    return {
        "name": course.name,
        "unit": SI_UNITS[course.unit],
        "points": [
            {
                "calibration": history.entries[k].id,
                "measured": history.entries[k].measured,
                "value": float(value),
                "std": float(std),
                "en": None if isnan(e) else float(e),
            }
            for k, value, std, e in zip(
                course.points, course.values, course.std, course.normalised_errors, strict=True
            )
        ],
        "line": None if line is None else line._asdict() | {"time": history.date(line.time)},
        "constancy": course.constancy._asdict(),
        "verdict": course.verdict,
    }
