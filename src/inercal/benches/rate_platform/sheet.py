"""The worksheet for a run on a rate platform: its sections, setting by setting."""

from math import degrees

from inercal.basics.units import format_duration
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.rate_platform.sections import PlatformStep, Pose, RateDwell
from inercal.benches.rate_platform.settings import RatePlatformData
from inercal.physics.plan import describe_direction
from inercal.physics.section_settings import key_error
from inercal.recordings.data import RunBase


def sheet(run: RunBase[RatePlatformData]) -> Sheet:
    """Return the worksheet with the sections of a run's plan.

    Raises
    ------
    InputError
        [data] does not name a column that a section needs.
    """
    data = run.data
    steps: list[PlatformStep] = [s for s in run.steps if isinstance(s, RateDwell | Pose)]
    _require_columns(run, steps)
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
            "Remove the row of a failed section from the file.",
        ),
        (*columns, *data.accelerometer, *gyro),
    )


def _require_columns(run: RunBase[RatePlatformData], steps: list[PlatformStep]) -> None:
    poses = [step for step in steps if isinstance(step, Pose)]
    for own, names in (
        (len(steps) - len(poses), ("axis", "table_rate")),
        (len(poses), ("roll", "pitch")),
    ):
        for name in names:
            if own and getattr(run.data, name) is None:
                raise key_error(
                    f"[data] {name}", "is missing: name its column in the worksheet", run.path
                )
