"""Parses descriptions of packets into field offsets, fixed bytes and patterns.

The description of a binary packet is a list of words in the order of the bytes:

- `FA`, two hexadecimal digits: a fixed byte; a packet begins with one or more fixed bytes;
- `ax:i16`: a field with its role and type, here a signed 16-bit integer; `-ay:i16` reverses the
  sign;
- `_` or `_:4`: one byte, or four bytes, that are ignored;
- `crc16-xmodem@1`: a checksum over the bytes from 1 (counted from 0) up to the checksum itself.

Types are u and i (8, 16, 24, 32 or 64 bits) and f (32 or 64 bits). `:be` or `:le` after a field or
checksum overrides the byte order of the packet. Comments begin with # and end at the end of the
line.

A line of text is described by a Python format: `{ax:.6f}` is a number with six decimals,
`{counter:d}` is an integer, `{status:08x}` is a hexadecimal number, and `{_:0}` is any text
(written as 0). `{crc32-novatel@1:08x}` is a checksum over the characters from 1 up to the separator
before the checksum.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.errors import InputError
from inercal.host.packets.checksums import CHECKS, ByteSum, Crc

AXES = ("ax", "ay", "az", "gx", "gy", "gz")
ROLES = (*AXES, "temperature", "counter", "time", "status")
MAX_LENGTH = 1024  # bytes of a packet, or characters of a line format

_BYTE = re.compile(r"[0-9A-Fa-f]{2}")
_SKIP = re.compile(r"_(?::(\d{1,4}))?")
_FIELD = re.compile(r"(-?)(\w+):([ui](?:8|16|24|32|64)|f(?:32|64))(?::(be|le))?")
_CHECK = re.compile(r"([\w-]+)@(\d{1,4})(?::(be|le))?")
_SPEC = re.compile(r"\.\d{1,2}[fe]|d|0?\d{0,2}x")
# Repetitions are limited, so every match is a finite number, and no line is long.
_NUMBER = {
    "d": rb"[+-]?\d{1,18}",
    "f": rb"[+-]?(?:\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][+-]?\d{1,2})?",
    "x": rb"[0-9A-Fa-f]{1,8}",
}
_NUMBER["e"] = _NUMBER["f"]


class Field(NamedTuple):
    """A number in a packet: role, sign, type, and first byte (or place in the line)."""

    role: str
    sign: float
    type: str
    at: int

    @property
    def bits(self) -> int:
        """Number of bits of an integer in a binary packet; 0 for real numbers and text."""
        return int(self.type[1:]) if self.type[0] in "ui" else 0

    @property
    def limits(self) -> tuple[float, float]:
        """The smallest and largest integers of this type that are floats."""
        signed = self.type[0] != "u"
        low, high = -(2.0 ** (self.bits - 1)) * signed, 2.0 ** (self.bits - signed)
        return low, float(np.nextafter(high, 0)) if self.bits == 64 else high - 1


class CheckField(NamedTuple):
    """A checksum over the bytes from `start` up to its own position `at`."""

    kind: Crc | ByteSum
    start: int
    at: int
    order: str


@dataclass(frozen=True)
class BinaryFrame:
    """The format of a binary packet.

    Parameters
    ----------
    length : int
        Number of bytes.
    constants : tuple of (int, int)
        Offset and value of the fixed bytes; the first offset is 0.
    fields : tuple of Field
    checks : tuple of CheckField
    dtype : numpy.dtype
        Structured type with the fields by role; 24-bit integers consist of three bytes.
    byte_orders : mapping of str to str
        Byte order, "big" or "little", for each role.
    """

    length: int
    constants: tuple[tuple[int, int], ...]
    fields: tuple[Field, ...]
    checks: tuple[CheckField, ...]
    dtype: np.dtype[Any]
    byte_orders: dict[str, str]


@dataclass(frozen=True)
class TextLine:
    """The format of a line of text.

    Parameters
    ----------
    text : str
        The description as a Python format.
    fields : tuple of Field
        Fields. `type` is the format, and `at` is the number of the group in the regular expression.
    checks : tuple of CheckField
        At most one checksum. `at` is the number of the group, and `start` counts from the first
        character of the line.
    """

    text: str
    fields: tuple[Field, ...]
    checks: tuple[CheckField, ...]

    @property
    def accepts_truncated_lines(self) -> bool:
        """Whether a line without its first characters may be mistaken for a complete line."""
        return self.text.startswith("{") and not self.checks

    @cached_property
    def pattern(self) -> re.Pattern[bytes]:
        """Pattern of a whole line; a checksum may cover group 1, and the other groups are fields.

        If a line begins with a fixed character, other characters may precede it.
        """
        covered, rest = b"", b""
        for literal, name, spec, _ in Formatter().parse(self.text):
            piece = re.escape(literal.encode())
            if name is not None and "@" not in name:
                any_text = rb"[^,;*\s]{0,64}"
                piece += any_text if name == "_" else b"(" + _NUMBER[(spec or "d")[-1]] + b")"
            if name is not None and "@" in name:  # the checksum does not cover the separator
                covered += re.escape(literal[:-1].encode())
                digits = self.checks[0].kind.bits // 4
                rest = re.escape(literal[-1:].encode()) + rb"([0-9a-f]{%d})" % digits
            elif rest:
                rest += piece
            else:
                covered += piece
        anchor = b"^" if self.text.startswith("{") else b""
        return re.compile(anchor + b"(" + covered + b")" + rest + rb"(\r?\n)", re.MULTILINE)


def _require_valid_role(role: str, seen: list[str], kind: str) -> None:
    """Raise an error if a role is unknown, occurs twice, or needs an integer type."""
    if role not in ROLES:
        raise InputError(f"unknown role {role!r}; the roles are {', '.join(ROLES)}", names=(role,))
    if role in seen:
        raise InputError(f"{role!r} is named twice; name each role once", names=(role,))
    if role in ("counter", "status") and kind[-1] not in "dx" and kind[0] not in "ui":
        raise InputError(
            f"{role!r} is a whole number and cannot be of type {kind!r}; take an integer type",
            names=(role,),
        )


def _named_check(name: str) -> Crc | ByteSum:
    if name not in CHECKS:
        raise InputError(
            f"unknown check {name!r}; the checks are {', '.join(CHECKS)}", names=(name,)
        )
    return CHECKS[name]


def read_frame(text: str, order: str | None) -> BinaryFrame:
    """Parse the description of a binary packet.

    Parameters
    ----------
    text : str
    order : "big", "little" or None
        Byte order of fields and checksums that state no byte order.

    Raises
    ------
    InputError
        A word is invalid, a role occurs twice, the first byte is not fixed, or a byte order is
        missing.
    """
    at, constants, fields, checks = 0, list[tuple[int, int]](), list[Field](), list[CheckField]()
    formats, orders = dict[str, Any](), dict[str, str]()

    def ordered(word: str, own: str | None, size: int) -> str:
        """Return the byte order of a field or checksum."""
        if size > 1 and not (own or order):
            raise InputError(
                f'{word!r} has no byte order; add byte_order = "little" or "big"', names=(word,)
            )
        return {"be": "big", "le": "little"}[own] if own else order or "little"

    for word in re.sub("#.*", "", text).split():
        if _BYTE.fullmatch(word):
            constants.append((at, int(word, 16)))
            at += 1
        elif skip := _SKIP.fullmatch(word):
            at += int(skip[1] or 1)
        elif found := _FIELD.fullmatch(word):
            sign, role, kind, own = found.groups()
            _require_valid_role(role, [field.role for field in fields], kind)
            size = int(kind[1:]) // 8
            orders[role] = ordered(word, own, size)
            mark = ">" if orders[role] == "big" else "<"
            formats[role] = ("u1", (3,)) if size == 3 else f"{mark}{kind[0]}{size}"
            fields.append(Field(role, -1.0 if sign else 1.0, kind, at))
            at += size
        elif found := _CHECK.fullmatch(word):
            kind, start = _named_check(found[1]), int(found[2])
            if start >= at:
                raise InputError(
                    f"{word!r} covers bytes from {start}, but the check itself is at byte {at}; "
                    "let it begin before",
                    names=(word,),
                )
            checks.append(CheckField(kind, start, at, ordered(word, found[3], kind.bits // 8)))
            at += kind.bits // 8
        else:
            raise InputError(
                f"{word!r} is neither a byte ('FA'), a field ('ax:i16'), a gap ('_:2') nor a check "
                "('sum8@0'); the types of fields are u or i with 8 to 64 bits, f32 and f64",
                names=(word,),
            )
    if not constants or constants[0][0] != 0:
        raise InputError(
            "the packet does not begin with a fixed byte; add one or more, such as 'AA 55'"
        )
    if at > MAX_LENGTH:
        raise InputError(f"the packet has {at} bytes; at most {MAX_LENGTH} are possible")
    dtype = np.dtype(
        {
            "names": list(formats),
            "formats": list(formats.values()),
            "offsets": [field.at for field in fields],
            "itemsize": at,
        }
    )
    return BinaryFrame(at, tuple(constants), tuple(fields), tuple(checks), dtype, orders)


def read_line(text: str) -> TextLine:
    """Parse the description of a line of text.

    Raises
    ------
    InputError
        A field is invalid, a role occurs twice, two fields have no separator, or there are two
        checksums.
    """
    fields, checks, group = list[Field](), list[CheckField](), 1
    try:
        parts = list(Formatter().parse(text))
    except ValueError as error:
        raise InputError(
            f"not a Python format: {error}; write a line such as '{{counter:d}},{{ax:.6f}}'"
        ) from None
    if len(text) > MAX_LENGTH or not text.isascii() or not text.isprintable():
        raise InputError(
            f"a line may have {MAX_LENGTH} characters, all printable ASCII; shorten or correct it"
        )
    for k, (literal, name, spec, _) in enumerate(parts):
        if name is None or name == "_":
            continue
        if k and not literal:
            raise InputError(
                f"nothing separates {name!r} from the field before it; add a character between",
                names=(name,),
            )
        if not _SPEC.fullmatch(spec or ""):
            raise InputError(
                f"'{{{name}:{spec}}}' has an unknown format; use :d, :.6f, :.6e or :08x",
                names=(name,),
            )
        group += 1
        found = _CHECK.fullmatch(name)
        if found and fields and not checks:
            checks.append(CheckField(_named_check(found[1]), int(found[2]), group, "big"))
            continue
        _require_valid_role(name.removeprefix("-"), [field.role for field in fields], str(spec))
        sign = -1.0 if name.startswith("-") else 1.0
        fields.append(Field(name.removeprefix("-"), sign, str(spec), group))
    if sum(name is not None for _, name, _, _ in parts) > _MAX_FIELDS:
        raise InputError(
            f"the line has more than {_MAX_FIELDS} fields; at most {_MAX_FIELDS} are possible"
        )
    return TextLine(text, tuple(fields), tuple(checks))


_MAX_FIELDS = 40  # fields in a line; a matching line is then always shorter than the buffer
