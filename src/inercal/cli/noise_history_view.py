"""Noise analyses of a register in the terminal, and as objects for JSON."""

from collections.abc import Sequence
from typing import Any

from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, make_table, number_column
from inercal.cli.terminal import terminal
from inercal.laboratory.store.noise_history import NoiseEntry, noise_entry_object, noise_trends
from inercal.laboratory.store.noise_history_text import (
    HEADS,
    NEWEST_HEADS,
    change_lines,
    newest_rows,
    trend_rows,
)

_NUMBERS = ("number", "first", "newest", "value", "U (k = 2)", "E_n")


def print_newest_noise(entries: Sequence[NoiseEntry]) -> None:
    """Print the newest value of each coefficient of the noise, with its date and U."""
    if not entries:
        return
    table = make_table(
        *(number_column(one) if one in _NUMBERS else one for one in NEWEST_HEADS), title="noise"
    )
    channel = ""
    for row in newest_rows(noise_trends(tuple(entries))):
        if row[0] != channel:
            table.add_section()
        channel = row[0]
        add_row(table, *row)
    terminal().print(table)


def print_noise_history(entries: Sequence[NoiseEntry]) -> None:
    """Print the coefficients of the noise over time, and which changed."""
    if not entries:
        return
    first, last = (one.measured.partition("T")[0] for one in (entries[0], entries[-1]))
    count = f"{len(entries)} noise analys{'i' if len(entries) == 1 else 'e'}s"
    print_line(f"{count}, {first}" + (f" to {last}" if last != first else ""))
    table = make_table(*(number_column(one) if one in _NUMBERS else one for one in HEADS))
    trends = noise_trends(tuple(entries))
    for row in trend_rows(trends):
        add_row(table, *row)
    terminal().print(table)
    for line in change_lines(trends):
        print_line(line)


def noise_object_list(entries: Sequence[NoiseEntry]) -> list[dict[str, Any]]:
    """Return the entries for JSON, the oldest first, each with E_n against the one before."""
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
