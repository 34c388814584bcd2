"""`inercal plan --optimise`: a better path for a calibration by navigation, printed and written."""

from collections.abc import Mapping
from pathlib import Path

from inercal.cli.console import progress_status

_SEED = 0


def print_optimised_plan(
    run_file: Path,
    keys: Mapping[str, object],
    duration: str,
    trials: int,
    out: Path | None,
    *,
    force: bool,
    json: bool,
) -> None:
    """Search for a path, print its plan, and write it.

    Raises
    ------
    InputError
        A duration that is none, a run whose path cannot be optimised, or a file that exists.
    NotObserved
        Coefficients that no path tried determines.
    """
    from inercal.basics.atomic_files import write_text
    from inercal.basics.errors import InputError
    from inercal.basics.units import parse_quantity
    from inercal.benches.turntable import require_turntable
    from inercal.cli.outputs import WORKSHEET, check_outputs
    from inercal.cli.plan_output import print_path_plan
    from inercal.pipeline.design.path_search import path_table, search_path, with_path
    from inercal.runfile import read

    try:
        seconds = parse_quantity(duration, "s").value
    except InputError as error:
        raise InputError(f"--optimise {duration}: {error}", key="--optimise") from None
    run = read(run_file, keys)
    if out is not None:
        if out.suffix.lower() != ".csv":
            raise InputError(f"--out {out}: give the name of a .csv file", key="--out")
        check_outputs({out: WORKSHEET}, run.input_files(), force=force)
    with progress_status("searching for a path") as say:
        found = search_path(run, seconds, trials, _SEED, lambda k: say(f"path {k} of {trials}"))
    note = (
        f"This is the best of {found.tried} paths of at most {duration}. In the geometric mean, "
        f"uncertainties are {found.ratio:.2g} of those by the path of the run file."
    )
    files: dict[str, Path] = {}
    if out is not None:
        write_text(out, path_table(found.steps, require_turntable(run).names))
        files["path"] = out
    more = {"optimised": {"ratio": found.ratio, "tried": found.tried}}
    print_path_plan(with_path(run, found.steps), (note,), more, files, json=json)
