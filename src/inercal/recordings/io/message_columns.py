"""Convert messages in a log to columns of a table, and state the corrections made before logging.

A column is named "topic.field"; "time" is the time of the samples, s, from the first one. Among the
topics of the wanted channels, the one with the fewest messages defines the samples. Every other
topic contributes its message that is nearest in time. Readings are not interpolated, because that
would filter their noise.

A flight controller may have corrected its readings before logging::

    reading = R ((raw − offset) ∘ scale)        raw = (Rᵀ reading) / scale + offset

R rotates from sensor axes to vehicle axes, yaw · pitch · roll. A calibration from raw readings can
replace that of the controller. A calibration from corrected readings depends on the controller's
calibration, and the two must stay together, so its parameters are recorded (`stated_parameters`).

Sources: PX4, src/lib/sensor_calibration (Accelerometer.hpp, Gyroscope.hpp) and
src/lib/conversion/rotation.h; ArduPilot, libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp.
The first 39 rotations are the same in both programs.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io import column_table
from inercal.recordings.io.column_table import Column, ReadRequest, Table, shorten
from inercal.recordings.io.readers import Option
from inercal.recordings.io.time_stamps import nearest_samples

CORRECTIONS_OPTION = Option(
    "corrections",
    str,
    "undo",
    '"undo" gives the readings before the corrections of the flight controller, "keep" those after',
)

COPY_AGAIN = "copy it from the flight controller again"


def damaged_log(kind: str, path: Path, at: int, why: str) -> InputError:
    """Return the error for a log of some kind, "a ULog file", that is damaged at a byte."""
    return InputError(f"{path.name} is not {kind} or is damaged at byte {at}: {why}; {COPY_AGAIN}")


# Roll, pitch and yaw in °, by the value of the parameter.
ROTATIONS: tuple[tuple[int, int, int], ...] = (
    *((0, 0, yaw) for yaw in range(0, 360, 45)),
    *((180, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 180, 0),
    *((180, 0, yaw) for yaw in (225, 270, 315)),
    *((90, 0, yaw) for yaw in (0, 45, 90, 135)),
    *((270, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 90, 0),
    (0, 270, 0),
    (0, 180, 90),
    (0, 180, 270),
    *((roll, 90, 0) for roll in (90, 180, 270)),
    (90, 180, 0),
    (270, 180, 0),
    *((roll, 270, 0) for roll in (90, 180, 270)),
    (90, 180, 90),
    (90, 0, 270),
    (90, 68, 293),
)


@dataclass(frozen=True, eq=False)
class Correction:
    """The correction that a controller applied to the readings of one sensor.

    Parameters
    ----------
    offset : (3,) array
        Offset along the sensor axes, SI.
    scale : (3,) array
    rotation : (3, 3) array
        Rotation from sensor axes to vehicle axes.
    """

    offset: Array
    scale: Array
    rotation: Array

    def undo(self, readings: Array) -> Array:
        """Return the readings (n, 3) as they were before the correction."""
        return readings @ self.rotation / self.scale + self.offset


def stated_parameters(parameters: Mapping[str, float]) -> str:
    """Write parameters as text: "INS_ACCOFFS_X 0.012, INS_ACCOFFS_Y 0.5"."""
    return ", ".join(f"{name} {value:.9g}" for name, value in sorted(parameters.items()))


def euler_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation matrix, (3, 3), for angles in °: yaw · pitch · roll."""
    (cr, cp, cy), (sr, sp, sy) = (f(np.radians([roll, pitch, yaw])) for f in (np.cos, np.sin))
    mat_roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    mat_pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    mat_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    matrix = mat_yaw @ mat_pitch @ mat_roll
    # The cosine of a right angle is not exactly zero.
    exact = np.round(matrix)
    return np.where(np.abs(matrix - exact) < 1e-15, exact, matrix)


def rotation_matrix(number: float, parameter: str, source: str) -> Array:
    """Return the rotation for a parameter such as AHRS_ORIENTATION, (3, 3).

    Raises
    ------
    InputError
        The number does not stand for any known rotation.
    """
    if number not in range(len(ROTATIONS)):
        raise InputError(
            f"{source}: {parameter} is {number:g}, an unknown rotation; state corrections = "
            '"keep" to calibrate the corrected readings',
            key="[data] corrections",
            names=(parameter,),
        )
    return euler_matrix(*ROTATIONS[int(number)])


def keeps_corrections(corrections: str, source: str) -> bool:
    """Return whether the corrections option is "keep".

    Raises
    ------
    InputError
        The option is neither "undo" nor "keep".
    """
    if corrections not in ("undo", "keep"):
        raise InputError(
            f'{source}: [data] corrections is {corrections!r}; it is "undo" or "keep"',
            key="[data] corrections",
        )
    return corrections == "keep"


TIME = "time"  # name of the time column
_NS = 10**9
_MOST_LISTED = 12  # number of topics that a message lists

Times = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Messages:
    """All messages of one topic.

    Parameters
    ----------
    topic : str
    time : (n,) array of int
        Times on a clock that all topics share, ns.
    fields : mapping of str to (n,) array
        Values of each field, as numbers.
    kept_corrections : tuple of str
        The corrections that the wanted fields still contain, in words.
    devices : mapping of str to int
        Numbers of the sensors that the wanted fields come from, by their names in the log.
    """

    topic: str
    time: Times
    fields: Mapping[str, NDArray[Any]]
    kept_corrections: tuple[str, ...] = ()
    devices: Mapping[str, int] = field(default_factory=dict[str, int])

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the topic's columns."""
        return tuple(f"{self.topic}.{field}" for field in self.fields)


