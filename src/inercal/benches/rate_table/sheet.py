"""The worksheet for a run on a rate table: its states."""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.basics.units import format_duration
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.rate_table.bench import mounting_names, sensed_motion
from inercal.benches.rate_table.fixture import PLANES, group_by_mounting, is_tilted
from inercal.benches.rate_table.settings import RateTableData
from inercal.physics.plan import Hold, Spin
from inercal.physics.sensors import G0
from inercal.recordings.data import RunBase
from inercal.recordings.data.recording_loader import readback_units


def sheet(run: RunBase[RateTableData]) -> Sheet:
    """Return the worksheet with the states of a run, grouped by mounting and sorted by speed."""
    planned = [step for step in run.steps if isinstance(step, Spin)]
    steps = [step for own in group_by_mounting(planned) for step in own]
    names, data, size = mounting_names(steps), run.data, readback_units(run)["arm_rate"]
    rows: list[SheetRow] = []
    result = sensed_motion(run.bench, steps, {}).f
    for k, (name, step, f) in enumerate(zip(names, steps, result, strict=True), start=1):
        assert step.attitude is not None
        rpm, up = step.rate * 30 / pi, Hold("", step.attitude.up, 0.0).describe()
        reads = [f"{x + 0.0:+.3f}".replace("-", "−") for x in np.asarray(f / G0).round(3).tolist()]
        rows.append(
            SheetRow(
                step.label,
                (str(k), name, up, f"{rpm:.4g}", f"{step.seconds:g} s", *reads),
                step.seconds,
                name,
                (name, f"{step.rate / size:.12g}"),
                {"mounting": name, "up": up, "rpm": rpm, "felt": f.tolist()},
            )
        )
    return Sheet(
        f"{len(rows)} states, {format_duration(sum(step.seconds for step in steps))} in all",
        (
            ROW,
            Heading("mounting"),
            Heading("up"),
            Heading("r/min", align_right=True),
            DURATION,
            *(Heading(f"{channel}, g", align_right=True) for channel in run.sensor.channels),
        ),
        tuple(rows),
        _operator_notes(steps, names),
        (data.mounting, data.arm_rate, *data.accelerometer),
    )


def _operator_notes(steps: Sequence[Spin], names: Sequence[str]) -> tuple[str, ...]:
    level = ", ".join(
        f"{plane} is {centre} to the centre and {up} up"
        for plane, (centre, up) in PLANES.items()
        if any(name.startswith(plane) for name in names)
    )
    notes = [f"Mountings: {level}."]
    if any(is_tilted(step) for step in steps):
        notes.append(
            "XY 30 is XY tilted by 30° about the tangential direction, so that the axis toward the "
            "centre rises. Check which axis is up."
        )
    return (
        *notes,
        "Do not change a mounting until all its speeds are measured, because its angles and its "
        "radius must stay the same.",
        "At each speed wait until the rate is steady, then average the readings over whole turns.",
        "The printed readings are those of a sensor without errors. Use them to check the axes and "
        "signs.",
        "Remove the row of a failed state from the file.",
    )
