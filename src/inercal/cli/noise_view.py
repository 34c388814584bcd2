"""Output of a sensor's noise and a data sheet's noise, to the terminal and as JSON."""

from collections.abc import Sequence
from typing import Any

from inercal.basics.units import format_duration, si_factor
from inercal.cli.console import number_heads, print_line, print_lines, print_table
from inercal.noise.channel_noise import NoiseAnalysis, coefficient_unit
from inercal.noise.data_sheet import (
    HEADS,
    DataSheetNoise,
    SheetComparison,
    comparison_object,
    kind_remarks,
)
from inercal.noise.texts import channel_remarks, coefficient_cells, movement_text

_NUMBERS = ("measured", "U (k = 2)", "data sheet", "measured / data sheet")


def print_analysis(analysis: NoiseAnalysis) -> None:
    """Print the coefficients for all channels, then the remarks on each channel."""
    if analysis.movement:
        text = movement_text(analysis.movement, analysis.source)
        print_line(f"NOT AT REST: {text}", "bold red")
    numbers = (">value", ">U (k = 2)", ">95 % interval")
    print_table(
        ("channel", "term", *numbers, "unit", "significant"),
        [
            (channel.channel, *coefficient_cells(one))
            for channel in analysis.channels
            for one in channel.coefficients
        ],
        title=f"{analysis.source or 'recording'}: noise of {format_duration(analysis.duration)}",
        section=str,
    )
    print_lines(analysis.remarks, whole=True)
    for channel in analysis.channels:
        print_lines(channel_remarks(channel), f"{channel.channel}: ", whole=True)


def print_sheet(sheet: DataSheetNoise) -> None:
    """Print the coefficients from a data sheet with the stated texts, then the remarks."""
    rows: list[tuple[str, ...]] = []
    for quantity, found in sheet.coefficients.items():
        for one in found:
            unit = coefficient_unit(one.symbol, quantity)
            values = ", ".join(f"{value / si_factor(unit):.4g}" for value in one.values)
            rows.append((f"{quantity}s", one.symbol, values, unit, one.stated))
    heads = ("sensors", "term", ">value", "unit", "stated")
    print_table(heads, rows, title=f"data sheet {sheet.name}", section=str)
    print_lines(sheet.all_remarks)


def print_comparison_with_sheet(rows: Sequence[SheetComparison], sheet: DataSheetNoise) -> None:
    """Print measured and stated coefficients, channel by channel, then the remarks."""
    heads, title = number_heads(HEADS, _NUMBERS), f"measured noise and data sheet {sheet.name}"
    print_table(heads, [one.cells for one in rows], title=title, section=str)
    print_lines((*sheet.all_remarks, *kind_remarks(rows, sheet)))


def sheet_object(sheet: DataSheetNoise, rows: Sequence[SheetComparison] = ()) -> dict[str, Any]:
    """Return a data sheet's noise and the comparison with a recording for JSON, in SI units."""
    found: dict[str, Any] = {
        "name": sheet.name,
        "rate": sheet.rate_hz or None,
        "coefficients": [
            {
                "quantity": quantity,
                "symbol": one.symbol,
                "values": list(one.values),
                "u": None,
                "stated": one.stated,
                "unit": coefficient_unit(one.symbol, quantity),
                "values_in_unit": [
                    value / si_factor(coefficient_unit(one.symbol, quantity))
                    for value in one.values
                ],
            }
            for quantity, coefficients in sheet.coefficients.items()
            for one in coefficients
        ],
        "remarks": [*sheet.all_remarks, *kind_remarks(rows, sheet)],
    }
    if rows:
        found["comparison"] = [comparison_object(one) for one in rows]
    return found
