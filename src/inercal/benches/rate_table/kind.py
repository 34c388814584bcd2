"""Register the plain rate table as a kind of bench: its sections, report and worksheet.

The report shows the errors of each axis by speed, and the states found in a recording. The table of
states has the rate in r/min and the readings of three axes, with one row per state in the order of
time. With kind = "means" and the table's name in [data] file, the same run file calibrates from it.
Rows are then weighted by their own standard deviations. The table contains neither correlations of
the noise between axes nor drift between rows.

If a host drives the table, a run goes through one mounting after another; in each mounting, the
table starts at rest, and the fastest rate comes last. With the symbols of
`inercal.benches.rate_table.simulation`, and with the actual rate, azimuth and acceleration of the
axis, the sensor senses::

    f = exp(φ) ((R + s) (−ω² out − ω' along) + g (√(1 − λ²) up − λ₁(α) out + λ₂(α) along))

ω is the rate read back times 1 + ρ + σ, where σ is interpolated between the set rates. The lean of
the axis has one fixed direction in the room, given by the lean of the first rest at the azimuth 0.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from inercal.basics.arrays import Array
from inercal.basics.units import format_duration
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.kind_definition import Kind, Vocabulary, simulate_without_sensor
from inercal.benches.motion_control import AxisMotionLimits, MotionControl, SensedMotion, SpinTask
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.rate_table.bench import RateTable, mounting_names, sensed_motion, speed_names
from inercal.benches.rate_table.fixture import PLANES, group_by_mounting, is_tilted
from inercal.benches.rate_table.simulation import (
    rotate_horizontal,
    simulate_table_motion,
    table_plan_duration,
)
from inercal.benches.report_data import Columns, Panel, Plot, ReportInput, Series, describe_spin
from inercal.physics.frames import exp_so3
from inercal.physics.plan import Hold, Spin
from inercal.physics.section_settings import PLANNING, BenchSection, section_length, si_value
from inercal.physics.sensors import G0
from inercal.recordings.data import (
    DataSection,
    EstimatorInput,
    ReadbackColumn,
    RunBase,
    recording_loader,
    unit_size,
)
from inercal.recordings.io.mean_tables import SD_SUFFIX


@add_bench_keys(RateTable)
class RateTableSection(BenchSection):
    """Section [bench] for a plain rate table with a fixture, as used for sensors in ship models."""

    kind: Literal["rate_table"]
    radius: str = Field(examples=["250 mm ± 0.3 mm"])
    max_rate: str = Field(
        "90 rpm", description="rate limit of the table", json_schema_extra=PLANNING
    )
    max_acceleration: str = Field("100 °/s²", json_schema_extra=PLANNING)


class RateTableData(DataSection):
    """Section [data] for a plain rate table, in which each row is a mounting at a rate."""

    arm_rate: str | int = Field(description="column of the table's rate", examples=["rate"])
    arm_rate_unit: str = Field(
        "rpm", description="unit of the rate, or its size such as '0.5 rev/s'"
    )
    mounting: str | int = Field(
        description="column of mountings, 'XY' or 'ZY 30'", examples=["mounting"]
    )

    @property
    def row(self) -> str | int | None:
        """The column that names the rows of a table or the sections of a recording."""
        return self.mounting if self.label is None else self.label

    def readback(self, bench: RateTable) -> tuple[ReadbackColumn, ...]:
        """Return the column with the rate of the table."""
        size = unit_size(self.arm_rate_unit, "rad/s", "arm_rate_unit")
        return (ReadbackColumn("arm_rate", str(self.arm_rate), size),)


def build(section: RateTableSection, folder: Path) -> RateTable:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    limits = AxisMotionLimits(
        si_value(section.max_rate, "rpm", "[bench] max_rate"),
        si_value(section.max_acceleration, "°/s²", "[bench] max_acceleration"),
    )
    radius = section_length(section, "radius")
    return build_bench(RateTable, section, radius=radius, limits=limits)


_SETTLING_SECONDS = 0.25


def spin_tasks(bench: RateTable, steps: Sequence[Spin]) -> tuple[SpinTask, ...]:
    """Return the states in the order of a run, each with its mounting.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    outward_and_up_directions(steps)
    named = dict(zip((step.attitude for step in steps), mounting_names(steps), strict=True))
    result: list[SpinTask] = []
    for own in group_by_mounting(steps):
        name = named[own[0].attitude]
        words = f"mount the sensor as {name}: {_describe_mounting(own[0])}"
        for before, step in pairwise((None, *own)):
            assert step is not None
            change = abs(step.rate - (before.rate if before else 0.0))
            approach = change / bench.limits.acceleration
            result.append(SpinTask(step.label, step.rate, step.seconds, approach, name, words))
    return tuple(result)


