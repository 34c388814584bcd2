"""Write the worksheet for a run on a dividing head: positions, and the task at each.

If the autocollimator is read in pairs, the operator trims the head at 180° until it gives the same
reading as at 0°, and at 270° the same as at 90°. The readings are used as they are. The certificate
of the faces is applied afterwards, in `inercal.benches.dividing_head.passes.sensor_angles`, so
that nobody applies it at the head, or twice.

On the way back, 180° is reached before 0°. In that pass, 180° is therefore trimmed to the reading
at 0° from the first pass. This is correct because the head has the same error at each visit. If
readings are written down, the head itself sets 0° and 90° in each pass, so that a trimming error
shows within a pair and not between passes. Otherwise all positions of a pair are trimmed to one
mark.
"""

from collections.abc import Sequence
from math import degrees, pi

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_count, format_duration
from inercal.benches.dividing_head import passes
from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.phases import largest_reading_angles
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.benches.operator_sheet import ROW, EntryField, Heading, Sheet, SheetRow
from inercal.physics.plan import Index
from inercal.physics.sensors import Sensor
from inercal.recordings.data import RunBase
from inercal.recordings.data.recording_loader import readback_units

_DEGREE, _MINUTE = 360_000, 6_000  # in 0.01″


def sheet(run: RunBase[DividingHeadData]) -> Sheet:
    """Return the worksheet with the positions of a run, pass by pass.

    Raises
    ------
    InputError
        The plan does not suit the autocollimation.
    """
    data, bench = run.data, run.bench
    steps = [step for step in run.steps if isinstance(step, Index)]
    collimated, label = bench.collimated != "none", data.label is not None
    unit, levelled = readback_units(run)["angle"], data.level is not None
    with error_location(run.path):
        tasks = autocollimator_tasks(bench, steps, recorded=data.autocollimator is not None)
    idle = frozenset({len(data.accelerometer)}) if collimated else frozenset[int]()
    first: dict[int, str] = {}
    result: list[SheetRow] = []
    rows = zip(steps, passes.pass_numbers(steps), tasks, strict=True)
    for number, (step, which, task) in enumerate(rows, start=1):
        in_pass, sense = which + 1, "forward" if step.sense > 0 else "reverse"
        begun = first.setdefault(in_pass, sense)
        cells = [str(number), step.label, format_sexagesimal(step.angle), f"{in_pass}, {sense}"]
        cells += [task] * collimated + ["read"] * levelled
        cells.append(f"{step.seconds:g} s" if step.seconds else "")
        group = f"pass {in_pass}, {begun}"
        given = (*[step.label] * label, f"{step.angle / unit:.12g}")
        facts = {"what": step.describe(), "angle_deg": degrees(step.angle)}
        facts |= {"sense": sense, "pass": in_pass, "autocollimator": task}
        unused = frozenset[int]() if task else idle
        row = SheetRow(step.label, tuple(cells), step.seconds, group, given, facts, unused)
        result.append(row)
    seconds = sum(step.seconds for step in steps)
    columns = (data.angle, *data.accelerometer, data.autocollimator, data.level, data.time)
    return Sheet(
        f"{len(result)} positions, {format_duration(seconds)} of holding in all",
        (
            ROW,
            Heading("label", label=True),
            Heading("head at"),
            Heading("pass", page=""),
            *[Heading("autocollimator", page="with the autocollimator", wraps=True)] * collimated,
            *[Heading("level", page="")] * levelled,
            Heading("hold for", align_right=True, page="hold"),
        ),
        tuple(result),
        operator_notes(bench, run.sensor, steps, data),
        (data.label, *columns) if label else columns,
        _entry_fields(data, run.sensor, collimated=collimated),
        (
            f"{len(result)} positions in {format_count(len(first), 'pass', 'passes')}",
            f"{format_duration(seconds)} of holding, plus moves",
            f"autocollimation: {bench.collimated}",
            f"g = {bench.gravity.value:.7g} m/s²".replace(" ", "\N{NO-BREAK SPACE}"),
        ),
        stated="the head, the base",
        sums=True,
    )


def _entry_fields(
    data: DividingHeadData, sensor: Sensor, *, collimated: bool
) -> tuple[EntryField, ...]:
    """Return the boxes that the operator fills in."""
    found = [
        EntryField(str(name), axis.readout.unit, str(name))
        for name, axis in zip(data.accelerometer, sensor.axes, strict=True)
    ]
    if collimated:
        column = "" if data.autocollimator is None else str(data.autocollimator)
        found.append(EntryField("autocollimator", data.autocollimator_unit, column))
    if data.level is not None:
        found.append(EntryField("level", data.level_unit, str(data.level)))
    if data.time is not None:
        found.append(EntryField("time", data.time_unit, str(data.time)))
    return tuple(found)


def autocollimator_tasks(bench: DividingHead, steps: Sequence[Index], recorded: bool) -> list[str]:
    """Return the operator's task with the autocollimator at each position; empty for none.

    Parameters
    ----------
    bench : DividingHead
    steps : sequence of Index
        Steps in the order of the run; the first pass is forward.
    recorded : bool
        Whether the autocollimator's readings have a column. The head then need not be trimmed.

    Raises
    ------
    InputError
        A position of a pair is missing in a pass.
    """
    paired = bench.collimated == "pairs"
    if paired:
        _require_pairs(steps)
    plain = [steps[row] for row in passes.rows_without_series(steps)]
    which = dict(zip((step.label for step in steps), passes.pass_numbers(steps), strict=True))

    def act(step: Index) -> str:
        mark = _trim_reference(bench, step, plain) if step in plain else None
        if mark is None:
            return ""
        trimmed = paired and passes.matches_any_angle(step.angle, passes.CARDINAL_ANGLES[2:])
        if mark is step or (recorded and not trimmed):
            return "read and write down"
        elsewhere = which[mark.label] != which[step.label]
        where = format_sexagesimal(mark.angle) + f" in pass {which[mark.label] + 1}" * elsewhere
        return f"trim the head until it reads as at {where}" + ", and write down" * recorded

    return [act(step) for step in steps]


