"""Messages of an ArduPilot DataFlash log (.BIN), some of them by name, block by block.

Each message begins with the bytes A3 95 and a number of its type. Messages of type 128 (FMT) say of
each type: its number, its length, its name, a letter for each field, and the fields' names.

Source: ArduPilot, libraries/AP_Logger/LogStructure.h (log_Format and the table of letters).
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import shorten

HEAD = b"\xa3\x95"
_FMT, _FMT_BYTES = 128, 89
_BLOCK = 1 << 20  # bytes
# Type and factor by letter; text, and the arrays of "a", are no numbers.
_LETTERS: dict[str, tuple[str, float]] = {
    "a": ("V64", 0),
    "b": ("i1", 1),
    "B": ("u1", 1),
    "h": ("<i2", 1),
    "H": ("<u2", 1),
    "i": ("<i4", 1),
    "I": ("<u4", 1),
    "f": ("<f4", 1),
    "d": ("<f8", 1),
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
    "q": ("<i8", 1),
    "Q": ("<u8", 1),
}


@dataclass(eq=False)
class LoggedType:
    """One type of message, with the bytes of its messages.

    Parameters
    ----------
    name : str
    length : int
        Bytes of a message with its head.
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
        """The messages, (n,), with a field each."""
        kinds = [(name, _LETTERS[c][0]) for name, c in zip(self.fields, self.letters, strict=True)]
        return np.frombuffer(self.raw, np.dtype([("head", "V3"), *kinds]))

    def numbers(self) -> dict[str, NDArray[Any]]:
        """Return the fields that hold numbers, in the units that the log means."""
        records = self.records
        found: dict[str, NDArray[Any]] = {}
        for name, letter in zip(self.fields, self.letters, strict=True):
            factor = _LETTERS[letter][1]
            if factor:
                found[name] = records[name] if factor == 1 else records[name] * factor
        return found


def read_messages(path: Path, wanted: Callable[[str], bool]) -> dict[str, LoggedType]:
    """Return the types of a log by name; those that are wanted have their messages.

    The last message may be cut off: so ends a log when power is lost.

    Parameters
    ----------
    path : Path
    wanted : callable
        From the name of a type to whether its messages are kept.

    Raises
    ------
    InputError
        Not such a log, or a damaged one.
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
                    raise _damaged(path, start + at, _what(data, at))
                kind = data[at + 2]
                end = at + types[kind].length
                if end > len(data):
                    break
                if kind == _FMT:
                    number, made = _format(path, start + at, data[at:end])
                    _refuse_change(path, start + at, types.get(number), made)
                    types.setdefault(number, made)
                    if wanted(made.name):
                        kept[number] = types[number].raw
                elif kind in kept:
                    kept[kind] += data[at:end]
                at = end
            start += at
            rest = data[at:]
    if len(types) == 1:
        raise _damaged(path, 0, "it has no format of a message")
    return {one.name: one for one in types.values()}


def _damaged(path: Path, at: int, why: str) -> InputError:
    return InputError(
        f"{path.name} is not a DataFlash log or is damaged at byte {at}: {why}; copy it from the "
        "flight controller again"
    )


def _what(data: bytes, at: int) -> str:
    """Return what is wrong with the head of a message."""
    if data[at : at + 2] != HEAD:
        return "no message begins there"
    return f"a message of type {data[at + 2]}, which no format describes"


def _format(path: Path, at: int, raw: bytes) -> tuple[int, LoggedType]:
    """Return number and description of a type from an FMT message.

    Raises
    ------
    InputError
        Letters that are not known, or a length that is not that of the fields.
    """
    number, length, *texts = struct.unpack("<BB4s16s64s", raw[3:])
    name, letters, columns = (text.split(b"\0")[0].decode("latin-1") for text in texts)
    fields = tuple(columns.split(",")) if columns else ()
    unknown = set(letters) - set(_LETTERS)
    if unknown or len(fields) != len(letters) or len(set(fields)) != len(fields):
        raise _damaged(path, at, f"format of {shorten(name)!r} is {shorten(letters)!r}")
    size = 3 + sum(np.dtype(_LETTERS[letter][0]).itemsize for letter in letters)
    if number == _FMT:
        return _FMT, LoggedType("FMT", _FMT_BYTES, "", ())
    if size != length:
        raise _damaged(path, at, f"{name} has {length} bytes where its fields have {size}")
    return number, LoggedType(name, length, letters, fields)


def _refuse_change(path: Path, at: int, known: LoggedType | None, made: LoggedType) -> None:
    if known is not None and (known.letters, known.fields) != (made.letters, made.fields):
        raise _damaged(path, at, f"the format of {made.name} changes")
