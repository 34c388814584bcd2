"""Standard output and error that no reader, disk or encoding can break.

A verb has written its files when it prints. A reader that closes the pipe, a full disk or a
terminal that cannot show a character must not end it before its exit status is known.
"""

import codecs
import io
import os
import sys
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

# What a terminal shows instead of a character that its encoding has not.
_PLAIN = {
    "−": "-", "–": "-", "—": "-", "·": "*", "…": "...", "±": "+/-", "×": "x", "√": "sqrt",
    "°": "deg", "µ": "u", "μ": "u", "²": "2", "³": "3", "⁴": "4", "≤": "<=", "≥": ">=",
    "σ": "sigma", "χ": "chi", "ω": "omega", "Δ": "Delta", "‖": "|", "“": '"', "”": '"', "’": "'",
}  # fmt: skip


def _in_plain_characters(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement for characters that an encoding has not (a handler of `codecs`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    hidden = error.object[error.start : error.end]
    return "".join(_PLAIN.get(one, "?") for one in hidden), error.end


codecs.register_error("inercal-plain", _in_plain_characters)


class _LastingOutput(io.RawIOBase):
    """A descriptor that accepts and discards bytes after an error, and keeps the error.

    Parameters
    ----------
    descriptor : int
    """

    def __init__(self, descriptor: int):
        self._descriptor = descriptor
        self.broken: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, b: "ReadableBuffer", /) -> int:
        if self.broken is None:
            try:
                return os.write(self._descriptor, b)
            except OSError as error:
                self.broken = error
        return memoryview(b).nbytes


class StandardStreams:
    """Standard output and error of the program, guarded.

    Streams that a test or another program has put in their place stay as they are.
    """

    def __init__(self):
        self._output: _LastingOutput | None = None
        if sys.stdout is sys.__stdout__:
            sys.stdout, self._output = _guarded(sys.stdout, 1)
        if sys.stderr is sys.__stderr__:
            sys.stderr, _ = _guarded(sys.stderr, 2)

    def output_error(self) -> OSError | None:
        """Return why standard output did not take all; None also where its reader had enough."""
        if self._output is None:
            return None
        sys.stdout.flush()
        broken = self._output.broken
        return None if isinstance(broken, BrokenPipeError) else broken


def _guarded(stream: TextIO | None, descriptor: int) -> tuple[io.TextIOWrapper, _LastingOutput]:
    """Return a stream on the same descriptor that lasts; where it was closed, one to nowhere."""
    if stream is None:
        descriptor = os.open(os.devnull, os.O_WRONLY)
    else:
        stream.flush()
    raw = _LastingOutput(descriptor)
    text = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding="utf-8" if stream is None else stream.encoding,
        errors="inercal-plain",
        line_buffering=descriptor == 2 or raw.isatty(),
    )
    return text, raw
