"""The noise of a data sheet in the terminal, and as objects for JSON."""

from collections.abc import Sequence
from typing import Any

from inercal.basics.units import si_factor
from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, make_table, number_column
from inercal.cli.terminal import terminal
from inercal.noise.channel_noise import coefficient_unit
from inercal.noise.data_sheet import DataSheetNoise
from inercal.noise.data_sheet_comparison import (
    HEADS,
    SheetComparison,
    comparison_object,
    kind_remarks,
)

_NUMBERS = ("measured", "U (k = 2)", "data sheet", "measured / data sheet")


def print_sheet(sheet: DataSheetNoise) -> None:
    """Print the coefficients of a data sheet with what it states, then the remarks."""
    table = make_table(
        "sensors",
        "term",
        number_column("value"),
        "unit",
        "stated",
        title=f"data sheet {sheet.name}",
    )
    for quantity, found in sheet.coefficients.items():
        table.add_section()
        for one in found:
            unit = coefficient_unit(one.symbol, quantity)
            size = si_factor(unit)
            values = ", ".join(f"{value / size:.4g}" for value in one.values)
            add_row(table, f"{quantity}s", one.symbol, values, unit, one.stated)
    terminal().print(table)
    for text in sheet.all_remarks:
        print_line(text)


def print_comparison_with_sheet(rows: Sequence[SheetComparison], sheet: DataSheetNoise) -> None:
    """Print measured and stated coefficients, channel by channel, then the remarks."""
    heads = [number_column(one) if one in _NUMBERS else one for one in HEADS]
    table = make_table(*heads, title=f"measured, and data sheet {sheet.name}")
    channel = ""
    for one in rows:
        if one.channel != channel:
            table.add_section()
        channel = one.channel
        add_row(table, *one.cells)
    terminal().print(table)
    for text in (*sheet.all_remarks, *kind_remarks(rows, sheet)):
        print_line(text)


def sheet_object(sheet: DataSheetNoise, rows: Sequence[SheetComparison] = ()) -> dict[str, Any]:
    """Return a data sheet's noise, SI, and the comparison with a recording, for JSON."""
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
