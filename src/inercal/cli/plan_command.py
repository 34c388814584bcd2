"""`inercal plan`: print the steps of a plan and the expected uncertainties.

Output of a plan: its steps, the expected uncertainties and the table to fill in.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InercalError, InputError
from inercal.basics.units import format_duration, format_value_and_uncertainty, parse_quantity
from inercal.cli import console
from inercal.cli.options import Force, Json, Scheduler, Workers, optional, out_option, warn_of_root
from inercal.cli.outputs import WORKSHEET, check_outputs, require_suffix
from inercal.physics.quantities import QUANTITIES

if TYPE_CHECKING:
    from inercal.basics.parallel import Executor
    from inercal.pipeline.design.plan_rehearsal import ExpectedUncertainty
    from inercal.runfile import Run


_SEED = 0  # seed for the path search


class _Plan(NamedTuple):
    """A plan for the terminal and for JSON; each part of `expected` is one table section."""

    steps: list[dict[str, Any]]
    seconds: float
    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]  # an empty row begins a section
    expected: Sequence[Sequence["ExpectedUncertainty"]]
    notes: Sequence[str]
    more: Mapping[str, Any]  # further keys of the JSON object


def print_plan(
    run_file: Path,
    keys: Mapping[str, object],
    out: Path | None,
    executor: "Executor",
    *,
    force: bool,
    json: bool,
) -> None:
    """Print the plan of a run, and with `out` write the table to fill in.

    Raises
    ------
    InputError
        `out` is given for a plan without a table, is not a .csv file or already exists (without
        `force`), or the plan cannot be computed.
    NotObserved
        The plan does not determine all coefficients.
    """
    run = _read_with_options(run_file, keys)
    files: dict[str, Path] = {}
    with console.progress_status(f"computing the uncertainties of {run.method.name}"):
        recorded = run.kind.sampled or (
            run.method.unknown_attitudes and run.data.kind == "recording"
        )
        if not recorded:
            plan, files = _worksheet_plan(run, out, force=force)
        elif out is not None:
            raise InputError(
                f"--out: a plan of {run.method.name} for a recording has no table to fill in; "
                "remove --out",
                key="--out",
            )
        else:
            plan = _path_plan(run) if run.kind.sampled else _hand_plan(run, executor)
    if "seconds" in keys and run.data.kind == "means":
        note = "[data.sd] states the uncertainty of a mean, so U does not depend on --seconds."
        plan = plan._replace(notes=(*plan.notes, note))
    _print_plan(run, plan, files, json=json)
    if files and not json:
        print(_next_step(run, files["sheet"]))


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
    """Search for a path, print its plan and write it to a file."""
    from inercal.benches.turntable import require_turntable
    from inercal.pipeline.design.path_search import path_table, search_path, with_path

    try:
        seconds = parse_quantity(duration, "s").value
    except InputError as error:
        raise InputError(f"--optimise {duration}: {error}", key="--optimise") from None
    run = _read_with_options(run_file, keys)
    if out is not None:
        require_suffix(out, ".csv")
        check_outputs({out: WORKSHEET}, run.input_files(), force=force)
    with console.progress_status("searching for a path") as say:
        found = search_path(run, seconds, trials, _SEED, lambda k: say(f"path {k} of {trials}"))
    note = (
        f"This is the best of {found.tried} paths of at most {duration}. Its uncertainties are "
        f"{found.ratio:.2g} times those of the run file's path (geometric mean)."
    )
    files: dict[str, Path] = {}
    if out is not None:
        write_text(out, path_table(found.steps, require_turntable(run).names))
        files["path"] = out
    more = {"optimised": {"ratio": found.ratio, "tried": found.tried}}
    plan = _path_plan(with_path(run, found.steps))
    plan = plan._replace(notes=(note, *plan.notes), more={**plan.more, **more})
    _print_plan(run, plan, files, json=json)


def _read_with_options(run_file: Path, keys: Mapping[str, object]) -> "Run":
    """Read a run file with the options in [method]; an error about an option names the option."""
    from inercal.runfile import read

    try:
        return read(run_file, keys)
    except InputError as error:
        key = error.key or ""
        if (name := key.removeprefix("[method] ")) == key or name not in keys:
            raise
        text = str(error).replace(key, option := f"--{name}").replace("the key", "the option")
        raise InputError(text, key=option) from None


def _print_plan(run: "Run", plan: _Plan, files: Mapping[str, Path], *, json: bool) -> None:
    if json:
        expected = [_uncertainty_as_object(each) for each in plan.expected[0]]
        content: dict[str, Any] = {
            "steps": plan.steps,
            "seconds": plan.seconds,
            "expected": expected,
            **plan.more,
        }
        console.print_json(content | {kind: str(path) for kind, path in files.items()})
        return
    _print(run, plan)
    console.print_written_files(files.values())


def _next_step(run: "Run", sheet: Path) -> str:
    """Return the instructions for the table: fill it in, then calibrate."""
    fill = f"fill {sheet.name}"
    if run.data.kind == "means":
        if run.file(run.data.file).resolve() == sheet.resolve():
            command = f"inercal measure {run.path}"
            return f"{fill} by hand or with {command}; next: inercal calibrate {run.path}"
        fill += f" by hand or with inercal measure {sheet} --run {run.path}"
    kinds = dict.fromkeys(axis.measures for axis in run.sensor.axes)
    stated = " and ".join(QUANTITIES[kind].sensor for kind in kinds)
    return (
        f'{fill}; then calibrate it with [data] file = "{sheet.name}", kind = "means" and '
        f"[data.sd] {stated}, the standard deviation of a mean"
    )


def _hand_plan(run: "Run", executor: "Executor") -> _Plan:
    from inercal.pipeline.design import rehearse_plan
    from inercal.pipeline.design.plan_rehearsal import coefficient_uncertainties

    result = rehearse_plan(run, executor=executor)
    steps = [
        {"label": step.label, "what": step.describe(), "seconds": step.seconds}
        for step in result.steps
    ]
    std = dict(zip(result.sensor.coefficients, result.std.tolist(), strict=True))
    notes = (
        "The named axis points up and reads +1 g.",
        "Turn slowly from rest to rest, on any path, and wait until the hand is at rest.",
        "Keep the order, because the gyros are calibrated from the turns between the rests.",
        "The uncertainties assume the stated noise, without tremor or drift.",
    )
    return _Plan(
        steps,
        result.seconds,
        f"{len(result.steps)} rests, {format_duration(result.seconds)} in all",
        ("rest", "attitude", "hold for"),
        [(step.label, step.describe(), f"{step.seconds:g} s") for step in result.steps],
        (coefficient_uncertainties(result.sensor, std),),
        notes,
        {},
    )


def _path_plan(run: "Run") -> _Plan:
    from inercal.benches.turntable import require_turntable
    from inercal.pipeline.design.turntable_path import turntable_path_sheet

    sheet = turntable_path_sheet(run)
    notes = [f"not determined by the path (in g and rad/s): {words}" for words in sheet.undecided]
    if notes:
        axes = require_turntable(run).axes
        notes.append(
            "Turn about each axis of the body, hold more attitudes, or give priors."
            if len(axes) == len("xyz")
            else f"A table with axes {axes} does not determine every coefficient: choose some "
            'with [method] coefficients, such as ["gz.bias", "gz.scale"].'
        )
    notes += sheet.warnings
    notes.append("The uncertainties assume the stated noise and table, and an ideal sensor.")
    steps = [
        {
            "label": row.step.label,
            "what": row.step.describe(),
            "move_seconds": row.move,
            "seconds": row.seconds,
        }
        for row in sheet.rows
    ]
    return _Plan(
        steps,
        sheet.seconds,
        f"{len(sheet.rows)} steps, {format_duration(sheet.seconds)} in all",
        (">row", "label", "motion of the table", ">move", ">for"),
        [
            (str(row.number), row.step.label, row.step.describe().replace("-", "−"),
             f"{row.move:.1f} s" if row.move else "", f"{row.seconds:.1f} s")
            for row in sheet.rows
        ],
        (sheet.expected,),
        notes,
        {"undecided": list(sheet.undecided), "warnings": list(sheet.warnings)},
    )  # fmt: skip


def _worksheet_plan(run: "Run", out: Path | None, *, force: bool) -> tuple[_Plan, dict[str, Path]]:
    """Return the plan for a bench with a worksheet, and the files that were written."""
    from inercal.pipeline.design.worksheet import build_worksheet, run_sheet, worksheet_csv
    from inercal.report import write_worksheet

    files = {}
    if out is not None:
        # With --force, the sheet may be written again although it is the run's own table.
        sheet = run.file(run.data.file).resolve() if force else None
        inputs = [path for path in run.input_files() if path.resolve() != sheet]
        files = _output_files(out, inputs, page=bool(run_sheet(run).boxes), force=force)
    worksheet = build_worksheet(run)
    if files:
        write_text(files["sheet"], worksheet_csv(worksheet))
    if "page" in files:
        write_worksheet(worksheet, files["page"], files["sheet"].name)
    sheet = worksheet.sheet
    rows = [
        cells
        for _, group in groupby(sheet.rows, lambda row: row.group)
        for cells in (*(row.cells for row in group), ())
    ]
    more: dict[str, Any] = {"notes": list(sheet.notes)}
    if sheet.sums:
        more["together"] = [_uncertainty_as_object(each) for each in worksheet.together]
    plan = _Plan(
        [{"label": row.label, **row.facts, "seconds": row.seconds} for row in sheet.rows],
        sheet.seconds,
        sheet.title,
        [f">{head.text}" if head.align_right else head.text for head in sheet.headings],
        rows,
        (worksheet.expected, worksheet.together),
        sheet.notes,
        more,
    )
    return plan, files


def _output_files(out: Path, inputs: Sequence[Path], *, page: bool, force: bool) -> dict[str, Path]:
    """Return the output files: "sheet", and "page" if the worksheet has a page."""
    require_suffix(out, ".csv", "; the page is written next to it" * page)
    files = {"sheet": out} | ({"page": out.with_suffix(".html")} if page else {})
    check_outputs(dict.fromkeys(files.values(), WORKSHEET), inputs, force=force)
    return files


def _uncertainty_as_object(expected: "ExpectedUncertainty") -> dict[str, Any]:
    """Return a coefficient's expected uncertainty for JSON, SI; null if not determined."""
    from inercal.physics.sensors import SI_UNITS

    std = expected.std if isfinite(expected.std) else None
    return {"name": expected.name, "std": std, "unit": SI_UNITS[expected.unit]}


