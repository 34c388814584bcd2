"""A plan, printed: its steps, the uncertainties to expect, and the table to fill."""

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from inercal.cli.console import (
    print_json,
    print_written_files,
    progress_status,
)
from inercal.physics.quantities import QUANTITIES

if TYPE_CHECKING:
    from rich.table import Table

    from inercal.basics.parallel import Executor
    from inercal.pipeline.design.expected_uncertainty import ExpectedUncertainty
    from inercal.runfile import Run


class _Plan(NamedTuple):
    """A plan for the terminal and for JSON; `expected` in parts, one section of the table each."""

    steps: list[dict[str, Any]]
    seconds: float
    table: "Table"
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
    """Print the plan of a run; with `out`, write the table to be filled, and its page if any.

    Raises
    ------
    InputError
        `out` for a plan without a table, or a file that exists, unless by `force`, or no .csv;
        a run whose plan cannot be computed.
    NotObserved
        Coefficients that the plan leaves open.
    """
    from inercal.basics.errors import InputError
    from inercal.runfile import read

    run = read(run_file, keys)
    files: dict[str, Path] = {}
    with progress_status(f"computing the uncertainties of {run.method.name}"):
        recorded = run.kind.sampled or (
            run.method.unknown_attitudes and run.data.kind == "recording"
        )
        if not recorded:
            plan, files = _worksheet_plan(run, out, force=force)
        elif out is not None:
            raise InputError(
                f"--out: a plan of {run.method.name} for a recording has no table to fill; remove "
                "--out",
                key="--out",
            )
        else:
            plan = _path_plan(run) if run.kind.sampled else _hand_plan(run, executor)
    _print_plan(run, plan, files, json=json)
    if files and not json:
        print(_next_step(run, files["sheet"]))


def print_path_plan(
    run: "Run",
    notes: Sequence[str],
    more: Mapping[str, Any],
    files: Mapping[str, Path],
    *,
    json: bool,
) -> None:
    """Print the plan of a run on a turntable, with further notes and keys of the JSON object."""
    plan = _path_plan(run)
    plan = plan._replace(notes=(*notes, *plan.notes), more={**plan.more, **more})
    _print_plan(run, plan, files, json=json)


def _print_plan(run: "Run", plan: _Plan, files: Mapping[str, Path], *, json: bool) -> None:
    if json:
        expected = [_uncertainty_as_object(each) for each in plan.expected[0]]
        content: dict[str, Any] = {
            "steps": plan.steps,
            "seconds": plan.seconds,
            "expected": expected,
            **plan.more,
        }
        print_json(content | {kind: str(path) for kind, path in files.items()})
        return
    _print(run, plan)
    print_written_files(files)


def _next_step(run: "Run", sheet: Path) -> str:
    """Return what to do with the table: fill it, and calibrate by it."""
    fill = f"fill {sheet.name}"
    if run.data.kind == "means":
        if run.file(run.data.file).resolve() == sheet.resolve():
            command = f"inercal measure {run.path}"
            return f"{fill}, by hand or by {command}; next: inercal calibrate {run.path}"
        fill += f", by hand or by inercal measure {sheet} --run {run.path}"
    kinds = dict.fromkeys(axis.measures for axis in run.sensor.axes)
    stated = " and ".join(QUANTITIES[kind].sensor for kind in kinds)
    return (
        f'{fill}; then calibrate it with [data] file = "{sheet.name}", kind = "means" and '
        f"[data.sd] {stated}, the standard deviation of a mean"
    )


def _hand_plan(run: "Run", executor: "Executor") -> _Plan:

    from inercal.cli.tables import make_table
    from inercal.pipeline.design import rehearse_plan
    from inercal.pipeline.design.expected_uncertainty import coefficient_uncertainties

    result = rehearse_plan(run, executor=executor)
    title = f"{len(result.steps)} rests, {result.seconds:.0f} s in all"
    table = make_table("rest", "attitude", "hold for", title=title)
    for step in result.steps:
        table.add_row(step.label, step.describe(), f"{step.seconds:g} s")
    std = dict(zip(result.sensor.coefficients, result.std.tolist(), strict=True))
    notes = (
        "The named axis points up and reads +1 g.",
        "Turn slowly from rest to rest, on any path, and wait until the hand is at rest.",
        "Keep the order: the gyros are calibrated by the turns between the rests.",
        "Uncertainties are for the stated noise, without tremor or drift.",
    )
    steps = [
        {"label": step.label, "what": step.describe(), "seconds": step.seconds}
        for step in result.steps
    ]
    expected = coefficient_uncertainties(result.sensor, std)
    return _Plan(steps, result.seconds, table, (expected,), notes, {})


