"""`inercal show`: what a file is, in a table."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from inercal.cli.console import print_json

if TYPE_CHECKING:
    from inercal.runfile import Run

NAME = "show"


def run(
    file: Path = typer.Argument(help="A calibration file, a run file, or a recording."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of a table."),
) -> None:
    """Show a calibration with its uncertainties, the checked keys of a run file, or a recording."""
    if file.suffix.lower() == ".toml":
        _show_run_file(file, json)
    elif file.suffix.lower() == ".json":
        _show_calibration(file, json)
    else:
        _show_recording(file, json)


def _show_calibration(file: Path, json: bool) -> None:
    from inercal.calibration.display import title
    from inercal.calibration.files import as_object, load
    from inercal.cli.calibration_view import print_calibration_table, print_line

    calibration = load(file)
    if json:
        print_json({"file": "calibration"} | as_object(calibration))
        return
    print_line(title(calibration))
    verdict = "" if calibration.verdict is None else calibration.verdict.word
    facts = {"verdict": verdict, **calibration.job, "frame": calibration.frame}
    facts |= calibration.conditions
    for name, text in {**facts, **calibration.provenance}.items():
        if text:
            print_line(f"{name}: {text}")
    print_calibration_table(calibration)


def _show_run_file(file: Path, json: bool) -> None:
    from inercal.cli.tables import make_table
    from inercal.cli.terminal import terminal
    from inercal.runfile import read

    facts = _run_facts(read(file))
    if json:
        print_json({"file": "run file"} | facts)
        return
    table = make_table("run file", file.name)
    for name, text in facts.items():
        table.add_row(name, text)
    terminal(highlight=False).print(table)


def _run_facts(run: "Run") -> dict[str, str]:
    """Return what a run file states, after all checks."""
    sensor, bench = run.sensor, run.bench
    facts = {
        "sensor": sensor.name,
        "axes": ", ".join(f"{axis.name} ({axis.readout.unit})" for axis in sensor.axes),
        "coefficients": ", ".join(sensor.coefficients),
        "bench": " ".join(text for text in (run.kind.name, run.bench_name) if text),
        "errors of the bench": ", ".join(one.name for one in bench.parameters if one.sd > 0),
        "data": f"{run.data.kind}: {run.data.file}",
        "method": f"{run.method.name}, estimator {run.estimator}",
        "priors": ", ".join(name for prior in run.priors for name in prior.names),
        "truth": ", ".join(run.truth),
    }
    return {name: text for name, text in facts.items() if text}


def _show_recording(file: Path, json: bool) -> None:
    import numpy as np

    from inercal.cli.tables import add_row, make_table, number_columns
    from inercal.cli.terminal import terminal
    from inercal.drafts.column_roles import recognise_columns
    from inercal.io.read import read_table

    table = read_table(file)
    roles = recognise_columns(table)
    role_of = {column: role for role, column in roles.single.items()}
    for kind, columns in roles.triads.items():
        role_of |= {name: f"{kind} {axis}" for name, axis in zip(columns, "xyz", strict=False)}
    rows: list[dict[str, Any]] = []
    for name in table.names:
        column = table.columns[name]
        row: dict[str, Any] = {"column": name, "holds": role_of.get(name, "")}
        if column.dtype.kind == "U":
            row |= {"smallest": str(column[0]), "median": "", "largest": str(column[-1])}
        else:
            numbers = table.numbers(name)
            with np.errstate(invalid="ignore"):
                row |= {"smallest": float(numbers.min()), "median": float(np.median(numbers))}
                row["largest"] = float(numbers.max())
        rows.append(row)
    count = next(iter(table.columns.values())).size
    if json:
        print_json({"file": "recording", "source": table.source, "rows": count, "columns": rows})
        return
    heads = (*number_columns(("smallest", "median", "largest")),)
    shown = make_table("column", "holds", *heads, title=f"{table.source}: {count} rows")
    for row in rows:
        values = (row[key] for key in ("smallest", "median", "largest"))
        texts = (x if isinstance(x, str) else f"{x:.7g}" for x in values)
        add_row(shown, row["column"], row["holds"], *texts)
    terminal(highlight=False).print(shown)
