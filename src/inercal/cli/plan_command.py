"""`inercal plan`: the steps of a plan, and the uncertainties to expect."""

from collections.abc import Sequence
from pathlib import Path

import typer

from inercal.cli.worker_option import WORKERS

NAME = "plan"
_POSITIONS, _SECONDS = 24, 3.0  # by hand


def run(
    method: str = typer.Argument(
        help="multi-position, or a method on a turntable or on a bench that has a worksheet: "
        "dual-orthogonal, …"
    ),
    run_file: Path | None = typer.Option(
        None, "--run", "-r", help="Run file that states sensor, bench and coefficients."
    ),
    positions: int | None = typer.Option(
        None,
        help=f"Number of rests by hand (default {_POSITIONS}), or of positions on a dividing head "
        "(default: the run file's).",
    ),
    seconds: float | None = typer.Option(
        None,
        help=f"Length of each hold, s (default: {_SECONDS:g} by hand, else the run file's).",
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "-o",
        help="The table to fill (.csv), on a bench that has a worksheet; some also have a page to "
        "print (.html).",
    ),
    force: bool = typer.Option(False, "--force", help="Write over an existing worksheet."),
    workers: int | None = WORKERS,
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Print the steps of a plan, one by one, and the uncertainties to expect."""
    from inercal.benches.kinds import KINDS, kind_for_class
    from inercal.cli.plan_output import print_plan
    from inercal.errors import InputError
    from inercal.methods import method as named
    from inercal.parallel import open_executor

    name = method.replace("-", "_")
    chosen = named(name)
    kind = kind_for_class(chosen.bench)
    by_hand = not (kind.sampled or kind.sheet)
    if by_hand and chosen.unknown_attitudes:
        from inercal.design import default_run_file

        run_file = run_file or default_run_file()
        positions = _POSITIONS if positions is None else positions
        seconds = _SECONDS if seconds is None else seconds
    elif by_hand:
        planned = [name for name, each in KINDS.items() if each.sheet or each.sampled]
        raise InputError(
            f"the plan of {method} is fixed by [method] of the run file; inercal budget gives its "
            "uncertainties. inercal plan takes multi-position and methods on "
            f"{_kind_list(planned)}"
        )
    if run_file is None:
        raise InputError(f"a plan of {name} needs a run file: add --run FILE", key="--run")
    keys = _method_keys(name, positions, seconds)
    with open_executor(workers) as executor:
        print_plan(run_file, keys, out, executor, force=force, json=json)


def _kind_list(kinds: Sequence[str]) -> str:
    """Return several names of kinds: "a dividing head, a rate table or a turntable"."""
    *others, last = (
        f"{'an' if kind[0] in 'aeiou' else 'a'} {kind.replace('_', ' ')}" for kind in kinds
    )
    return f"{', '.join(others)} or {last}"


def _method_keys(name: str, positions: int | None, seconds: float | None) -> dict[str, object]:
    """Return the keys that replace those of [method]."""
    keys: dict[str, object] = {"name": name}
    if positions is not None:
        keys["positions"] = positions
    if seconds is not None:
        keys["seconds"] = f"{seconds} s"
    return keys
