"""A rate platform, as a kind of bench, with report, worksheet and simulation.

The report shows residuals of the straight lines, and directions at rest. The worksheet lists the
sections, setting by setting.

A simulation runs through the sections one after another. Each section begins at the azimuth of its
setting, and its rate is constant. The earth's rate rotates relative to the case while the table
turns. The recording omits the time between sections in the same setting. Between settings, and
before each pose, the case is turned over by hand within three seconds; these samples have no label.
"""

from collections.abc import Sequence
from math import degrees

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_duration
from inercal.benches.contract import SensorSimulation, SimulatedMotion, concatenate_motions
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.linearity import LineFit, output_tables, straight_lines
from inercal.benches.rate_platform.mean_motion import (
    level_earth_rate,
    level_rate_factor,
    sensed_motion,
)
from inercal.benches.rate_platform.sections import PlatformStep, Pose, RateDwell
from inercal.benches.rate_platform.settings import RatePlatformData, RatePlatformSection, build
from inercal.benches.report_data import (
    MeasuredDirection,
    Panel,
    Plot,
    ReportInput,
    Series,
    measured_direction,
)
from inercal.benches.stated_axes import any_axes
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.motion import Motion
from inercal.physics.plan import describe_direction
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings.data import EstimatorInput, RunBase

_LEAST = 2  # fewest samples in a section
_HANDLING = 3.0  # s
_TO_AND_FRO = 0.3  # rad
_PARALLEL = 1e-9  # times the product of two specific forces