def _path_plan(run: "Run") -> _Plan:

    from inercal.benches.turntable import require_turntable
    from inercal.cli.tables import make_table, number_column
    from inercal.pipeline.design.turntable_path import turntable_path_sheet

    sheet = turntable_path_sheet(run)
    table = make_table(
        number_column("row"),
        "label",
        "motion of the table",
        number_column("move"),
        number_column("for"),
        title=f"{len(sheet.rows)} steps, {sheet.seconds / 60:.3g} min in all",
    )
    for row in sheet.rows:
        what = row.step.describe().replace("-", "−")
        move = f"{row.move:.1f} s" if row.move else ""
        table.add_row(str(row.number), row.step.label, what, move, f"{row.seconds:.1f} s")
    notes = [
        f"not determined by the path, in units of g and rad/s: {words}" for words in sheet.undecided
    ]
    if notes:
        axes = require_turntable(run).axes
        notes.append(
            "Turn about each axis of the body, hold more attitudes, or give priors."
            if len(axes) == len("xyz")
            else f"A table of axes {axes} does not determine every coefficient: choose some by "
            '[method] coefficients, such as ["gz.bias", "gz.scale"].'
        )
    notes += sheet.warnings
    notes.append("Uncertainties are for the stated noise and table, and an ideal sensor.")
    steps = [
        {
            "label": row.step.label,
            "what": row.step.describe(),
            "move_seconds": row.move,
            "seconds": row.seconds,
        }
        for row in sheet.rows
    ]
    more = {"undecided": list(sheet.undecided), "warnings": list(sheet.warnings)}
    return _Plan(steps, sheet.seconds, table, (sheet.expected,), notes, more)


def _worksheet_plan(run: "Run", out: Path | None, *, force: bool) -> tuple[_Plan, dict[str, Path]]:
    """Return the plan of a bench with a worksheet, and the files that were written."""
    from inercal.basics.atomic_files import write_text
    from inercal.cli.tables import make_table, number_column
    from inercal.pipeline.design.worksheet import build_worksheet, run_sheet, worksheet_csv
    from inercal.report import write_worksheet

    files = {}
    if out is not None:
        files = _output_files(out, run.input_files(), page=bool(run_sheet(run).boxes), force=force)
    worksheet = build_worksheet(run)
    if files:
        write_text(files["sheet"], worksheet_csv(worksheet))
    if "page" in files:
        write_worksheet(worksheet, files["page"], files["sheet"].name)
    sheet = worksheet.sheet
    heads = (number_column(h.text) if h.align_right else h.text for h in sheet.headings)
    table = make_table(*heads, title=sheet.title)
    for k, row in enumerate(sheet.rows):
        last = k + 1 == len(sheet.rows) or sheet.rows[k + 1].group != row.group
        table.add_row(*row.cells, end_section=last)
    more: dict[str, Any] = {"notes": list(sheet.notes)}
    if sheet.sums:
        more["together"] = [_uncertainty_as_object(each) for each in worksheet.together]
    steps = [{"label": row.label, **row.facts, "seconds": row.seconds} for row in sheet.rows]
    expected = (worksheet.expected, worksheet.together)
    return _Plan(steps, sheet.seconds, table, expected, sheet.notes, more), files


def _output_files(out: Path, inputs: Sequence[Path], *, page: bool, force: bool) -> dict[str, Path]:
    """Return the files to write: "sheet", and "page" if the worksheet has a page."""
    from inercal.basics.errors import InputError
    from inercal.cli.outputs import WORKSHEET, check_outputs

    if out.suffix.lower() != ".csv":
        beside = "; the page is written next to it" * page
        raise InputError(f"--out {out}: give the name of a .csv file{beside}", key="--out")
    files = {"sheet": out} | ({"page": out.with_suffix(".html")} if page else {})
    check_outputs(dict.fromkeys(files.values(), WORKSHEET), inputs, force=force)
    return files


def _uncertainty_as_object(expected: "ExpectedUncertainty") -> dict[str, Any]:
    """Return a coefficient and its expected uncertainty for JSON, SI; null if not determined."""
    from inercal.physics.sensors import SI_UNITS

    std = expected.std if isfinite(expected.std) else None
    return {"name": expected.name, "std": std, "unit": SI_UNITS[expected.unit]}


def _print(run: "Run", plan: _Plan) -> None:

    from inercal.basics.units import format_value_and_uncertainty
    from inercal.cli.tables import make_table, number_column
    from inercal.cli.terminal import terminal
    from inercal.estimation.uncertainty.coverage import COVERAGE

    console = terminal()
    console.print(plan.table)
    title = f"to expect of {run.sensor.name}: {run.method.name}, {run.estimator}"
    table = make_table("coefficient", "meaning", number_column("U (k = 2)"), "unit", title=title)
    for part in plan.expected:
        for each in part:
            u = COVERAGE * each.std / each.size
            cell = format_value_and_uncertainty(0.0, u)[1] if isfinite(u) else "—"
            table.add_row(each.name, each.meaning, cell, each.unit)
        table.add_section()
    console.print(table)
    for note in plan.notes:
        console.print(f"· {note}", highlight=False)
