"""The worksheet of a run on a dividing head: its positions."""

from math import degrees

from inercal.benches.dividing_head.operator_instructions import operator_notes, operator_rows
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.benches.operator_sheet import EntryField, Heading, Sheet, SheetRow
from inercal.data import Source
from inercal.data.recording_loader import readback_units
from inercal.errors import InputError
from inercal.plan import Index
from inercal.sensors import Sensor


def sheet(run: Source[DividingHeadData]) -> Sheet:
    """Return the positions of a run, pass by pass.

    Raises
    ------
    InputError
        A plan that its autocollimation cannot have.
    """
    data, bench = run.data, run.bench
    steps = [step for step in run.steps if isinstance(step, Index)]
    collimated, label = bench.collimated != "none", data.label is not None
    unit, levelled = readback_units(run)["angle"], data.level is not None
    try:
        planned = operator_rows(bench, steps, recorded=data.autocollimator is not None)
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    idle = frozenset({len(data.accelerometer)}) if collimated else frozenset[int]()
    first = {row.in_pass: row.sense for row in reversed(planned)}
    result: list[SheetRow] = []
    for row in planned:
        step = row.step
        cells = [str(row.number), step.label, row.angle, f"{row.in_pass}, {row.sense}"]
        cells += [row.autocollimator] * collimated + ["read"] * levelled
        result.append(
            SheetRow(
                step.label,
                (*cells, f"{step.seconds:g} s" if step.seconds else ""),
                step.seconds,
                f"pass {row.in_pass}, {first[row.in_pass]}",
                (*[step.label] * label, f"{step.angle / unit:.12g}"),
                {
                    "what": step.describe(),
                    "angle_deg": degrees(step.angle),
                    "sense": row.sense,
                    "pass": row.in_pass,
                    "autocollimator": row.autocollimator,
                },
                frozenset() if row.autocollimator else idle,
            )
        )
    seconds = sum(step.seconds for step in steps)
    columns = (data.angle, *data.accelerometer, data.autocollimator, data.level)
    return Sheet(
        f"{len(result)} positions, {seconds:.0f} s of holding in all",
        (
            Heading("row", align_right=True),
            Heading("label", label=True),
            Heading("head at"),
            Heading("pass", page=""),
            *[Heading("autocollimator", page="with the autocollimator", wraps=True)] * collimated,
            *[Heading("level", page="")] * levelled,
            Heading("hold for", align_right=True, page="hold"),
        ),
        tuple(result),
        operator_notes(bench, steps, data),
        (data.label, *columns) if label else columns,
        _entry_fields(data, run.sensor, collimated=collimated),
        (
            f"{len(result)} positions in {len(first)} pass{'es' * (len(first) > 1)}",
            f"{seconds / 60:.0f} min of holding, moves besides",
            f"autocollimation: {bench.collimated}",
            f"g = {bench.gravity.value:.7g} m/s²".replace(" ", "\N{NO-BREAK SPACE}"),
        ),
        stated="the head, the base",
        sums=True,
    )


def _entry_fields(
    data: DividingHeadData, sensor: Sensor, *, collimated: bool
) -> tuple[EntryField, ...]:
    """Return what is filled in by hand."""
    found = [
        EntryField(str(name), axis.readout.unit)
        for name, axis in zip(data.accelerometer, sensor.axes, strict=True)
    ]
    if collimated:
        found.append(EntryField("autocollimator", data.autocollimator_unit))
    if data.level is not None:
        found.append(EntryField("level", data.level_unit))
    return tuple(found)
