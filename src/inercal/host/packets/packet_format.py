"""Reads descriptions of packets, in the order of their bytes, into offsets and patterns.

The description of a binary packet is a row of words:

- `FA`, two hexadecimal digits: a byte that is always there; the packet begins with one or more;
- `ax:i16`: a field by its role, here a signed integer of 16 bits; `-ay:i16` has its sign reversed;
- `_` or `_:4`: one byte or four that mean nothing here;
- `crc16-xmodem@1`: a check over the bytes from 1 (counted from 0) up to the check itself.

Types are u, i (8, 16, 24, 32, 64 bits) and f (32, 64); `:be` or `:le` behind a field or check
departs from the byte order of the packet. Remarks go from # to the end of their line.

A line of text is a Python format: `{ax:.6f}` a number with six decimals, `{counter:d}` a whole one,
`{status:08x}` a hexadecimal one, `{_:0}` anything (written as 0), `{crc32-novatel@1:08x}` a check
over the characters from 1 up to the separator before the check.
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
MAX_LENGTH = 1024  # bytes of a packet, characters of a line's picture

_BYTE = re.compile(r"[0-9A-Fa-f]{2}")
_SKIP = re.compile(r"_(?::(\d{1,4}))?")
_FIELD = re.compile(r"(-?)(\w+):([ui](?:8|16|24|32|64)|f(?:32|64))(?::(be|le))?")
_CHECK = re.compile(r"([\w-]+)@(\d{1,4})(?::(be|le))?")
_SPEC = re.compile(r"\.\d{1,2}[fe]|d|0?\d{0,2}x")
# Bounded, so that any match is a finite number and no line is long.
_NUMBER = {
    "d": rb"[+-]?\d{1,18}",
    "f": rb"[+-]?(?:\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][+-]?\d{1,2})?",
    "x": rb"[0-9A-Fa-f]{1,8}",
}
_NUMBER["e"] = _NUMBER["f"]


class Field(NamedTuple):
    """A number of a packet: its role, sign and type, and its first byte (or place in the line)."""

    role: str
    sign: float
    type: str
    at: int

    @property
    def bits(self) -> int:
        """Of an integer in a binary packet; 0 for real numbers and for text."""
        return int(self.type[1:]) if self.type[0] in "ui" else 0


class CheckField(NamedTuple):
    """A check over bytes `start` to `at`, where it stands itself."""

    kind: Crc | ByteSum
    start: int
    at: int
    order: str


@dataclass(frozen=True)
class BinaryFrame:
    """A binary packet.

    Parameters
    ----------
    length : int
        Bytes.
    constants : tuple of (int, int)
        Offset and value of the bytes that never change; the first is at 0.
    fields : tuple of Field
    checks : tuple of CheckField
    dtype : numpy.dtype
        Structured; fields by role, 24-bit integers as three bytes.
    byte_orders : mapping of str to str
        "big" or "little", by role.
    """

    length: int
    constants: tuple[tuple[int, int], ...]
    fields: tuple[Field, ...]
    checks: tuple[CheckField, ...]
    dtype: np.dtype[Any]
    byte_orders: dict[str, str]


@dataclass(frozen=True)
class TextLine:
    """A line of text.

    Parameters
    ----------
    text : str
        The picture.
    fields : tuple of Field
        `type` is the format; `at` the number of the regular expression's group.
    checks : tuple of CheckField
        None or one; `at` is the group's number, `start` counts from the line's first character.
    """

    text: str
    fields: tuple[Field, ...]
    checks: tuple[CheckField, ...]

    @property
    def accepts_truncated_lines(self) -> bool:
        """Whether a line that has lost its first characters may pass for a whole one."""
        return self.text.startswith("{") and not self.checks

    @cached_property
    def pattern(self) -> re.Pattern[bytes]:
        """Matches a whole line; group 1 is what the check may cover, groups from 2 on are fields.

        A line that begins with a fixed character may follow rubbish on the same line.
        """
        covered, rest = b"", b""
        for literal, name, spec, _ in Formatter().parse(self.text):
            piece = re.escape(literal.encode())
            if name is not None and "@" not in name:
                any_text = rb"[^,;*\s]{0,64}"
                piece += any_text if name == "_" else b"(" + _NUMBER[(spec or "d")[-1]] + b")"
            if name is not None and "@" in name:  # the separator is not covered
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
    """Refuse a role that is none, that comes twice, or that counts with real numbers."""
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
    """Read the picture of a binary packet.

    Parameters
    ----------
    text : str
    order : "big", "little" or None
        Byte order of fields and checks that do not state their own.

    Raises
    ------
    InputError
        A word that is none, a role twice, no fixed byte to begin with, or no stated byte order.
    """
    at, constants, fields, checks = 0, list[tuple[int, int]](), list[Field](), list[CheckField]()
    formats, orders = dict[str, Any](), dict[str, str]()

    def ordered(word: str, own: str | None, size: int) -> str:
        """Return the byte order of a field or check."""
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
    """Read the picture of a line of text.

    Raises
    ------
    InputError
        A field that is none, a role twice, two fields without a separator, or two checks.
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


_MAX_FIELDS = 40  # fields of a line, so that no line that matches is longer than `text` holds back
