"""`inercal plan`: what to do, position by position, and what it will give."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from inercal.cli.console import number_column, print_json, progress_status

if TYPE_CHECKING:
    from inercal.design import RehearsalResult

NAME = "plan"
_POSITIONS, _SECONDS = 24, 3.0  # by hand


def run(
    method: str = typer.Argument(
        help="multi-position, or a method on a turntable or on a bench that has a worksheet: "
        "dual-orthogonal, …"
    ),
    run_file: Path | None = typer.Option(
        None, "--run", "-r", help="Run file whose sensor, bench and coefficients count."
    ),
    positions: int | None = typer.Option(
        None,
        help=f"Number of rests by hand, {_POSITIONS}, or of positions on a bench whose plan states "
        "it, as in the run file.",
    ),
    seconds: float | None = typer.Option(
        None, help=f"Length of each hold, s: {_SECONDS:g} by hand; on a bench as in the run file."
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "-o",
        help="The table to fill (.csv), on a bench that has a worksheet; some have a page to print "
        "(.html) beside it.",
    ),
    force: bool = typer.Option(False, "--force", help="Write over an existing worksheet."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Print what to do, position by position, with the uncertainties to expect of it."""
    from inercal.benches.kinds import KINDS, kind_for_class
    from inercal.cli.plan_turntable import plan_path
    from inercal.cli.plan_worksheet import plan_worksheet
    from inercal.errors import InputError
    from inercal.methods import method as named

    name = method.replace("-", "_")
    chosen = named(name)
    kind = kind_for_class(chosen.bench)
    show = plan_path if kind.sampled else plan_worksheet if kind.sheet else None
    if show is not None:
        if run_file is None:
            raise InputError(f"a plan of {name} needs the run file: --run")
        show(run_file, _method_keys(name, positions, seconds), out, force=force, json=json)
        return
    if not chosen.unknown_attitudes:
        planned = [name for name, one in KINDS.items() if one.sheet or one.sampled]
        raise InputError(
            f"plans of {method} are fixed, by [method] in the run file; inercal budget says what "
            "they give. Plans are made for multi-position, and for methods on "
            f"{_kind_list(planned)}"
        )
    if out is not None:
        written = [name for name, one in KINDS.items() if one.sheet]
        raise InputError(
            f"--out: a plan by hand is printed; worksheets are of {_kind_list(written)}"
        )
    _plan_hand_rests(
        run_file,
        _method_keys(
            name,
            _POSITIONS if positions is None else positions,
            _SECONDS if seconds is None else seconds,
        ),
        json=json,
    )


def _kind_list(kinds: Sequence[str]) -> str:
    """Return several names of kinds: "a dividing head, a rate table or a turntable"."""
    *others, last = (
        f"{'an' if kind[0] in 'aeiou' else 'a'} {kind.replace('_', ' ')}" for kind in kinds
    )
    return f"{', '.join(others)} or {last}"


def _method_keys(name: str, positions: int | None, seconds: float | None) -> dict[str, object]:
    """Return the keys that take the place of those in [method]."""
    keys: dict[str, object] = {"name": name}
    if positions is not None:
        keys["positions"] = positions
    if seconds is not None:
        keys["seconds"] = f"{seconds} s"
    return keys


def _plan_hand_rests(run_file: Path | None, keys: dict[str, object], *, json: bool) -> None:
    from inercal.design import default_run_file, rehearse_plan
    from inercal.runfile import read

    with progress_status(f"rehearsing {keys['positions']} positions"):
        expected = rehearse_plan(read(run_file or default_run_file(), keys))
    if json:
        print_json(_as_object(expected))
    else:
        _print(expected)


def _as_object(expected: "RehearsalResult") -> dict[str, Any]:
    from inercal.sensors import SI_UNITS

    sensor = expected.sensor
    return {
        "steps": [
            {"label": step.label, "what": step.describe(), "seconds": step.seconds}
            for step in expected.steps
        ],
        "seconds": expected.seconds,
        "expected": [
            {"name": name, "std": float(std), "unit": SI_UNITS[sensor.coefficient(name).unit]}
            for name, std in zip(sensor.coefficients, expected.std, strict=True)
        ],
    }


def _print(expected: "RehearsalResult") -> None:
    from rich.console import Console
    from rich.table import Table

    from inercal.calibration.verdict import COVERAGE
    from inercal.units import format_value_and_uncertainty

    sensor, console = expected.sensor, Console()
    title = f"{len(expected.steps)} rests, {expected.seconds:.0f} s in all"
    steps = Table("rest", "attitude", "hold for", title=title)
    for step in expected.steps:
        steps.add_row(step.label, step.describe(), f"{step.seconds:g} s")
    console.print(steps)
    title = f"to expect of {sensor.name}"
    found = Table("coefficient", number_column("U (k = 2)"), "unit", title=title)
    for name, std in zip(sensor.coefficients, expected.std, strict=True):
        line = sensor.coefficient(name)
        found.add_row(
            name, format_value_and_uncertainty(0.0, COVERAGE * float(std) / line.si)[1], line.unit
        )
    console.print(found)
    console.print(
        "The axis named points up (reads +1 g). Turn slowly from rest to rest, by any way, and let "
        "the hand come to rest. The order serves the gyros. Expected of noise as stated, without "
        "tremor or drift."
    )
