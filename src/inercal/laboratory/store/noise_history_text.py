"""Describe the noise of a sensor over time, in rounded numbers."""

from collections.abc import Sequence

from inercal.calibration.comparison.comparison_text import format_en
from inercal.laboratory.store.noise_history import NoiseTrend
from inercal.noise.texts import coefficient_cells

NEWEST_HEADS = ("channel", "term", "value", "U (k = 2)", "unit", "measured", "analysis")
HEADS = ("channel", "term", "number", "first", "newest", "U (k = 2)", "unit", "E_n")


def trend_rows(trends: Sequence[NoiseTrend]) -> list[tuple[str, ...]]:
    """Return a row for each coefficient: first value, newest value, and E_n of the newest value."""
    rows: list[tuple[str, ...]] = []
    for one in trends:
        _, first, *_ = coefficient_cells(one.values[0])
        _, newest, spread, *_ = coefficient_cells(one.values[-1])
        en = one.normalised_errors[-1]
        shown = "" if en is None else format_en(en)
        count = str(len(one.values))
        rows.append((one.channel, one.symbol, count, first, newest, spread, one.unit, shown))
    return rows


def newest_rows(trends: Sequence[NoiseTrend]) -> list[tuple[str, ...]]:
    """Return a row for each coefficient with its newest value and the date of measurement."""
    rows: list[tuple[str, ...]] = []
    for one in trends:
        _, value, spread, *_ = coefficient_cells(one.values[-1])
        entry = one.entries[-1]
        date = entry.measured.partition("T")[0]
        if entry.measured_from == "entered":
            date = f"{date} (entered)"
        rows.append((one.channel, one.symbol, value, spread, one.unit, date, str(entry.id)))
    return rows


def change_lines(trends: Sequence[NoiseTrend]) -> list[str]:
    """Return a line on the coefficients that changed since the previous analysis."""
    changed = [f"{one.channel} {one.symbol}" for one in trends if one.changed]
    compared = [one for one in trends if one.normalised_errors[-1] is not None]
    if not compared:
        return []
    if not changed:
        return ["no noise coefficient changed since the previous analysis (E_n ≤ 1)"]
    return [f"changed since the previous analysis (E_n > 1): {', '.join(changed)}"]
