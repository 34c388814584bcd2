"""Show a calibration, or a comparison of two, on the terminal and as JSON."""

from typing import Any

from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration import Calibration
from inercal.calibration.comparison import Comparison, run_to_run
from inercal.calibration.comparison.run_to_run import RunToRun
from inercal.calibration.display import coefficient_lines
from inercal.cli.console import axis_of, print_line, print_lines, print_table
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.sensors import SI_UNITS


def print_calibration_table(calibration: Calibration) -> None:
    """Print the coefficients with U (k = 2) and, if limits are stated, the results against them."""
    heads = ("coefficient", "meaning", ">value", ">U (k = 2)", "unit")
    rows = (line[:5] for line in coefficient_lines(calibration))
    print_table(heads, rows, section=axis_of)
    print_lines(calibration.conformity_lines)


def print_comparison(
    compared: Comparison, names: tuple[str, str], ordinary: RunToRun | None = None
) -> None:
    """Print two calibrations coefficient by coefficient, and the joint tests."""
    print_line(f"1: {names[0]}; 2: {names[1]}; U with k = 2")
    numbers = (">value 1", ">± U", ">value 2", ">± U", ">difference", ">± U")
    rows = (_comparison_row(compared, k) for k in range(len(compared.names)))
    print_table(("coefficient", *numbers, "unit", ">E_n"), rows, section=axis_of)
    print_lines(run_to_run.comparison_lines(compared))
    if ordinary is not None:
        print_lines(run_to_run.run_to_run_lines(ordinary))
    elif compared.first.sensor.name == compared.second.sensor.name:
        print_lines(run_to_run.repeatability_lines(compared.exceedances, compared.joint_test))


def _comparison_row(compared: Comparison, k: int) -> list[str]:
    name = compared.names[k]
    line = compared.second.sensor.coefficient(name)
    found = [
        (one.value(name), float(u[k]), one.states_uncertainty)
        for one, u in zip((compared.first, compared.second), compared.std, strict=True)
    ]
    difference = float(compared.difference[k]), float(compared.difference_std[k])
    cells = [name]
    for x, u, stated in (*found, (*difference, compared.states_uncertainty)):
        value, expanded = format_value_and_uncertainty(x / line.si, COVERAGE * u / line.si)
        cells += [value, expanded if stated else ""]
    return [*cells, line.unit, run_to_run.format_en(float(compared.normalised_errors[k]))]


def run_to_run_object(found: RunToRun | None) -> dict[str, Any] | None:
    """Return the test against the run-to-run scatter for JSON, or None if it is not known."""
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
    """Return the comparison of two calibrations as an object for JSON."""
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
