"""`inercal budget`: contribution of each imperfection to each coefficient."""

from collections.abc import Sequence
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError
from inercal.cli import console
from inercal.cli.options import Json, Scheduler, Workers, warn_of_root
from inercal.cli.outputs import BUDGET, PAGE, check_outputs

if TYPE_CHECKING:
    from inercal.pipeline.budget import Budget


def run(
    run_file: Path = typer.Argument(help="The run file (TOML); no readings are used."),
    trials: int = typer.Option(1000, help="Monte Carlo trials for each imperfection."),
    seed: int = typer.Option(0, help="Seed for the trials."),
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder to write to."),
    json: Json = False,
) -> None:
    """Compute the error budget: the contribution of each imperfection to each coefficient."""
    from inercal.basics.parallel import open_executor

    if trials < 2:
        raise InputError(
            f"--trials {trials}: a standard deviation needs 2 trials or more, such as 1000",
            key="--trials",
        )
    if seed < 0:
        raise InputError(f"--seed {seed} is negative; give 0 or more", key="--seed")
    modules = ("inercal.pipeline.budget.experiment_from_runfile", "inercal.estimation.loaded_numba")
    executor = open_executor(workers, scheduler, modules)
    # The program's other modules load while the workers get ready.
    from inercal.runfile import read

    plan = read(run_file)
    from inercal.pipeline.budget import budget
    from inercal.pipeline.budget.contribution_table import budget_as_dict
    from inercal.pipeline.budget.experiment_from_runfile import (
        experiment_from_run,
        omitted_drift_notes,
        rows_of_table,
    )
    from inercal.report import report_packages

    page = out / f"{run_file.stem}.budget.html"
    table = out / f"{run_file.stem}.budget.json"
    check_outputs({page: PAGE, table: BUDGET}, plan.input_files())
    if plan.search is not None:
        raise InputError(
            f"a budget with estimator {plan.estimator} takes hours, because every trial repeats a "
            "long search; use estimator damped, which solves the same equations, or joint",
            key="[method] estimator",
        ).located(run_file)
    warn_of_root(scheduler)
    with console.progress_status(f"first order of {plan.sensor.name}") as update, executor:
        rows = rows_of_table(plan)
        experiment = experiment_from_run(plan, rows=rows)
        with report_packages():  # while the workers get ready
            from inercal.report.budget_page import budget_page
        result = budget(
            experiment,
            trials,
            seed,
            lambda done, all_: update(f"{done} of {all_} trials for each imperfection"),
            executor,
        )
        method = {"method": plan.method.name, "estimator": plan.estimator}
        table_note = f"The states are those of the {len(rows)} rows of {plan.data.file}."
        notes = (*omitted_drift_notes(plan), *([table_note] if rows else []))
        content = budget_as_dict(result) | method | {"notes": list(notes)}
        about = (f"method {plan.method.name}", f"estimator {plan.estimator}", *notes)
        write_text(page, budget_page(result, " · ".join(about)))
        write_text(table, dumps(content, indent=1, ensure_ascii=False) + "\n")
    files = {"budget_file": str(table), "page": str(page)}
    if json:
        console.print_json(content | files)
        return
    _print(result)
    console.print_lines(notes, "· ")
    console.print_written_files(files.values())


def _print(result: "Budget") -> None:
    from rich.text import Text

    from inercal.pipeline.budget.contribution_table import contribution_rows, shift_cells

    sensor = result.experiment.sensor
    rows: list[Sequence[str | Text]] = []
    for k, name in enumerate(sensor.coefficients):
        unit = sensor.coefficient(name).unit
        for j, row in enumerate(contribution_rows(result, k)):
            cells = (
                name * (j == 0), row.name, row.first_order, row.monte_carlo, row.error, unit,
                f"{100 * row.share:.0f} %",
            )  # fmt: skip
            rows.append([Text(cell, "bold" if row.kind == "total" else "") for cell in cells])
        rows.append(())
    console.print_table(
        ("coefficient", "imperfection", ">first order", ">Monte Carlo", ">±", "unit", ">share"),
        rows,
        title=f"error budget of {sensor.name}: standard deviations",
    )
    if result.shifts:
        shifts = (f">{one.name}\n{one.value}" for one in result.shifts)
        rows = [
            (name, *shift_cells(result, k), sensor.coefficient(name).unit)
            for k, name in enumerate(sensor.coefficients)
        ]
        console.print_table(("coefficient", *shifts, "unit"), rows, title="if left uncorrected")
