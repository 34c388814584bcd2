"""Writes corrected samples as CSV, JSON lines or MessagePack.

Text has nine significant digits, as the files of `inercal apply`; MessagePack has all digits. A
value that is missing is an empty cell, null or nil.
"""

import json
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.errors import require_extra
from inercal.pipeline.correction import SIGNIFICANT
from inercal.pipeline.live_correction import CorrectedBlock

_TIME_DECIMALS = 7


class Format(NamedTuple):
    """A format of the output.

    Parameters
    ----------
    head : bytes
        What a reader gets first.
    block : callable
        Function that returns the bytes of corrected samples.
    lost : callable
        Function that returns the bytes that tell a reader how many samples were lost.
    """

    head: bytes
    block: Callable[[CorrectedBlock], bytes]
    lost: Callable[[int], bytes]


def csv_format(names: Sequence[str]) -> Format:
    """Return the format of comma-separated lines with a header."""
    lines = _TextLines(["", *[","] * len(names), ","], "\n", "")
    head = ",".join(["time", *names, "flags"]) + "\n"
    return Format(head.encode(), lines.format, b"# lost %d samples\n".__mod__)


def json_format(names: Sequence[str]) -> Format:
    """Return the format of one JSON object per line."""
    keys = [json.dumps(name, ensure_ascii=False) + ":" for name in ("time", *names, "flags")]
    lines = _TextLines(["{" + keys[0], *("," + key for key in keys[1:])], "}\n", "null")
    return Format(b"", lines.format, b'{"lost":%d}\n'.__mod__)


def msgpack_format(names: Sequence[str]) -> Format:
    """Return the format of one MessagePack map per sample.

    Raises
    ------
    MissingExtra
        msgpack is not installed.
    """
    with require_extra("stream", "MessagePack needs msgpack; install the extra", ("msgpack",)):
        pack: Callable[[Any], bytes] = import_module("msgpack").Packer().pack
    keys = ("time", *names, "flags")

    def block(samples: CorrectedBlock) -> bytes:
        columns = [samples.time.tolist(), *samples.values.T.tolist(), samples.flags.tolist()]
        if np.isnan(samples.values).any():
            columns = [[None if x != x else x for x in column] for column in columns]
        rows = zip(*columns, strict=True)
        return b"".join([pack(dict(zip(keys, row, strict=True))) for row in rows])

    def lost(count: int) -> bytes:
        return pack({"lost": count})

    return Format(b"", block, lost)


FORMATS: dict[str, Callable[[Sequence[str]], Format]] = {
    "csv": csv_format,
    "json": json_format,
    "msgpack": msgpack_format,
}


class _TextLines:
    """Formats samples as lines: texts before each number, and after the last one."""

    def __init__(self, before: Sequence[str], end: str, missing: str):
        self._missing = missing
        first, *others, last = (text.replace("%", "%%") for text in before)
        time, flags = f"{first}%.{_TIME_DECIMALS}f", f"{last}%d{end.replace('%', '%%')}"
        number, text = ("".join(one + form for one in others) for form in (SIGNIFICANT, "%s"))
        self._numbers, self._texts = time + number + flags, time + text + flags

    def format(self, block: CorrectedBlock) -> bytes:
        """Return the lines of corrected samples."""
        line, n = self._numbers, block.time.size
        columns = [block.time.tolist(), *block.values.T.tolist(), block.flags.tolist()]
        if any(columns[-1]) and np.isnan(block.values).any():
            line = self._texts
            columns[1:-1] = [[self._text(x) for x in column] for column in columns[1:-1]]
        cells = tuple(chain.from_iterable(zip(*columns, strict=True)))
        return (line * n % cells).encode()

    def _text(self, value: float) -> str:
        return SIGNIFICANT % value if value == value else self._missing