def _describe_mounting(step: Spin) -> str:
    """Describe which axis is up and which is toward the centre, before the tilt if there is one."""
    assert step.attitude is not None
    up, plane = Hold("", step.attitude.up, 0.0).describe(), PLANES.get(step.attitude.name[:2])  # pyright: ignore[reportArgumentType, reportCallIssue]
    if plane is None:
        return up
    if is_tilted(step):
        return f"{up}; before the tilt {plane[0]} is toward the centre and {plane[1]} up"
    return f"{up}, {plane[0]} toward the centre"


def _motion_at_instants(
    bench: RateTable, steps: Sequence[Spin], values: Mapping[str, float]
) -> SensedMotion:
    """Return a function for the motion sensed on a rate table; see `MotionControl`."""
    speeds = dict(zip((abs(step.rate) for step in steps), speed_names(steps), strict=True))
    rates = sorted({0.0, *speeds})
    off = np.array([values.get(f"speed[{speeds.get(rate, '')}]", 0.0) for rate in rates])
    rests = [step.label for step in steps if step.rate == 0]
    lean = np.array([values[f"lean_{k}[{rests[0]}]"] if rests else 0.0 for k in (1, 2)])
    bodies: dict[str, tuple[Array, float]] = {}
    for name, step in zip(mounting_names(steps), steps, strict=True):
        (out,), (up,) = outward_and_up_directions([step])
        pose = np.array([values[f"pose_{axis}[{name}]"] for axis in "xyz"])
        body = exp_so3(pose) @ np.stack([-out, np.cross(up, -out), up], axis=-1)
        bodies[name] = body, values.get("radius", 0.0) + values.get(f"seat[{name}]", 0.0)
    first = next(iter(bodies))
    g, common, upward = values["g"], values.get("rate", 0.0), float(np.sqrt(1 - lean @ lean))

    def sensed(moved: Array, mounting: str) -> Array:
        body, radius = bodies[mounting or first]
        azimuth, rate, acceleration = moved[:, 0].T
        factor = 1 + common + np.asarray(np.interp(np.abs(rate), rates, off), dtype=np.float64)
        w, dw = rate * factor, acceleration * factor
        swing = rotate_horizontal(lean, azimuth)
        inwards, forwards = radius * w**2 + g * swing[:, 0], -radius * dw + g * swing[:, 1]
        f = np.stack([inwards, forwards, np.full(len(moved), g * upward)], axis=-1)
        axis = body[:, 2]
        return np.concatenate([f @ body.T, w[:, None] * axis, dw[:, None] * axis], axis=-1)

    return sensed


MOTION_CONTROL = MotionControl(
    tasks=spin_tasks,
    readback=lambda bench: ("arm_rate",),
    quantity="rate",
    required_keys={"time": '"time"', "rate": '"50 Hz"'},
    settling=lambda bench: _SETTLING_SECONDS,
    errors=RateTable.acting_parameters,
    sensed_motion=_motion_at_instants,
)


def sheet(run: RunBase[RateTableData]) -> Sheet:
    """Return the worksheet with the states of a run, grouped by mounting and sorted by speed."""
    planned = [step for step in run.steps if isinstance(step, Spin)]
    steps = [step for own in group_by_mounting(planned) for step in own]
    names, data, size = (
        mounting_names(steps),
        run.data,
        recording_loader.readback_units(run)["arm_rate"],
    )
    rows: list[SheetRow] = []
    result = sensed_motion(run.bench, steps, {}).f
    for k, (name, step, f) in enumerate(zip(names, steps, result, strict=True), start=1):
        assert step.attitude is not None
        rpm, up = step.rate * 30 / pi, Hold("", step.attitude.up, 0.0).describe()
        reads = [f"{x + 0.0:+.3f}".replace("-", "−") for x in np.asarray(f / G0).round(3).tolist()]
        cells = (str(k), name, up, f"{rpm:.4g}", f"{step.seconds:g} s", *reads)
        given = (name, f"{step.rate / size:.12g}")
        facts = {"mounting": name, "up": up, "rpm": rpm, "felt": f.tolist()}
        rows.append(SheetRow(step.label, cells, step.seconds, name, given, facts))
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


