"""The next calibration of a sensor for the terminal, and as a JSON object."""

from math import isfinite
from typing import Any

from inercal.basics.errors import InputError
from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, make_table, number_columns
from inercal.cli.terminal import terminal
from inercal.laboratory.store.recalibration import Recalibration
from inercal.laboratory.store.recalibration_text import (
    interval_table,
    limit_text,
    recalibration_lines,
)


def print_recalibration(found: Recalibration) -> None:
    """Print the intervals of each coefficient in days, and the next date."""
    if found.rows:
        heads, cells = interval_table(found)
        table = make_table("coefficient", "limit", *number_columns(heads))
        for one, row in zip(found.rows, cells, strict=True):
            add_row(table, one.name, limit_text(found, one), *row)
        terminal().print(table)
    for line in recalibration_lines(found):
        print_line(line)


def recalibration_object(found: Recalibration) -> dict[str, Any]:
    """Return the next calibration; intervals are years of 365.25 days."""
    return {
        "date": found.date,
        "years": found.years,
        "decided_by": found.decided_by,
        "longest": found.longest,
        "hours_in_use": found.hours_in_use,
        "operating_hours": found.operating_hours,
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
                "lower": _finite(one.limit.lower),
                "upper": _finite(one.limit.upper),
                "U": _finite(one.limit.expanded),
                "predicted_U": one.expanded,
                "prediction": one.prediction,
                "chart": one.chart,
                "staircase": one.staircase,
                "hours": one.hours,
                "sensors": one.sensors,
            }
            for one in found.rows
        ],
    }


def stated_limits(texts: list[str] | None) -> dict[str, str]:
    """Return limits of U by word, of texts such as "bias=1 mg".

    Raises
    ------
    InputError
        A text of another form.
    """
    found: dict[str, str] = {}
    for text in texts or []:
        word, sign, size = text.partition("=")
        if not (sign and word.strip() and size.strip()):
            raise InputError(
                f'--limit {text!r}: write coefficient or group = largest U, "bias=1 mg"',
                key="--limit",
            )
        found[word.strip()] = size.strip()
    return found


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
