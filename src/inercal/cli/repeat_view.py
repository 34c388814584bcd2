"""Repeated sessions for the terminal."""

from inercal.basics.units import format_value_and_uncertainty
from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, begin_section, make_table, number_columns
from inercal.cli.terminal import terminal
from inercal.laboratory.repeatability import Repeatability
from inercal.laboratory.repeatability.advice import advice_lines


def print_repeatability(found: Repeatability) -> None:
    """Print mean and next use of each coefficient, the scatter, and what was found."""
    matched = found.matched
    count = len(matched.sessions)
    days, mounts, turn_ons = (int(matched.level(which).max()) + 1 for which in range(3))
    print_line(
        f"{matched.sensor.name}: {count} sessions of {days} days, {mounts} mountings, {turn_ons} "
        f"turn-ons; U with 95 % coverage; the next use is on another {found.scope}"
    )
    heads = number_columns(("mean", "U of the mean", "U of the next use"))
    table = make_table("coefficient", *heads, "unit")
    previous = ""
    for k, name in enumerate(found.names):
        previous = begin_section(table, name, previous)
        term = matched.sensor.coefficient(name)
        value, expanded = format_value_and_uncertainty(
            float(found.values[k]) / term.si, float(found.mean.expanded[k]) / term.si
        )
        _, next_use = format_value_and_uncertainty(
            float(found.values[k]) / term.si, float(found.next_use.expanded[k]) / term.si
        )
        add_row(table, name, value, expanded, next_use, term.unit)
    terminal().print(table)
    _print_components(found)
    for line in (*found.findings, *advice_lines(found)):
        print_line(f"· {line}")


def _print_components(found: Repeatability) -> None:
    heads = number_columns(("standard deviation", "from", "to"))
    table = make_table("scatter", "with each", *heads, "unit", "in the next use")
    for one in found.components:
        cells = [f"{x / one.effect.si:.3g}" for x in (one.sd, one.low, one.high)]
        counts = one.effect.is_in_next_use(found.scope)
        add_row(table, one.effect.name, one.effect.level, *cells, one.effect.unit,
                "yes" if counts else "no")  # fmt: skip
    terminal().print(table)
