"""`inercal plan`: a good sequence of attitudes, and what it will give."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from inercal.design import Expected

NAME = "plan"


def run(
    method: str = typer.Argument(help="The method; multi-position."),
    run_file: Path | None = typer.Option(
        None, "--run", "-r", help="Run file whose sensor, bench and coefficients count."
    ),
    positions: int = typer.Option(24, help="Rests."),
    seconds: float = typer.Option(3.0, help="Length of each rest, s."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Print attitudes to take by hand, with the uncertainties to expect of them."""
    from inercal.cli.show import as_json, working
    from inercal.design import rehearse, typical
    from inercal.errors import InputError
    from inercal.methods import method as named
    from inercal.runfile import read

    name = method.replace("-", "_")
    if not named(name).free:
        raise InputError(
            f"plans of {method} are fixed, by [method] in the run file; inercal budget says what "
            "they give. Plans by hand are made for multi-position"
        )
    keys = {
        "name": name,
        "positions": positions,
        "seconds": f"{seconds} s",
    }
    with working(f"rehearsing {positions} positions"):
        expected = rehearse(read(run_file or typical(), keys))
    sensor = expected.sensor
    if json:
        from inercal.sensors import SI_UNITS

        as_json(
            {
                "steps": [
                    {"label": step.label, "what": step.in_words(), "seconds": step.seconds}
                    for step in expected.steps
                ],
                "seconds": expected.seconds,
                "expected": [
                    {
                        "name": name,
                        "std": float(std),
                        "unit": SI_UNITS[sensor.coefficient(name).unit],
                    }
                    for name, std in zip(sensor.coefficients, expected.std, strict=True)
                ],
            }
        )
        return
    _print(expected)


def _print(expected: "Expected") -> None:
    from rich.console import Console
    from rich.table import Table

    from inercal.calibration.verdict import COVERAGE
    from inercal.units import digits

    sensor, console = expected.sensor, Console()
    steps = Table(title=f"{len(expected.steps)} rests, {expected.seconds:.0f} s in all")
    for heading in ("rest", "attitude", "hold for"):
        steps.add_column(heading)
    for step in expected.steps:
        steps.add_row(step.label, step.in_words(), f"{step.seconds:g} s")
    console.print(steps)
    found = Table(title=f"to expect of {sensor.name}")
    found.add_column("coefficient")
    found.add_column("U (k = 2)", justify="right")
    found.add_column("unit")
    for name, std in zip(sensor.coefficients, expected.std, strict=True):
        line = sensor.coefficient(name)
        found.add_row(name, digits(0.0, COVERAGE * float(std) / line.si)[1], line.unit)
    console.print(found)
    console.print(
        "The axis named points up (reads +1 g). Turn slowly from rest to rest, by any way, and let "
        "the hand come to rest. The order serves the gyros. Expected of noise as stated, without "
        "tremor or drift."
    )
