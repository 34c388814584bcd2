"""Read all bytes of a text file once, to find its hash, its lines, and anything that is not text.

The file is read in blocks, so an unusable file takes little time and memory, however large it is.
"""

import codecs
import hashlib
from pathlib import Path
from typing import NamedTuple

from inercal.basics.errors import InputError

BLOCK_BYTES = 1 << 22  # bytes
LONGEST_LINE = 1_000_000  # bytes
_UTF16_SAMPLE = 16  # bytes
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


class Scan(NamedTuple):
    """Result of the first pass over a text file.

    Parameters
    ----------
    sha256 : str
        Hash of the file in hexadecimal.
    lines : int
        Number of the last line that is not blank (1-based).
    line_bound : int
        Upper bound for the number of lines, because a lone carriage return may end a line.
    """

    sha256: str
    lines: int
    line_bound: int


def scan(path: Path) -> Scan:
    """Read all bytes of a text file once.

    Raises
    ------
    InputError
        The file is empty, binary or not UTF-8, or has a line longer than `LONGEST_LINE`.
    OSError
        The file cannot be read.
    """
    digest = hashlib.sha256()
    decoder = codecs.getincrementaldecoder("utf-8")()
    complete = 0  # number of lines that ended in earlier blocks
    last = 0  # number of the last line that is not blank
    unfinished = 0  # bytes of the line that the preceding block left incomplete
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
            unfinished = _refuse_long_line(block, newline, unfinished, complete, path.name)
            ends = block.count(newline)
            if text := block.rstrip():
                last = complete + ends - block.count(newline, len(text)) + 1
            complete += ends
            ends_of_all_kinds += ends
            other = b"\r" if newline == b"\n" else b"\n"
            if other in block:
                ends_of_all_kinds += block.count(other) - block.count(b"\r\n")
    _refuse_other_encodings(decoder, None, complete, newline, path.name)
    if last == 0:
        raise InputError(f"{path.name} is empty: record or export it again")
    return Scan(digest.hexdigest(), last, ends_of_all_kinds + 1)


def _refuse_long_line(
    block: bytes, newline: bytes, unfinished: int, complete: int, name: str
) -> int:
    """Refuse a line above `LONGEST_LINE`; return the length of the block's incomplete last line.

    The search jumps from one line end to the last one within reach, so it examines only few lines.
    """
    end = -1 - unfinished  # position of a line end relative to the block
    while end + LONGEST_LINE < len(block):
        further = block.rfind(newline, max(end + 1, 0), end + LONGEST_LINE + 1)
        if further < 0:
            line = complete + block.count(newline, 0, max(end + 1, 0)) + 1
            raise InputError(
                f"{name} line {line}: more than {LONGEST_LINE} bytes without a line end; "
                "write each sample as a line of text",
                line=line,
            )
        end = further
    last = block.rfind(newline)
    return len(block) - 1 - (end if last < 0 else last)


def _refuse_utf16(block: bytes, name: str) -> None:
    """Refuse a file that begins with a UTF-16 mark or has a zero byte next to each letter."""
    pairs = block[:_UTF16_SAMPLE]
    halves = ((pairs[::2], pairs[1::2]), (pairs[1::2], pairs[::2]))
    ascii_ = any(not any(zeros) and all(letters) for zeros, letters in halves)
    if block.startswith(_UTF16) or (len(pairs) == _UTF16_SAMPLE and ascii_):
        raise InputError(f"{name} is UTF-16 text; save it as UTF-8")


def _refuse_other_encodings(
    decoder: codecs.IncrementalDecoder, block: bytes | None, lines: int, newline: bytes, name: str
) -> None:
    if block is not None and block.isascii() and not decoder.getstate()[0]:
        return
    try:
        decoder.decode(block or b"", final=block is None)
    except UnicodeDecodeError as error:
        line = lines + error.object.count(newline, 0, error.start) + 1
        raise InputError(
            f"{name} line {line}: byte {error.object[error.start]:#04x} is not UTF-8 text; "
            "save the file as UTF-8",
            line=line,
        ) from error
