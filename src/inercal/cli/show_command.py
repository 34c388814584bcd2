"""`inercal show`: show the contents of a file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import ZERO_CELSIUS, format_count, format_value_and_uncertainty
from inercal.cli.console import (
    make_table,
    print_json,
    print_line,
    print_lines,
    print_table,
    print_verdict,
)
from inercal.cli.options import Explain, Json, flag, repeated

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.runfile import Run

_WIDTH = 120  # characters, for a pipe, which has no width of its own
_EACH = {"position": "each position", "turn": "each turn", "dwell": "each dwell",
         "pass": "each pass", "mounting": "each mounting", "speed": "each speed"}  # fmt: skip
_EARTH = ("earth_up", "earth1", "earth2", "earth_visit1", "earth_visit2")
_OTHER_KEYS = {"g": "gravity", **dict.fromkeys(_EARTH, "latitude")}


def run(
    file: Path = typer.Argument(help="A calibration file, a run file, or a recording."),
    at: list[str] = repeated(
        'A temperature, such as "-30 °C", at which to show a calibration\'s coefficients.'
    ),
    as_paper: bool = flag(
        "--as-paper",
        "Show a centrifuge calibration as D, S and b of Wang and Li 2021, with g₀ = 9.8 m/s².",
    ),
    explain: Explain = False,
    json: Json = False,
) -> None:
    """Show a calibration with its uncertainties, the checked keys of a run file, or a recording."""
    if as_paper:
        if at:
            raise InputError("--at does not work with --as-paper; give only one", key="--at")
        _show_as_paper(file, explain, json)
    elif at:
        _show_at_temperatures(file, at, json)
    elif file.suffix.lower() == ".toml":
        _show_run_file(file, json)
    elif file.suffix.lower() == ".json":
        _show_calibration(file, explain, json)
    else:
        _show_recording(file, json)


def _show_calibration(file: Path, explain: bool, json: bool) -> None:
    from inercal.calibration.display import title
    from inercal.calibration.files import calibration_object, load
    from inercal.cli.calibration_view import print_calibration_table

    calibration = load(file)
    if json:
        print_json({"file": "calibration"} | calibration_object(calibration))
        return
    print_line(title(calibration))
    facts = {**calibration.job, "frame": calibration.frame}
    facts |= calibration.conditions
    facts |= calibration.provenance
    print_lines(f"{name}: {text}" for name, text in facts.items() if text)
    print_calibration_table(calibration)
    _print_verdict_or_notes(calibration, explain)


def _print_verdict_or_notes(calibration: "Calibration", explain: bool) -> None:
    if calibration.verdict is None:
        print_lines(calibration.notes, "· ")
    else:
        print_verdict(calibration.verdict, explain=explain)


def _show_as_paper(file: Path, explain: bool, json: bool) -> None:
    """Show a centrifuge calibration in the form of Wang and Li 2021, with U = 2 u."""
    from inercal.calibration.display import title
    from inercal.calibration.files import load
    from inercal.estimation.uncertainty import COVERAGE
    from inercal.methods.centrifuge_norm.closed_formulas import G, paper_form

    if file.suffix.lower() != ".json":
        raise InputError(
            f"{file}: --as-paper is only possible for the calibration file (.json) of a "
            "centrifuge; give this file or remove --as-paper",
            file=file,
            key="--as-paper",
        )
    calibration = load(file)
    with error_location(f"{file}: --as-paper", file=file, key="--as-paper"):
        found = paper_form(calibration)
    rows = list(zip(found.names, found.values.tolist(), found.std.tolist(), found.units,
                    strict=True))  # fmt: skip
    if json:
        keys = ("name", "value", "std", "unit")
        coefficients = [dict(zip(keys, row, strict=True)) for row in rows]
        print_json({"file": "calibration", "g0_m_s2": G, "coefficients": coefficients})
        return
    print_line(title(calibration))
    print_line(f"N = S (f + D f²) + b, where N is the output and f is in g₀ = {G} m/s².")
    meanings = {"D": "quadratic term", "S": "scale factor", "b": "bias"}
    table: list[tuple[str, ...]] = []
    for name, value, std, unit in rows:
        cells = format_value_and_uncertainty(value, COVERAGE * std)
        known = cells if calibration.states_uncertainty else (cells[0], "")
        table.append((name, meanings[name[0]], *known, unit))
    heads = ("coefficient", "meaning", ">value", ">U (k = 2)", "unit")
    print_table(heads, table, section=lambda name: name[0])
    _print_verdict_or_notes(calibration, explain)


def _show_at_temperatures(file: Path, at: list[str], json: bool) -> None:
    """Show the coefficients of a calibration at given temperatures, with U = 2 u."""
    import numpy as np

    from inercal.calibration.display import temperature_curves
    from inercal.calibration.files import load
    from inercal.estimation.uncertainty import COVERAGE
    from inercal.physics.section_settings import si_value

    calibration = load(file)
    if not calibration.sensor.uses("dT"):
        raise InputError(
            "no coefficient of the calibration depends on temperature; remove --at", key="--at"
        ).located(file)
    kelvin = np.array([si_value(text, "°C", "--at") for text in at])
    with error_location(f"{file}: --at", file=file, key="--at"):
        curves = temperature_curves(calibration, kelvin)
    if json:
        rows = [
            {
                "name": one.name,
                "unit": one.unit,
                "change": not one.complete,
                "value": (one.value / one.si).tolist(),
                "std": (one.std / one.si).tolist(),
            }
            for one in curves
        ]
        print_json({"file": "calibration", "temperature_K": kelvin.tolist(), "coefficients": rows})
        return
    table: list[tuple[str, ...]] = []
    for one in curves:
        cells = (
            " ± ".join(format_value_and_uncertainty(value / one.si, COVERAGE * std / one.si))
            for value, std in zip(one.value.tolist(), one.std.tolist(), strict=True)
        )
        since = f", change from {calibration.sensor.reference_temperature - ZERO_CELSIUS:g} °C"
        meaning = f"{one.meaning}{'' if one.complete else since}"
        table.append((one.name, meaning, *cells, one.unit))
    print_table(("coefficient", "meaning", *(f">{text}" for text in at), "unit"), table)


def _show_run_file(file: Path, json: bool) -> None:
    from inercal.cli.terminal import terminal
    from inercal.runfile import read

    run = read(file)
    facts, errors = _run_facts(run), _bench_errors(run)
    if json:
        print_json({"file": "run file"} | facts | {"bench_parameters": errors})
        return
    table = make_table("run file", file.name)
    for fact in facts.items():
        table.add_row(*fact)  # not truncated, even with many coefficients
    console = terminal(highlight=False)
    console.print(table, width=min(console.width, _WIDTH))
    if errors:
        _print_bench_errors(errors)


def _run_facts(run: "Run") -> dict[str, str]:
    """Return the main facts in a checked run file, by name."""
    sensor = run.sensor
    facts = {
        "sensor": sensor.name,
        "axes": ", ".join(f"{axis.name} ({axis.readout.unit})" for axis in sensor.axes),
        "coefficients": ", ".join(sensor.coefficients),
        "bench": " ".join(text for text in (run.kind.name, run.bench_name) if text),
        "data": f"{run.data.kind}: {run.data.file}",
        "method": f"{run.method.name}, estimator {run.estimator}",
        "priors": ", ".join(name for prior in run.priors for name in prior.names),
        "truth": ", ".join(run.truth),
    }
    return {name: text for name, text in facts.items() if text}


def _bench_errors(run: "Run") -> list[dict[str, Any]]:
    """Return the relevant bench errors that are not exactly known, in SI units, with their keys."""
    from inercal.benches.key_declarations import declarations

    key_of = dict(_OTHER_KEYS)
    for field, one in declarations(type(run.bench)).items():
        names = (field,) if isinstance(one.parameters, str) else one.parameters
        key_of |= dict.fromkeys(names, one.key or field)
    acting = _acting_parameters(run)
    return [
        {
            "name": one.name,
            "key": key_of.get(one.name, ""),
            "value": one.value,
            "std": one.sd,
            "unit": one.unit,
            "of": _EACH.get(one.scope, ""),
            "meaning": one.meaning,
        }
        for one in run.bench.parameters
        if one.sd > 0 and one.name in acting
    ]


def _acting_parameters(run: "Run") -> set[str]:
    """Return the bench parameters that affect the steps; all if the data state the steps."""
    every = {one.name for one in run.bench.parameters}
    if run.kind.rows_of_table:
        return every
    try:
        return {one.name for one in run.bench.nuisances(run.steps, run.sensor).values()}
    except InputError:  # no plan is possible with the options in [method]
        return every


def _print_bench_errors(errors: Sequence[Mapping[str, Any]]) -> None:
    """Print a table of bench errors with value and standard deviation in customary units."""
    from inercal.basics.parameters import Parameter, display_unit

    rows: list[tuple[str, ...]] = []
    for row in errors:
        unit, si = display_unit(
            Parameter(row["name"], row["unit"], row["std"], "run", row["value"])
        )
        cells = format_value_and_uncertainty(row["value"] / si, row["std"] / si)
        meaning = ", ".join(text for text in (row["meaning"], row["of"]) if text)
        rows.append((row["name"], row["key"], *cells, unit, meaning))
    print_table(("error of the bench", "key", ">value", ">u (k = 1)", "unit", "meaning"), rows)


def _show_recording(file: Path, json: bool) -> None:
    import numpy as np

    from inercal.pipeline.drafts.column_roles import recognise_columns
    from inercal.pipeline.drafts.rest_recording import read_log_table

    table = read_log_table(file)
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
    count = table.rows
    if json:
        print_json({"file": "recording", "source": table.source, "rows": count, "columns": rows})
        return
    keys = ("smallest", "median", "largest")
    print_table(
        ("column", "recognised as", *(f">{key}" for key in keys)),
        [
            (row["column"], row["holds"],
             *(x if isinstance(x := row[key], str) else f"{x:.7g}" for key in keys))
            for row in rows
        ],
        title=f"{table.source}: {format_count(count, 'row')}",
    )  # fmt: skip
