"""A first pass over the raw bytes of a text file: its hash, its lines, and what is not text.

It reads in blocks: a file that cannot be used, however large, takes little time and memory.
"""

import codecs
import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from inercal.errors import InputError

BLOCK_BYTES = 1 << 22  # bytes
LONGEST_LINE = 1_000_000  # bytes
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


class Scan(NamedTuple):
    """Result of one pass over a text file.

    Parameters
    ----------
    sha256 : str
        In hexadecimal.
    lines : int
        Number of the last line that is not blank (1-based).
    line_bound : int
        Upper bound of the number of lines: a lone carriage return may end a line.
    """

    sha256: str
    lines: int
    line_bound: int


def scan(path: Path) -> Scan:
    """Read the bytes of a text file once.

    Raises
    ------
    InputError
        An empty file, binary data, text that is not UTF-8, or a line above `LONGEST_LINE`.
    OSError
        The file cannot be read.
    """
    digest = hashlib.sha256()
    decoder = codecs.getincrementaldecoder("utf-8")()
    complete = 0  # lines ended in the blocks before
    last = 0  # last line that is not blank
    unfinished = 0  # bytes of the line that the block before left open
    newline = b""
    ends_of_all_kinds = 0
    with path.open("rb") as file:
        while block := file.read(BLOCK_BYTES):
            digest.update(block)
            if not newline:
                _refuse_utf16(block, path.name)
                newline = b"\n" if b"\n" in block else b"\r"
            if (at := block.find(b"\0")) >= 0:
                line = complete + block.count(newline, 0, at) + 1
                raise InputError(
                    f"{path.name} line {line}: binary data where text is expected; export the "
                    "file as text",
                    line=line,
                )
            _refuse_other_encodings(decoder, block, complete, newline, path.name)
            ends = np.flatnonzero(np.frombuffer(block, np.uint8) == newline[0])
            lengths = np.diff(ends, prepend=-1 - unfinished, append=len(block))
            if (lengths > LONGEST_LINE).any():
                line = complete + int(np.argmax(lengths > LONGEST_LINE)) + 1
                raise InputError(
                    f"{path.name} line {line}: more than {LONGEST_LINE} bytes without a line end; "
                    "write each sample as a line of text",
                    line=line,
                )
            unfinished = int(lengths[-1]) - 1
            if text := block.rstrip():
                last = complete + block.count(newline, 0, len(text)) + 1
            complete += ends.size
            kinds = block.count(b"\n"), block.count(b"\r"), block.count(b"\r\n")
            ends_of_all_kinds += kinds[0] + kinds[1] - kinds[2]
    _refuse_other_encodings(decoder, None, complete, newline, path.name)
    if last == 0:
        raise InputError(f"{path.name} is empty: record or export it again")
    return Scan(digest.hexdigest(), last, ends_of_all_kinds + 1)


def _refuse_utf16(block: bytes, name: str) -> None:
    if block.startswith(_UTF16):
        raise InputError(f"{name} is UTF-16 text; save it as UTF-8")


def _refuse_other_encodings(
    decoder: codecs.IncrementalDecoder, block: bytes | None, lines: int, newline: bytes, name: str
) -> None:
    try:
        decoder.decode(block or b"", final=block is None)
    except UnicodeDecodeError as error:
        line = lines + error.object.count(newline, 0, error.start) + 1
        raise InputError(
            f"{name} line {line}: byte {error.object[error.start]:#04x} is not UTF-8 text; "
            "save the file as UTF-8",
            line=line,
        ) from error
