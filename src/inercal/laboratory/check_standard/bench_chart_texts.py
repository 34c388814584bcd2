"""Describe the control charts of a bench in words, and convert them to a JSON object."""

from typing import Any

import numpy as np

from inercal.basics.documents import origin, record_object
from inercal.basics.units import format_count
from inercal.estimation.uncertainty.control_charts import EWMA_WEIGHT
from inercal.laboratory.check_standard.bench_charts import BenchCharts
from inercal.laboratory.check_standard.chart_texts import (
    day,
    doubtful_text,
    opening_line,
    signal_text,
)

SCHEMA = "inercal/control/bench/1"


def bench_lines(found: BenchCharts) -> list[str]:
    """Return text lines with the results of the charts; the most serious result comes first."""
    lines = [opening_line([(one.measured, one.in_control) for one in found.points])]
    lines += [doubtful_text(one) for one in found.episodes]
    lines.append(
        "while the bench is in control, a false alarm from any of the charts is expected once "
        f"in {found.run_length:.0f} days or more (for each of the {2 * len(found.charts)} "
        f"charts, once in {found.single_run_length:.0f} days)"
    )
    if found.too_few:
        named = ", ".join(
            f"{name} ({format_count(count, 'day')})" for name, count in found.too_few.items()
        )
        lines.append(f"not charted, because they have fewer days than the reference: {named}")
    return lines


def day_signals(found: BenchCharts) -> list[tuple[str, str]]:
    """Return the days that are out of control, and the charts that give a signal on each day."""
    return [
        (day(one.measured), "; ".join(signal_text(*part) for part in one.signals.items()))
        for one in found.points
        if not one.in_control
    ]


def bench_charts_object(found: BenchCharts) -> dict[str, Any]:
    """Return the charts as a JSON object; values are in SI units, and statistics have no unit."""
    kind = found.lasting_kind.lower()
    return {
        "schema": SCHEMA,
        "bench": found.bench,
        "in_control": found.in_control,
        "run_length": {"all": found.run_length, "single": found.single_run_length},
        "weights": {"EWMA": EWMA_WEIGHT},
        "lasting": found.lasting_kind,
        "parameters": [
            {
                "name": one.name,
                "unit": one.unit,
                "meaning": one.meaning,
                "reference": one.mean,
                "reference_std": one.mean_std,
                "reference_days": one.reference_days,
                "scatter": one.scatter,
                "shewhart_limit": one.shewhart_limit,
                f"{kind}_limit": one.lasting_limit,
                "points": [
                    {
                        "measured": time,
                        "value": float(one.values[k]),
                        "own_std": float(one.std[k]),
                        "shewhart": float(one.shewhart[k]),
                        kind: None if k < one.reference_days else float(one.lasting[k]),
                        "signals": list(one.signals(k)),
                    }
                    for k, time in enumerate(one.days)
                ],
            }
            for one in found.charts
        ],
        "too_few": found.too_few,
        "episodes": record_object(found.episodes),
    } | origin()


def newest_statistics(found: BenchCharts) -> list[tuple[str, ...]]:
    """Return the largest |z| and EWMA or CUSUM for each parameter, with their limits."""
    rows: list[tuple[str, ...]] = []
    for one in found.charts:
        later = slice(one.reference_days, None)
        z, lasting = one.shewhart[later], one.lasting[later]
        largest = [
            f"{values[np.argmax(np.abs(values))]:.2f}" if values.size else ""
            for values in (z, lasting)
        ]
        limits = f"{one.shewhart_limit:.2f}", f"{one.lasting_limit:.2f}"
        rows.append((one.name, one.meaning, largest[0], limits[0], largest[1], limits[1]))
    return rows
