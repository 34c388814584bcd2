"""Calibrations for the terminal and as JSON: one of them, and two compared."""

from typing import Any

from rich.text import Text

from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration import Calibration
from inercal.calibration.comparison import Comparison
from inercal.calibration.comparison.comparison_text import (
    comparison_lines,
    format_en,
    repeatability_lines,
    run_to_run_lines,
)
from inercal.calibration.comparison.run_to_run import RunToRun
from inercal.calibration.display import coefficient_lines
from inercal.calibration.specification import conformity_lines
from inercal.cli.tables import add_row, begin_section, make_table, number_column, number_columns
from inercal.cli.terminal import terminal
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.physics.sensors import SI_UNITS

_MAX_LINE = 2000  # characters


def print_line(text: str) -> None:
    """Print a line; one that no person reads to its end is cut."""
    if len(text) > _MAX_LINE:
        text = f"{text[:_MAX_LINE]}… ({len(text)} characters; --json prints all)"
    terminal(highlight=False).print(Text(text))


def print_calibration_table(calibration: Calibration) -> None:
    """Print the coefficients with U (k = 2), and the notes."""
    table = make_table("coefficient", "meaning", *number_columns(("value", "U (k = 2)")), "unit")
    previous = ""
    for line in coefficient_lines(calibration):
        previous = begin_section(table, line.name, previous)
        add_row(table, *line[:5])
    terminal().print(table)
    for note in calibration.notes:
        print_line(f"· {note}")
    for line in conformity_lines(calibration):
        print_line(line)


def print_comparison(
    compared: Comparison, names: tuple[str, str], ordinary: RunToRun | None = None
) -> None:
    """Print two calibrations, coefficient by coefficient, and the tests of all."""
    numbers = number_columns(("value 1", "± U", "value 2", "± U", "difference", "± U"))
    table = make_table("coefficient", *numbers, "unit", number_column("E_n"))
    print_line(f"1: {names[0]}; 2: {names[1]}; U with k = 2")
    previous = ""
    both, std = (compared.first, compared.second), compared.std
    for k, name in enumerate(compared.names):
        previous = begin_section(table, name, previous)
        line = compared.second.sensor.coefficient(name)
        found = [
            (one.value(name), float(u[k]), one.states_uncertainty)
            for one, u in zip(both, std, strict=True)
        ]
        difference = float(compared.difference[k]), float(compared.difference_std[k])
        found.append((*difference, compared.states_uncertainty))
        cells: list[str] = []
        for x, u, stated in found:
            value, expanded = format_value_and_uncertainty(x / line.si, COVERAGE * u / line.si)
            cells += [value, expanded if stated else ""]
        add_row(table, name, *cells, line.unit, format_en(float(compared.normalised_errors[k])))
    terminal().print(table)
    for line in comparison_lines(compared):
        print_line(line)
    if ordinary is not None:
        further = run_to_run_lines(ordinary)
    elif compared.first.sensor.name == compared.second.sensor.name:
        further = repeatability_lines(compared.exceedances, compared.joint_test)
    else:
        further = []
    for line in further:
        print_line(line)


def run_to_run_object(found: RunToRun | None) -> dict[str, Any] | None:
    """Return a difference against the scatter from run to run; None where it is not known."""
    if found is None:
        return None
    pairs = zip(found.names, found.normalised_errors.tolist(), strict=True)
    return {
        "source": found.source,
        "en": dict(pairs),
        "beyond": list(found.beyond),
        "within": list(found.within),
        "joint": None if found.joint is None else found.joint._asdict(),
    }


def comparison_object(
    compared: Comparison, names: tuple[str, str], ordinary: RunToRun | None = None
) -> dict[str, Any]:
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
                "difference_std": float(compared.difference_std[k]),
                "en": float(compared.normalised_errors[k]),
            }
            for k, name in enumerate(compared.names)
        ],
        "one_recording": compared.same_recording,
        "beyond": compared.exceedances,
        "by_chance": compared.expected_exceedances,
        "joint": None if compared.joint_test is None else compared.joint_test._asdict(),
        "run_to_run": run_to_run_object(ordinary),
        "left_out": list(compared.exclusions),
    }
