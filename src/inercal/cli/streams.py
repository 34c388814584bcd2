"""Standard output and error that survive closed pipes, full disks and missing characters.

A verb prints after its files are written. A closed pipe, a full disk or a character that the
terminal cannot show must not end the verb before its exit status is known.
"""

import codecs
import io
import os
import sys
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

# Replacements for characters that are not in the terminal's encoding.
_PLAIN = {
    "−": "-", "–": "-", "—": "-", "·": "*", "…": "...", "±": "+/-", "×": "x", "√": "sqrt",
    "°": "deg", "µ": "u", "μ": "u", "²": "2", "³": "3", "⁴": "4", "≤": "<=", "≥": ">=",
    "σ": "sigma", "χ": "chi", "ω": "omega", "Δ": "Delta", "‖": "|", "“": '"', "”": '"', "’": "'",
}  # fmt: skip


def _in_plain_characters(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement for characters not in an encoding (a handler for `codecs`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    hidden = error.object[error.start : error.end]
    return "".join(_PLAIN.get(one, "?") for one in hidden), error.end


codecs.register_error("inercal-plain", _in_plain_characters)


class _LastingOutput(io.RawIOBase):
    """A raw output that discards bytes after the first error, and stores this error.

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
    """Standard output and error of the program, protected against write errors.

    Streams that a test or another program has replaced are not changed.
    """

    def __init__(self):
        self._output: _LastingOutput | None = None
        if sys.stdout is sys.__stdout__:
            sys.stdout, self._output = _guarded(sys.stdout, 1)
        if sys.stderr is sys.__stderr__:
            sys.stderr, _ = _guarded(sys.stderr, 2)

    def output_error(self) -> OSError | None:
        """Return the write error on standard output, if any; a closed pipe is not an error."""
        if self._output is None:
            return None
        sys.stdout.flush()
        broken = self._output.broken
        return None if isinstance(broken, BrokenPipeError) else broken


def _guarded(stream: TextIO | None, descriptor: int) -> tuple[io.TextIOWrapper, _LastingOutput]:
    """Return a protected stream on the same descriptor, or one to nowhere if it was closed."""
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
