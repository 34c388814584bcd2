"""Detect exchanged, reversed or wrongly scaled columns from the turns between rests."""

from collections.abc import Sequence
from math import degrees

from inercal.basics.errors import InputError
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.data import RestsSection, RunBase
from inercal.recordings.data.recording_loader import unsigned_column
from inercal.recordings.segments.gravity_turns import (
    TurnVerdict,
    judge_turns,
    name_columns,
    read_gravity_turns,
)

_BY_READINGS = "the positions were identified by the axis that reads gravity"
_UNKNOWN = (
    f"{_BY_READINGS}: exchanged columns and reversed axes cannot be detected, because no turns "
    "between rests were recorded; hold one known axis up and compare, or state the marks"
)


def check_axes(
    run: RunBase[RestsSection], recording: Recording, rests: Sequence[Mark]
) -> tuple[TurnVerdict, tuple[Finding, ...]]:
    """Check the sensor's axes against the turns between rests; return the verdict and warnings.

    Parameters
    ----------
    run : RunBase
    recording : Recording
        A recording without a trial axis.
    rests : sequence of Mark
        The rests, in any order.

    Raises
    ------
    InputError
        The turns disagree with the recorded gravity, and exactly one change of axes or unit makes
        them agree.
    """
    ordered = sorted(rests, key=lambda one: one.start)
    found = judge_turns(read_gravity_turns(recording, run.sensor, ordered))
    if found.agree is not False:
        return found, ()
    changes = ", or if ".join(_with_columns(one, run) for one in found.changes)
    text = (
        f"{found.turns} turns between rests do not agree with gravity as recorded; they agree only "
        f"if {changes}: {_advice(found.changes)}"
    )
    if not (found.unique and found.clear):
        return found, (Finding("warning", "axes", text),)
    raise InputError(
        f"{recording.source or run.data.file}: {text}",
        file=run.file(run.data.file),
        key="[data] accelerometer",
        names=found.changes,
    )


def _with_columns(change: str, run: RunBase[RestsSection]) -> str:
    """Describe a change and add the column of each axis that it names."""
    columns: dict[str, str] = {}
    for letter, names in (("a", run.data.accelerometer), ("g", run.data.gyro)):
        for axis, column in zip("xyz", names, strict=False):
            name = f"{letter}{axis}"
            columns[name] = f"{name} (column {unsigned_column(column)})"
    return name_columns(change, columns)


def _advice(changes: Sequence[str]) -> str:
    """Return the advice which keys of the run file to check."""
    if all("unit" in one for one in changes):
        other = "°/s read as rad/s" if "°/s" in changes[0] else "rad/s read as °/s"
        return f"this looks like {other}: see unit in [sensor.gyro]"
    gyros = any(name in one for one in changes for name in ("gx", "gy", "gz", "triad", "gyro"))
    force = any(name in one for one in changes for name in ("ax", "ay", "az", "triad"))
    keys = " and ".join(["accelerometer"] * force + ["gyro"] * gyros)
    return f'check the columns in [data] {keys} ("-" before a name reverses it)'


def positions_note(found: TurnVerdict) -> str:
    """Return a note on how far the turns confirm the order and the signs of the axes."""
    if not (found.agree and found.unique):
        return _UNKNOWN
    return (
        f"{_BY_READINGS}, and {found.turns} turns between rests agree with gravity to "
        f"{degrees(found.misfit):.1f}°, and with no other order or signs of the axes; if both "
        "triads are rotated together relative to the case, this cannot be detected: hold one "
        "known axis up and compare, or state the marks"
    )
