"""The worksheet for a run by hand: its holds and turns.

The duration of a turn by hand is not known in advance. The operator fills it in, because the mean
rate depends on it. The duration of a hold has no effect on the result, so the sheet prints the
planned duration.
"""

from inercal.basics.errors import InputError
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.physics.plan import HandStep, Hold, Turn, with_second_azimuths
from inercal.physics.section_settings import key_error
from inercal.recordings.data import RestsSection, RunBase


def sheet(run: RunBase[RestsSection]) -> Sheet:
    """Return the worksheet with the holds and turns of a run's plan."""
    data = run.data
    steps: list[HandStep] = [step for step in run.steps if isinstance(step, Hold | Turn)]
    if run.magnetometer is not None and not run.method.unknown_attitudes:
        steps = with_second_azimuths(steps)
    rows = tuple(
        SheetRow(
            step.label,
            (str(k), step.label, _words(step), f"{step.seconds:g} s"),
            step.seconds,
            "turns" if isinstance(step, Turn) else "holds",
            (step.label, *_stated_duration(step, data)),
            {"what": _words(step)},
        )
        for k, step in enumerate(steps, start=1)
    )
    turns = sum(isinstance(step, Turn) for step in steps)
    kinds = f"{len(steps) - turns} positions" + f" and {turns} turns" * bool(turns)
    gyro = data.gyro if run.sensor.select_axes("w").axes else ()
    field = data.magnetometer if run.magnetometer is not None else ()
    return Sheet(
        f"{kinds}, {sum(step.seconds for step in steps):.0f} s in all",
        (ROW, Heading("label"), Heading("set to"), DURATION),
        rows,
        _operator_notes(run, turns=bool(turns)),
        (data.label, data.seconds, *data.accelerometer, *gyro, *field),
        units={} if data.seconds is None else {str(data.seconds): "s"},
        table_error=_table_error(run, turns=bool(turns)),
    )


def _words(step: HandStep) -> str:
    return step.describe().replace("-", "−")


def _stated_duration(step: HandStep, data: RestsSection) -> tuple[str, ...]:
    if data.seconds is None or isinstance(step, Turn):
        return ()
    return (f"{step.seconds:.12g}",)


def _operator_notes(run: RunBase[RestsSection], *, turns: bool) -> tuple[str, ...]:
    found = [
        "Up is the direction in which an axis reads plus 1 g at rest.",
        "Average the readings at rest, without touching the sensor.",
    ]
    if turns:
        found.append(
            "A turn begins and ends at rest, with its axis up; note its duration and the means of "
            "all readings from rest to rest. A positive angle is counter-clockwise seen from above."
        )
    if run.magnetometer is not None:
        found.append("Keep the sensor at one place, away from iron and currents.")
        if not run.method.unknown_attitudes:
            found.append('For "(2)", turn the sensor on its face by about 180° about the vertical.')
    if run.method.unknown_attitudes:
        found.append("The attitudes may differ from those in the plan.")
    return (*found, "The steps may be done in any order.")


def _table_error(run: RunBase[RestsSection], *, turns: bool) -> InputError | None:
    """Return the error if a table of means is not sufficient or has no column for a value."""
    if run.method.unknown_attitudes and run.sensor.select_axes("w").axes:
        return key_error(
            "[sensor.gyro]",
            f"a table of means has no rotations, which {run.method.name} needs for the gyros; "
            "remove [sensor.gyro], or make a recording",
            run.path,
        )
    for key, needed in (("label", True), ("seconds", turns)):
        if needed and getattr(run.data, key) is None:
            return key_error(
                f"[data] {key}", "is missing: name its column in the worksheet", run.path
            )
    return None