_MG = 1e-3 * G0


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Plot the deviations from the nominal motion by rate, as in Figs. 3 to 9 of the source."""
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    nominal = sensed_motion(shown.bench, spins, {}).f
    before, after = shown.observations.mean - nominal, shown.sensed_motion().f - nominal
    rates = np.array([abs(step.rate) for step in spins]) * 30 / pi
    panels = tuple(
        Panel(
            channel,
            "r/min",
            (
                Series(rates, before[:, k] / _MG, "as read", hollow=True),
                Series(rates, after[:, k] / _MG, "corrected"),
            ),
        )
        for k, channel in enumerate(shown.observations.channels)
    )
    return (
        Plot(
            "speeds",
            "Deviations of each axis by speed, before and after correction",
            "Readings of each axis minus the nominal motion in the state, before and after "
            "correction. An error that all speeds of a mounting share comes from its angles.",
            "reading − nominal, mg",
            panels,
        ),
    )


def output_tables(run: RunBase[RateTableData], outcome: ReportInput) -> dict[str, Columns]:
    """Return the table "states" of a recording; a table of means has none.

    The columns for mounting, rate and axes have the names and units in the run's [data]. The
    standard deviations of the means, the whole turns and the seconds follow.
    """
    recording, seen = outcome.recording, outcome.observations
    if recording is None:
        return {}
    assert recording.labels is not None
    order: list[int] = np.argsort([mark.start for mark in outcome.marks], kind="stable").tolist()
    rates = [step.rate for step in outcome.steps if isinstance(step, Spin)]
    sensor = outcome.sensor
    mean = sensor.to_output(seen.mean)
    scale = np.array([abs(axis.readout.scale) for axis in sensor.axes])
    sd = np.sqrt(np.diagonal(seen.covariance, axis1=-2, axis2=-1)) * scale
    data, size = run.data, recording_loader.readback_units(run)["arm_rate"]
    turns = [round(abs(w) * t / (2 * pi)) for w, t in zip(rates, seen.duration, strict=True)]
    mounting = [str(recording.labels[mark.start]).strip() for mark in outcome.marks]
    axes = [recording_loader.unsigned_column(column) for column in data.accelerometer]
    columns: dict[str, Sequence[str] | Sequence[float] | Sequence[int]] = {
        str(data.mounting): [mounting[k] for k in order],
        recording_loader.readback_columns(run)["arm_rate"]: _rounded(np.array(rates)[order] / size),
    }
    for suffix, values in (("", mean), (SD_SUFFIX, sd)):
        columns |= {a + suffix: _rounded(values[order, k]) for k, a in enumerate(axes)}
    columns["turns"] = [turns[k] for k in order]
    columns["seconds"] = _rounded(seen.duration[order])
    return {"states": columns}


def _rounded(values: Array) -> list[float]:
    """Round numbers to twelve digits, which avoids "45.99999999999999"."""
    return [float(f"{value:.12g}") for value in values]


_UNJUDGED = (
    "the nominal motion (for a tilted state, its norm) minus the motion computed from one reading"
)


def _observe(run: RunBase[RateTableData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.rate_table.reading import observe

    return observe(run)


KIND = Kind(
    "rate_table",
    RateTable,
    RateTableSection,
    RateTableData,
    build,
    (Spin,),
    _observe,
    simulate_without_sensor(simulate_table_motion),
    table_plan_duration,
    Vocabulary(row="state or mounting", turning_device="table", rows="states", unjudged=_UNJUDGED),
    sheet=sheet,
    plots=plots,
    row=describe_spin,
    tables=output_tables,
    motion_control=MOTION_CONTROL,
)