def format_sexagesimal(angle: float) -> str:
    """Format an angle in rad as degrees, with minutes and seconds only if they are needed.

    >>> from math import pi
    >>> [format_sexagesimal(pi / x) for x in (2, 8, 7)]
    ['90°', '22° 30′', '25° 42′ 51.43″']
    """
    whole, rest = divmod(round(degrees(abs(angle)) * _DEGREE), _DEGREE)
    minutes, rest = divmod(rest, _MINUTE)
    text = f"{'−' if angle < 0 else ''}{whole}°"
    if minutes or rest:
        text += f" {minutes}′"
    return text + (f" {rest / 100:g}″" if rest else "")


def _trim_reference(bench: DividingHead, step: Index, steps: Sequence[Index]) -> Index | None:
    """Return the position whose reading a step is trimmed to; None if it is not trimmed."""
    if bench.collimated == "every":
        return steps[0]
    square = passes.matches_any_angle(step.angle, passes.CARDINAL_ANGLES)
    if bench.collimated == "none" or not square:
        return None
    return next(
        one for one in steps if passes.matches_any_angle(one.angle, (step.angle, step.angle + pi))
    )


def _require_pairs(steps: Sequence[Index]) -> None:
    for name, angles in passes.missing_cardinal_angles(steps).items():
        missing = ", ".join(map(format_sexagesimal, angles))
        raise InputError(
            f"{name} has no {missing}, but the autocollimator trims 180° to 0° and 270° to 90°; "
            "plan 12 positions or another multiple of 4",
            key="[bench] autocollimation",
            names=(name,),
        )


def operator_notes(
    bench: DividingHead, sensor: Sensor, steps: Sequence[Index], data: DividingHeadData
) -> tuple[str, ...]:
    """Return the instructions for all positions.

    Parameters
    ----------
    bench : DividingHead
    sensor : Sensor
    steps : sequence of Index
    data : DividingHeadData
        Section [data], which names the columns to fill in.
    """
    turning = any(step.sense < 0 for step in steps)
    found = [
        _mounting_note(data.accelerometer, sensor),
        "Follow the rows from the first to the last, "
        + ("forward and back, " if turning else "")
        + "without long pauses, because the calibration assumes a steady drift.",
        "Turn to each position in the sense of its pass. After an overshoot, turn well back and "
        "approach again." + " Where the sense changes, turn past the position and back." * turning,
        f"Wait until the readings are steady, then average them{_averaging_time(steps)}.",
        "Do not touch the pier or walk near it during the readings.",
    ]
    if warm := passes.warm_up_rows(steps):
        found.append(
            "Switch the accelerometer on just before the first row, and do not turn the head until "
            f"row {len(warm) + 2}. Write down the time of each reading since then."
        )
    if passes.small_tilt_series([step.angle for step in steps]):
        found.append(
            "Before the small tilts about 0°, turn the head until the reading is the mean of those "
            "at 0° and 180°. Add the small tilts to this angle, and write down the head's angles."
        )
    found += _autocollimator_notes(bench, data)
    if data.level is not None:
        found.append(
            f"Read the level at each position, in {data.level_unit}. The reading is positive if "
            "the base leans in the sense of an increasing angle of the head."
        )
    found.append(
        "Remove the row of a failed position from the file."
        + " Repeat a failed position at 0°, 90°, 180° or 270°." * (bench.collimated == "pairs")
    )
    return tuple(found)


def _mounting_note(accelerometers: Sequence[str | int], sensor: Sensor) -> str:
    angles = zip(accelerometers, largest_reading_angles(sensor), strict=True)
    first, *others = (f"{name} has its largest reading at {angle:.4g}°" for name, angle in angles)
    return f"Before the first row check that {' and '.join([first, *others])}."


def _averaging_time(steps: Sequence[Index]) -> str:
    seconds = {step.seconds for step in steps}
    return f" for {seconds.pop():g} s" if len(seconds) == 1 and 0.0 not in seconds else ""


def _autocollimator_notes(bench: DividingHead, data: DividingHeadData) -> list[str]:
    if bench.collimated == "none":
        return []
    found: list[str] = []
    if data.autocollimator is not None:
        if bench.collimated == "every":
            found.append("At the first row set the autocollimator near zero, and only there.")
        found.append(
            f"Write down the autocollimator's reading, in {data.autocollimator_unit}. The reading "
            "is positive if the head is beyond its angle, in the sense of an increasing angle."
        )
    if bench.collimated == "pairs" or data.autocollimator is None:
        found.append(
            "After trimming, the head's scale reads slightly off the angle. Do not change the "
            "angle in the table."
        )
    if bench.polygon:
        found.append(
            "Enter the readings as they are, without correction by the polygon's certificate. The "
            "calibration applies the deviations of its faces."
        )
    return found