def _print(run: "Run", plan: _Plan) -> None:
    from inercal.estimation.uncertainty import COVERAGE

    console.print_table(plan.heads, plan.rows, title=plan.title)
    rows: list[tuple[str, ...]] = []
    for part in plan.expected:
        for each in part:
            u = COVERAGE * each.std / each.size
            cell = format_value_and_uncertainty(0.0, u)[1] if isfinite(u) else "—"
            rows.append((each.name, each.meaning, cell, each.unit))
        rows.append(())
    console.print_table(
        ("coefficient", "meaning", ">U (k = 2)", "unit"),
        rows,
        title=f"expected for {run.sensor.name}: {run.method.name}, {run.estimator}",
    )
    console.print_lines(plan.notes, "· ")


_POSITIONS, _SECONDS = 24, 3.0  # defaults for a hand-held sensor
_TRIALS = 60


def run(
    method: str = typer.Argument(
        metavar="METHOD|RUN_FILE",
        help="A method: multi-position, dual-orthogonal, …; or a run file (.toml) with its method.",
    ),
    run_file: Path | None = optional(
        "Run file that states the sensor, the bench and the coefficients.", "--run", "-r"
    ),
    positions: int | None = optional(
        f"Number of rests for a hand-held sensor (default {_POSITIONS}), or of positions on a "
        "dividing head (default: the run file's)."
    ),
    seconds: float | None = optional(
        f"Length of each hold, s (default: {_SECONDS:g} if hand-held, else the run file's)."
    ),
    out: Path | None = out_option(
        "The table to fill in (.csv), for a bench that has a worksheet; some benches also "
        "get a page to print (.html)."
    ),
    optimise: str | None = optional(
        "Search for a better path for method systematic that takes at most this time, such "
        'as "20 min"; --out writes it as a file for \\[method] path.',
        metavar="DURATION",
    ),
    trials: int | None = optional(
        f"Number of paths that --optimise evaluates (default {_TRIALS}).", min=1
    ),
    force: Force = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Print the steps of a plan and the expected uncertainties."""
    from inercal.basics.parallel import open_executor
    from inercal.basics.small_files import is_file
    from inercal.methods import method as named

    keys: dict[str, object] = {}
    given: dict[str, object] = {"--positions": positions, "--seconds": seconds}
    packaged = False
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

            packaged = run_file is None
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
        try:
            print_plan(run_file, keys, out, executor, force=force, json=json)
        except InercalError as error:
            raise _error_of_options(error, run_file, given) if packaged else error from None


def _error_of_options(
    error: InercalError, packaged: Path, given: Mapping[str, object]
) -> InercalError:
    """Return an error in a plan without a run file, which names only what the user has given."""
    text = re.sub(r"^\[method][\w ]*: ", "", str(error).removeprefix(f"{packaged}: "))
    options = " ".join(f"{name} {value}" for name, value in given.items() if value is not None)
    if not options or error.key == "--out":
        return error
    return InputError(f"{options}: {text}", key=options.partition(" ")[0], names=error.names)