def simulate_sections(
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Simulate the motion in each trial, and return it with the sensor.

    Parameters
    ----------
    bench : RatePlatform
        The bench. Its errors are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of RateDwell or Pose
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.
    sensor : Sensor
        The sensor, whose axes and coefficients determine which errors act.
    carried : bool
        Not used, because a fixture holds the sensor.

    Raises
    ------
    InputError
        An error of the bench acts but is not stated.
    """
    declared = bench.nuisances(steps, sensor)
    drawn = bench.qualified.draw(declared, rng, trials)
    still = {n: one for n, one in drawn.items() if not n.startswith("earth_")}
    base = sensed_motion(bench, steps, still).motion
    parts: list[Motion] = []
    labels: list[str] = []
    for k, step in enumerate(steps):
        if k and _is_set_anew(steps[k - 1], step):
            turning = _turned_over(base.f[..., k - 1, :], base.f[..., k, :], rate_hz)
            parts.append(turning)
            labels += [""] * turning.w.shape[-2]
        n = max(round(step.seconds * rate_hz), _LEAST)
        f, w = (np.repeat(one[..., k : k + 1, :], n, axis=-2) for one in (base.f, base.w))
        if isinstance(step, RateDwell):
            middle: Array = (np.arange(n, dtype=np.float64) + 0.5) / rate_hz
            w = w + _level_earth_rate(step, drawn, middle)
        parts.append(Motion(f, w))
        labels += [step.label] * n
    time = np.arange(len(labels)) / rate_hz
    done = SimulatedMotion(time, concatenate_motions(parts), np.array(labels), drawn)
    return SensorSimulation(done, sensor)


def _is_set_anew(before: PlatformStep, step: PlatformStep) -> bool:
    """Return whether the case is moved to another setting or pose before a section."""
    if isinstance(before, RateDwell) and isinstance(step, RateDwell):
        return before.place != step.place
    return True


def _turned_over(before: Array, after: Array, rate_hz: float) -> Motion:
    """Return the motion while the case is turned from one specific force to another by hand."""
    n = max(round(_HANDLING * rate_hz), _LEAST)
    s = ((np.arange(n) + 0.5) / n)[:, None]
    first, last = before[:, None], after[:, None]
    axis = np.cross(first, last)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    lengths = np.linalg.norm(first, axis=-1, keepdims=True)
    angle = np.arctan2(size, (first * last).sum(axis=-1, keepdims=True))
    aside = np.cross(first, np.eye(3)[int(np.argmin(np.abs(before[0])))])
    axis = np.where(size > _PARALLEL * lengths**2, axis, aside)
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    # If the case is taken off and set back in the same attitude, it turns back and forth.
    done = angle * s**3 * (10 - 15 * s + 6 * s**2) + _TO_AND_FRO * np.sin(2 * np.pi * s)
    speed = angle * 30 * s**2 * (1 - s) ** 2 + _TO_AND_FRO * 2 * np.pi * np.cos(2 * np.pi * s)
    along = np.cos(done) * first + np.sin(done) * np.cross(axis, first)
    # In the case frame, the upward direction turns in the opposite sense to the case.
    return Motion(along, -axis * speed * rate_hz / n)


def _level_earth_rate(step: RateDwell, drawn: dict[str, Array], time: Array) -> Array:
    """Return the horizontal earth rate in the case frame, (trials, n, 3) rad/s."""
    parts = [drawn.get(f"earth_{k}[{step.place}]", np.zeros(1)) for k in (1, 2)]
    return np.einsum("naj,jt->tna", level_earth_rate(step, time), np.stack(parts))


_PARTIAL = 1e-6  # of the level earth rate, or °/s: larger than rounding


def sheet(run: RunBase[RatePlatformData]) -> Sheet:
    """Return the worksheet with the sections of a run's plan.."""
    data = run.data
    steps: list[PlatformStep] = [s for s in run.steps if isinstance(s, RateDwell | Pose)]
    columns = (data.axis, data.table_rate, data.roll, data.pitch, data.setting, data.seconds)
    rows: list[SheetRow] = []
    for k, step in enumerate(steps, start=1):
        if isinstance(step, RateDwell):
            given = (step.axis, f"{step.rate / data.rate_size:.12g}", "", "", step.place)
            up, group = f"{describe_direction(step.up)} up", step.place
            set_to = f"{degrees(step.rate):.6g} °/s".replace("-", "−")
        else:
            angles = (f"{a / data.angle_size:.12g}" for a in (step.roll, step.pitch))
            given = ("", "", *angles, "")
            up, set_to, group = "pose", step.describe().replace("-", "−"), "poses"
        cells = (str(k), up, set_to, f"{step.seconds:.6g} s")
        told = (*given, f"{step.seconds:.12g}")
        stated = tuple(t for t, column in zip(told, columns, strict=True) if column is not None)
        rows.append(SheetRow(step.label, cells, step.seconds, group, stated))
    gyro = data.gyro if run.sensor.select_axes("w").axes else ()
    return Sheet(
        f"{len(rows)} sections, {format_duration(sum(step.seconds for step in steps))} in all",
        (ROW, Heading("up"), Heading("set to", align_right=True), DURATION),
        tuple(rows),
        (
            "A positive rate is counter-clockwise seen from above.",
            "Begin each section in a setting at the same azimuth, and average over whole turns.",
            "Do not change a setting until all its rates are measured, because the table's axis "
            "must not move in the case.",
            "If a section fails, repeat it, or delete its row from the table.",
            *(_notes_of_partial_turns(run.bench, steps) if gyro else ()),
        ),
        (*columns, *data.accelerometer, *gyro),
        table_error=_table_error(run, steps),
    )


def _notes_of_partial_turns(bench: RatePlatform, steps: list[PlatformStep]) -> tuple[str, ...]:
    """Return a note about the level earth rate in sections of less than one turn, if any."""
    turning = [step for step in steps if isinstance(step, RateDwell) and step.rate]
    parts = [(abs(step.rate), abs(level_rate_factor(step)[0])) for step in turning]
    short = [(rate, part) for rate, part in parts if part > _PARTIAL]
    level = earth_rate_up_north(bench.latitude.value)[1] if bench.latitude and short else 0.0
    if degrees(level) < _PARTIAL:
        return ()
    fastest, most = degrees(max(short)[0]), degrees(level * max(part for _, part in short)) * 3600
    return (
        f"{len(short)} sections, at rates up to {fastest:.4g} °/s, last less than one turn. A gyro "
        f"across the table's axis reads up to {most:.2g} °/h of the level Earth rate in them. The "
        "uncertainties above include this, if the sections begin at the same azimuth. One turn at "
        f"{fastest:.4g} °/s takes {format_duration(360 / fastest)} ([method] seconds).",
    )


def _table_error(run: RunBase[RatePlatformData], steps: list[PlatformStep]) -> InputError | None:
    poses = [step for step in steps if isinstance(step, Pose)]
    for own, names in (
        (len(steps) - len(poses), ("axis", "table_rate")),
        (len(poses), ("roll", "pitch")),
    ):
        for name in names:
            if own and getattr(run.data, name) is None:
                return key_error(
                    f"[data] {name}", "is missing: name its column in the worksheet", run.path
                )
    return None


_PPM = 1e6


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Plot the residuals of each gyro's straight line, in ppm of full scale."""
    bench = shown.bench
    steps = [step for step in shown.steps if isinstance(step, RateDwell | Pose)]
    if not isinstance(bench, RatePlatform):
        return ()
    fits = straight_lines(shown.observations, shown.sensor, bench, steps)
    if not fits:
        return ()
    return (
        Plot(
            "linearity",
            "Residuals of the straight line of each gyro against the rate",
            "Readings of each gyro minus its straight line, fitted by least squares (IEEE Std "
            "528), in ppm of full scale (the largest rate). Bars are ±2 standard deviations of a "
            "mean. A curve beyond the bars indicates a nonlinear term, and a kink at zero an "
            "asymmetry. Different readings at the same rate indicate hysteresis or drift.",
            "residual, ppm of full scale",
            tuple(_panel(fit) for fit in fits),
        ),
    )


def _panel(fit: LineFit) -> Panel:
    rate = np.degrees(fit.table.x)
    series = Series(rate, _PPM * fit.residual, "readings", _PPM * fit.sd)
    return Panel(fit.channel, "rate, °/s", (series,))


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the direction of the specific force at rest and in poses, if it is measured."""
    if shown.sensor.rank("f") < len("xyz"):
        return ()
    nominal, sensed = shown.bench.mean_motion(shown.steps, {}).f, shown.sensed_motion().f
    return tuple(
        measured_direction(step, sensed[k], nominal[k])
        for k, step in enumerate(shown.steps)
        if isinstance(step, Pose) or (isinstance(step, RateDwell) and step.rate == 0)
    )


def _observe(run: RunBase[RatePlatformData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.rate_platform.reading import observe

    return observe(run)


KIND = Kind(
    "rate_platform",
    RatePlatform,
    RatePlatformSection,
    RatePlatformData,
    build,
    (RateDwell, Pose),
    _observe,
    simulate_sections,
    words=Vocabulary(row="section", turning_device="table", rows="sections"),
    drift_from_slopes=True,
    sensor=any_axes,
    sheet=sheet,
    directions=directions,
    plots=plots,
    tables=output_tables,
)