def wanted_topics(
    wanted: ReadRequest, topics: Collection[str], defaults: Iterable[str], source: str
) -> list[str]:
    """Return the topics of the wanted columns, or those of `defaults` if all are wanted.

    Raises
    ------
    InputError
        A column does not belong to any topic of the log; the message lists the topics.
    """
    if wanted.names is None:
        return [topic for topic in defaults if topic in topics]
    used: list[str] = []
    for name in wanted.names:
        if name == TIME:
            continue
        of = [topic for topic in topics if name.startswith(f"{topic}.")]
        if not of:
            raise InputError(
                f"{source} has no column {name!r}: columns are 'topic.field' and "
                f"{TIME!r}; {_suggest(name, topics)}",
                names=(name,),
            )
        used.append(max(of, key=len))
    return list(dict.fromkeys(used))


def require_messages(used: Collection[str], present: Collection[str], source: str) -> None:
    """Refuse topics for which the log has no message.

    Raises
    ------
    InputError
        A topic has no message; the error names the first of them.
    """
    missing = [topic for topic in used if topic not in present]
    if missing:
        raise InputError(
            f"{source} has no message of topic {missing[0]!r}: log it, or name another topic",
            names=tuple(missing),
        )


def channel_columns(wanted: ReadRequest, messages: Messages) -> set[str]:
    """Return a topic's wanted columns with readings; all wanted columns if none are marked."""
    channels = wanted.block_columns or wanted.names
    return set(messages.columns) & set(messages.columns if channels is None else channels)


def _suggest(name: str, topics: Collection[str]) -> str:
    """Return a text that lists the topics, starting with similar names."""
    near = get_close_matches(name.rpartition(".")[0], topics, n=3)
    listed = [*near, *(topic for topic in topics if topic not in near)]
    more = f", … ({len(listed)} in all)" if listed[_MOST_LISTED:] else ""
    return "its topics are " + ", ".join(map(shorten, listed[:_MOST_LISTED])) + more


def table_from_messages(path: Path, messages: Sequence[Messages], wanted: ReadRequest) -> Table:
    """Join messages by time to form the rows of a table.

    Parameters
    ----------
    path : Path
    messages : sequence of Messages
        Messages of the wanted topics.
    wanted : ReadRequest

    Raises
    ------
    InputError
        There is no message, a wanted column is missing, or the topics do not overlap in time.
    """
    source = path.name
    names = (TIME, *(column for topic in messages for column in topic.columns))
    chosen = column_table.select_columns(names, wanted.names, source)
    for topic in messages:
        if not topic.time.size:
            raise InputError(
                f"{source} has no message of topic {topic.topic!r}: record it, or name another "
                "topic",
                names=(topic.topic,),
            )
    if not messages:
        raise InputError(f"{source} has no column of a topic: name the columns of the readings")
    sampled = [topic for topic in messages if channel_columns(wanted, topic)] or messages
    base = min(sampled, key=lambda topic: topic.time.size)
    at, keep = _joined(base, messages, sampled, source)
    rows = int(keep.sum())
    start = int(base.time[keep][0])
    columns: dict[str, Column] = {}
    blank, block = wanted.empty_columns(rows, chosen)
    of = {column: topic for topic in messages for column in topic.columns}
    devices = {name: number for one in messages for name, number in one.devices.items()}
    for name, place in blank.items():
        if name == TIME:
            place[:] = (base.time[keep] - start) / _NS
        else:
            topic = of[name]
            values = topic.fields[name.removeprefix(f"{topic.topic}.")]
            place[:] = values[at[topic.topic][keep]]
        columns[name] = (
            column_table.whole_number_labels(place).astype(np.str_)
            if name in wanted.text
            else place
        )
    return Table(
        names,
        columns,
        source,
        column_table.file_sha256(path),
        block=block,
        kept_corrections="; ".join(text for one in messages for text in one.kept_corrections),
        devices=", ".join(f"{name} {number}" for name, number in devices.items()),
        time_zero=Fraction(start),
    )


def _joined(
    base: Messages, messages: Sequence[Messages], sampled: Sequence[Messages], source: str
) -> tuple[dict[str, Times], NDArray[np.bool_]]:
    """Return each topic's message for each sample, and which samples all channels have.

    Quantities that change slowly, such as a temperature, use the nearest message, however far it
    is.
    """
    at: dict[str, Times] = {}
    keep = np.ones(base.time.size, np.bool_)
    for topic in messages:
        if topic is base:
            at[topic.topic] = np.arange(base.time.size)
            continue
        at[topic.topic], near = nearest_samples(topic.time, base.time)
        if topic in sampled:
            keep &= near
    if not keep.any():
        others = " and ".join(topic.topic for topic in sampled)
        raise InputError(
            f"{source}: the times of {others} do not overlap: name columns of topics that were "
            "recorded together, with one clock",
            names=tuple(topic.topic for topic in sampled),
        )
    return at, keep
