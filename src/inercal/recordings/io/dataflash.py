"""Read DataFlash logs (.BIN) from ArduPilot without an external library.

A column is named "topic.field", such as "IMU.AccX". For another instance (field `I` of the message)
it is "IMU[1].AccX", or "IMU2.AccX" in old logs. Readings in IMU, ACC and GYR are corrected for
offset, scale factor and board orientation; this is undone with the parameters in the log.

Each message begins with the bytes A3 95 and the number of its type. Messages of type 128 (FMT)
describe each type: its number, its length, its name, a letter for each field, and the field names.

Source: ArduPilot, libraries/AP_Logger/LogStructure.h (log_Format and the table of letters).
"""

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io import message_columns
from inercal.recordings.io.column_table import ReadRequest, Table, shorten
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.message_columns import Correction, Messages
from inercal.recordings.io.readers import Reader

HEAD = b"\xa3\x95"
_FMT, _FMT_BYTES = 128, 89
_BLOCK = 1 << 20  # bytes
_damaged = partial(message_columns.damaged_log, "a DataFlash log")
# Type and factor by letter; text and the arrays with letter "a" are not numbers. Most letters of
# numbers are also the letters of NumPy.
_LETTERS: dict[str, tuple[str, float]] = {
    **{letter: (f"<{letter}", 1) for letter in "bBhHiIqQfd"},
    "a": ("V64", 0),
    "g": ("<f2", 1),
    "n": ("S4", 0),
    "N": ("S16", 0),
    "Z": ("S64", 0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "M": ("u1", 1),
}


@dataclass(eq=False)
class LoggedType:
    """One message type, with the bytes of its messages.

    Parameters
    ----------
    name : str
    length : int
        Number of bytes in a message, including its header.
    letters : str
    fields : tuple of str
    """

    name: str
    length: int
    letters: str
    fields: tuple[str, ...]
    raw: bytearray = field(default_factory=bytearray)

    @property
    def records(self) -> NDArray[Any]:
        """The messages as a structured array, (n,), with one field for each field of the type."""
        kinds = [(name, _LETTERS[c][0]) for name, c in zip(self.fields, self.letters, strict=True)]
        return np.frombuffer(self.raw, np.dtype([("head", "V3"), *kinds]))

    def numbers(self) -> dict[str, NDArray[Any]]:
        """Return the fields that contain numbers, in the physical units of the log."""
        records = self.records
        factors = {n: _LETTERS[c][1] for n, c in zip(self.fields, self.letters, strict=True)}
        return {n: records[n] if k == 1 else records[n] * k for n, k in factors.items() if k}


def read_messages(path: Path, wanted: Callable[[str], bool]) -> dict[str, LoggedType]:
    """Return the message types of a log by name; only wanted types include their messages.

    The last message may be cut off, because a log ends this way when power is lost.

    Parameters
    ----------
    path : Path
    wanted : callable
        Function that decides from the name of a type whether its messages are kept.

    Raises
    ------
    InputError
        The file is not a DataFlash log, or it is damaged.
    OSError
        The file cannot be read.
    """
    types: dict[int, LoggedType] = {_FMT: LoggedType("FMT", _FMT_BYTES, "", ())}
    kept: dict[int, bytearray] = {}
    start = 0
    rest = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            data, at = rest + block, 0
            while at + 3 <= len(data):
                if data[at : at + 2] != HEAD or data[at + 2] not in types:
                    why = f"a message of type {data[at + 2]}, which no format describes"
                    begins = data[at : at + 2] == HEAD
                    raise _damaged(path, start + at, why if begins else "no message begins there")
                kind = data[at + 2]
                end = at + types[kind].length
                if end > len(data):
                    break
                if kind == _FMT:
                    number, made = _format(path, start + at, data[at:end])
                    known = types.setdefault(number, made)
                    if (known.letters, known.fields) != (made.letters, made.fields):
                        raise _damaged(path, start + at, f"the format of {made.name} changes")
                    if wanted(made.name):
                        kept[number] = types[number].raw
                elif kind in kept:
                    kept[kind] += data[at:end]
                at = end
            start += at
            rest = data[at:]
    if len(types) == 1:
        raise _damaged(path, 0, "it does not describe any message format")
    return {one.name: one for one in types.values()}


def _format(path: Path, at: int, raw: bytes) -> tuple[int, LoggedType]:
    """Return the number and description of a type from an FMT message.

    Raises
    ------
    InputError
        A letter is unknown, or the message length is not that of its fields.
    """
    number, length, *texts = struct.unpack("<BB4s16s64s", raw[3:])
    name, letters, columns = (text.split(b"\0")[0].decode("latin-1") for text in texts)
    fields = tuple(columns.split(",")) if columns else ()
    unknown = set(letters) - set(_LETTERS)
    if unknown or len(fields) != len(letters) or len(set(fields)) != len(fields):
        raise _damaged(path, at, f"{shorten(name)!r} has the unknown format {shorten(letters)!r}")
    size = 3 + sum(np.dtype(_LETTERS[letter][0]).itemsize for letter in letters)
    if number == _FMT:
        return _FMT, LoggedType("FMT", _FMT_BYTES, "", ())
    if size != length:
        raise _damaged(path, at, f"a {name} message has {length} bytes, but its fields have {size}")
    return number, LoggedType(name, length, letters, fields)


_FIRST = re.compile(r"IMU|(ACC|GYR)1?|(IMU|ACC|GYR)\[0\]")  # the first of several sensors
_INERTIAL = re.compile(r"(IMU|ACC|GYR)(\d?)(?:\[(\d+)\])?")
_BOARD = "AHRS_ORIENTATION"
_TIMES = (("SampleUS", 1000), ("TimeUS", 1000), ("TimeMS", 1_000_000))  # field, ns

Changes = Mapping[str, Sequence[tuple[int, float]]]
"""For each parameter: times, ns, and values, in the order of the log."""


def read_dataflash(path: Path, wanted: ReadRequest, corrections: str = "undo") -> Table:
    """Read messages from a DataFlash log.

    Parameters
    ----------
    path : Path
    wanted : ReadRequest
    corrections : "undo" or "keep"
        Whether to convert corrected readings back to the raw readings of the sensors, or to keep
        them.

    Raises
    ------
    InputError
        The log is damaged, a topic is missing in it, or the corrections cannot be undone.
    OSError
        The file cannot be read.
    """
    keep = message_columns.keeps_corrections(corrections, path.name)
    asked = None if wanted.names is None else {_type_name(name) for name in wanted.names}

    def of_interest(name: str) -> bool:
        return name == "PARM" or (
            bool(_INERTIAL.fullmatch(name)) if asked is None else name in asked
        )

    types = read_messages(path, of_interest)
    topics = {one.topic: one for made in types.values() for one in _by_instance(path.name, made)}
    known = dict.fromkeys([*topics, *(name for name in types if not types[name].raw)])
    first = [topic for topic in topics if _FIRST.fullmatch(topic)]
    used = message_columns.wanted_topics(wanted, list(known), first or list(topics), path.name)
    message_columns.require_messages(used, topics, path.name)
    changes = _parameters(types.get("PARM"))
    raw = [_uncorrected(path.name, topics[topic], changes, wanted, keep) for topic in used]
    return message_columns.table_from_messages(path, raw, wanted)


def _type_name(column: str) -> str:
    return column.partition(".")[0].partition("[")[0]


def _by_instance(source: str, made: LoggedType) -> Iterator[Messages]:
    """Yield the messages of a type by instance; nothing if the log contains none."""
    if not made.raw or made.name == "PARM":
        return
    fields = made.numbers()
    stamp = next(((name, ns) for name, ns in _TIMES if name in fields), None)
    if stamp is None:
        raise InputError(
            f"{source}: {made.name} messages have no time (TimeUS); name another topic",
            names=(made.name,),
        )
    time = fields[stamp[0]].astype(np.int64) * stamp[1]
    if "I" not in fields:
        yield Messages(made.name, time, fields)
        return
    for k in np.unique(fields["I"]).tolist():
        rows: NDArray[np.bool_] = fields["I"] == k
        some: dict[str, Any] = {name: values[rows] for name, values in fields.items()}
        yield Messages(f"{made.name}[{k}]" if k else made.name, time[rows], some)


def _parameters(made: LoggedType | None) -> Changes:
    """Return the values of each parameter, with their times."""
    changes: dict[str, list[tuple[int, float]]] = {}
    if made is None or not {"Name", "Value"} <= set(made.fields):
        return changes
    records = made.records
    times = records["TimeUS"] if "TimeUS" in made.fields else np.zeros(records.size, int)
    for name, value, time in zip(records["Name"], records["Value"], times, strict=True):
        of = changes.setdefault(name.decode("latin-1"), [])
        if not of or of[-1][1] != float(value):
            of.append((int(time) * 1000, float(value)))
    return changes


def _sensors(messages: Messages, wanted: ReadRequest) -> Iterator[tuple[str, int, tuple[str, ...]]]:
    """Yield the wanted sensors of a topic: their prefix, instance and fields."""
    match = _INERTIAL.fullmatch(messages.topic)
    if match is None:
        return
    _, number, bracket = match.groups()
    # IMU and ACC1 are instance 0, IMU2 and ACC2 instance 1.
    instance = int(bracket) if bracket else int(number or 1) - 1
    channels = message_columns.channel_columns(wanted, messages)
    for sensor, fields in (("ACC", ("AccX", "AccY", "AccZ")), ("GYR", ("GyrX", "GyrY", "GyrZ"))):
        if channels & {f"{messages.topic}.{field}" for field in fields}:
            yield sensor, instance, fields


def _devices(messages: Messages, changes: Changes, wanted: ReadRequest) -> dict[str, int]:
    """Return the device IDs of a topic, by the parameter that states them."""
    names = [f"{_prefix(sensor, k)}_ID" for sensor, k, _ in _sensors(messages, wanted)]
    return {name: int(changes[name][-1][1]) for name in names if name in changes}


def _uncorrected(
    source: str, messages: Messages, changes: Changes, wanted: ReadRequest, keep: bool
) -> Messages:
    """Return a topic's messages before their corrections, with the corrections that are kept."""
    changed: dict[str, Array] = {}
    words: list[str] = []
    for sensor, instance, fields in _sensors(messages, wanted):
        if keep:
            words.append(f"{messages.topic}: {_stated(changes, sensor, instance)}")
            continue
        correction = _correction(source, changes, sensor, instance, int(messages.time[0]))
        readings = np.stack([messages.fields[field] for field in fields], -1).astype(float)
        changed |= zip(fields, correction.undo(readings).T, strict=True)
    fields, devices = dict(messages.fields) | changed, _devices(messages, changes, wanted)
    return replace(messages, fields=fields, kept_corrections=tuple(words), devices=devices)


def _correction(
    source: str, changes: Changes, sensor: str, instance: int, start: int
) -> Correction:
    """Return the correction that ArduPilot applied to an instance, from the log's parameters."""

    def value(name: str, default: float | None = None) -> float:
        if name not in changes and default is not None:
            return default
        return _in_force(source, changes, name, start)

    thermal = f"INS_TCAL{instance + 1}_ENABLE"
    if value(thermal, 0.0) == 1:
        raise InputError(
            f"{source}: {thermal} is 1: ArduPilot compensated for temperature, which is not undone "
            'here: switch it off and log again, or state corrections = "keep"',
            key="[data] corrections",
            names=(thermal,),
        )
    before = _prefix(sensor, instance)
    offset = np.array([value(f"{before}OFFS_{axis}") for axis in "XYZ"])
    scale = np.ones(3)
    if sensor == "ACC":
        scale = np.array([value(f"{before}SCAL_{axis}") for axis in "XYZ"])
    if not scale.all():
        raise InputError(
            f"{source}: {before}SCAL is 0: the accelerometers were not calibrated in ArduPilot; "
            'calibrate them there once and log again, or state corrections = "keep"',
            key="[data] corrections",
            names=(f"{before}SCAL",),
        )
    rotation = message_columns.rotation_matrix(value(_BOARD, 0.0), _BOARD, source)
    return Correction(offset, scale, rotation)


def _prefix(sensor: str, instance: int) -> str:
    """Return a parameter's prefix, as in INS_GYROFFS_X, INS_GYR2OFFS_X, INS4_GYROFFS_X."""
    if instance == 0:
        return f"INS_{sensor}"
    return f"INS_{sensor}{instance + 1}" if instance < 3 else f"INS{instance + 1}_{sensor}"


def _stated(changes: Changes, sensor: str, instance: int) -> str:
    """Return the parameters with which the readings were corrected, in words."""
    prefix = _prefix(sensor, instance)
    own = (f"{prefix}OFFS", f"{prefix}SCAL", f"INS_TCAL{instance + 1}_", _BOARD)
    return message_columns.stated_parameters(
        {n: v[-1][1] for n, v in changes.items() if n.startswith(own)}
    )


def _in_force(source: str, changes: Changes, name: str, start: int) -> float:
    """Return the value that a parameter has from the first sample on.

    Raises
    ------
    InputError
        The parameter is not in the log, or it changes later, and the time of that change is not
        recorded.
    """
    if name not in changes:
        raise InputError(
            f"{source} does not contain parameter {name}, with which the readings were "
            'corrected: log the parameters too, or state corrections = "keep"',
            key="[data] corrections",
            names=(name,),
        )
    values = changes[name]
    time, last = values[-1]
    if len(values) > 1 and time > start:
        raise InputError(
            f"{source}: {name} changes to {last:g} at {1e-9 * time:.6g} s, during the "
            "recording: log again without a calibration in between",
            names=(name,),
        )
    return last


READER = Reader(
    "dataflash",
    read_dataflash,
    content=((0, HEAD),),
    options=(message_columns.CORRECTIONS_OPTION,),
    isolation=Isolation("a DataFlash log", message_columns.COPY_AGAIN),
)
