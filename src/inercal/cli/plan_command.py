"""`inercal plan`: print the steps of a plan and the expected uncertainties."""

from math import inf
from pathlib import Path

import typer

from inercal.basics.errors import InputError
from inercal.cli.options import Force, Json, Scheduler, Workers, warn_of_root

_POSITIONS, _SECONDS = 24, 3.0  # defaults for a hand-held sensor
_TRIALS = 60


def run(
    method: str = typer.Argument(
        metavar="METHOD|RUN_FILE",
        help="A method: multi-position, dual-orthogonal, …; or a run file (.toml) with its method.",
    ),
    run_file: Path | None = typer.Option(
        None, "--run", "-r", help="Run file that states the sensor, the bench and the coefficients."
    ),
    positions: int | None = typer.Option(
        None,
        help=f"Number of rests for a hand-held sensor (default {_POSITIONS}), or of positions on a "
        "dividing head "
        "(default: the run file's).",
    ),
    seconds: float | None = typer.Option(
        None,
        help=f"Length of each hold, s (default: {_SECONDS:g} if hand-held, else the run file's).",
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "-o",
        help="The table to fill in (.csv), for a bench that has a worksheet; some benches also "
        "get a page to print (.html).",
    ),
    optimise: str | None = typer.Option(
        None,
        metavar="DURATION",
        help="Search for a better path for method systematic that takes at most this time, such "
        'as "20 min"; --out writes it as a file for \\[method] path.',
    ),
    trials: int | None = typer.Option(
        None, min=1, help=f"Number of paths that --optimise evaluates (default {_TRIALS})."
    ),
    force: Force = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Print the steps of a plan and the expected uncertainties."""
    from inercal.basics.parallel import open_executor
    from inercal.basics.small_files import is_file
    from inercal.cli.plan_output import print_optimised_plan, print_plan
    from inercal.methods import method as named

    keys: dict[str, object] = {}
    if method.lower().endswith(".toml"):
        if run_file is not None:
            raise InputError(f"--run: {method} is already a run file; give only one", key="--run")
        run_file = Path(method)
    else:
        if Path(method).suffix and is_file(Path(method)):
            raise InputError(f"{method}: give a method, or a run file (.toml)", file=method)
        keys["name"] = method.replace("-", "_")
        if named(method.replace("-", "_")).unknown_attitudes:
            from inercal.pipeline.design import default_run_file

            run_file = run_file or default_run_file()
            positions = _POSITIONS if positions is None else positions
            seconds = _SECONDS if seconds is None else seconds
    if run_file is None:
        raise InputError(
            f"a plan of {method} needs a run file: add --run FILE; only multi-position does not",
            key="--run",
        )
    for option, value in (("--positions", positions), ("--seconds", seconds)):
        if value is not None and not 0 < value < inf:
            raise InputError(f"{option} {value}: give a positive number", key=option)
    if positions is not None:
        keys["positions"] = positions
    if seconds is not None:
        keys["seconds"] = f"{seconds} s"
    if optimise is not None:
        print_optimised_plan(
            run_file, keys, optimise, trials or _TRIALS, out, force=force, json=json
        )
        return
    if trials is not None:
        raise InputError("--trials works only with --optimise; remove it", key="--trials")
    with open_executor(workers, scheduler) as executor:
        warn_of_root(scheduler)
        print_plan(run_file, keys, out, executor, force=force, json=json)
