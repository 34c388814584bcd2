"""`inercal control --bench`: charts of a bench by the estimates of its own runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.cli.console import print_json

if TYPE_CHECKING:
    from inercal.estimation.uncertainty.control_charts import LastingKind
    from inercal.laboratory.check_standard.bench_charts import BenchCharts
    from inercal.laboratory.store import CalibrationEntry


@dataclass(frozen=True)
class ChartOptions:
    """Options of the charts: those of `inercal control`, days as texts in ISO 8601."""

    reference: int
    run_length: float
    restarts: Sequence[str]
    lasting: "LastingKind"
    since: str
    out: Path | None
    force: bool
    json: bool


def run_bench_charts(
    bench: str, register: str | None, options: ChartOptions, same: object = None
) -> None:
    """Print the charts of a bench of the register, and write them where a folder is given.

    Raises
    ------
    InputError
        No such bench, or too few days with bench estimates.
    """
    from inercal.basics.atomic_files import write_text
    from inercal.basics.documents import document_text
    from inercal.basics.errors import InputError
    from inercal.cli.control_view import doubtful_object, print_doubtful
    from inercal.cli.outputs import CONTROL, PAGE, check_outputs
    from inercal.laboratory.check_standard.bench_chart_texts import bench_charts_object
    from inercal.laboratory.check_standard.bench_charts import ChartedRun, bench_charts
    from inercal.laboratory.store import Register
    from inercal.laboratory.store.bench_calibrations import calibrations_of_bench

    if same:
        raise InputError(
            "--same: runs of a bench are charted by their days; remove it", key="--same"
        )
    with Register(register, create=False) as opened:
        register_files = list(opened.files)
        entries = calibrations_of_bench(opened.calibrations(), bench)
    entries = [one for one in entries if one.measured >= options.since]
    if not entries:
        raise InputError(
            f"--since {options.since}: no calibration on bench {bench} since then", key="--since"
        )
    found = bench_charts(
        bench,
        [
            ChartedRun(f"#{one.id}", one.measured, one.calibration.bench_estimates or ())
            for one in entries
        ],
        reference=options.reference,
        run_length=options.run_length,
        restarts=options.restarts,
        lasting=options.lasting,
    )
    doubtful: list[CalibrationEntry] = [
        one for one in entries if any(e.holds(one.measured) for e in found.episodes)
    ]
    targets: list[Path] = []
    if options.out is not None:
        stem = bench.replace("/", "_").replace(" ", "_")
        targets = [options.out / f"{stem}.bench_control{end}" for end in (".json", ".html")]
        kinds = dict(zip(targets, (CONTROL, PAGE), strict=True))
        check_outputs(kinds, register_files, force=options.force)
        from inercal.report import write_bench_control

        write_text(targets[0], document_text(bench_charts_object(found)))
        write_bench_control(found, targets[1], doubtful)
    if options.json:
        print_json(bench_charts_object(found) | doubtful_object(doubtful))
        return
    _print_charts(found)
    print_doubtful(doubtful)
    for path in targets:
        print(f"wrote {path}")


def _print_charts(found: "BenchCharts") -> None:
    from inercal.cli.calibration_view import print_line
    from inercal.cli.tables import add_row, make_table, number_columns
    from inercal.cli.terminal import terminal
    from inercal.laboratory.check_standard.bench_chart_texts import (
        bench_lines,
        day_signals,
        newest_statistics,
    )
    from inercal.laboratory.check_standard.chart_texts import day

    first, last = (day(found.runs[k].measured) for k in (0, -1))
    print_line(f"bench {found.bench}: {len(found.runs)} calibrations, {first} to {last}")
    heads = number_columns(("largest z", "limit", f"largest {found.lasting_kind}", "limit"))
    table = make_table("parameter", "meaning", *heads)
    for row in newest_statistics(found):
        add_row(table, *row)
    terminal().print(table)
    if signals := day_signals(found):
        table = make_table("day", "signals")
        for row in signals:
            add_row(table, *row)
        terminal().print(table)
    for line in bench_lines(found):
        print_line(f"· {line}")
