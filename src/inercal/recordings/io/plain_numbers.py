"""Fast parsing of plain text with pyarrow, if the result equals that of NumPy's parser.

A file is plain if, below its header, it contains only digits, signs, exponents, decimal points,
separators, spaces and line ends. If columns of words are wanted, it must contain no quotation mark,
comment or bracket. Both parsers round correctly, so the numbers are equal to the last bit. If
pyarrow refuses a file, for example because of an empty cell or a row of a different length, the
tolerant parser reads it instead and fills the cell or names the line.

A thread of pyarrow reads, checks and hashes each block while the blocks before it are parsed, so a
plain file is read only once.

All bytes of a text file are read once, to find its hash, its lines, and anything that is not text.
The file is read in blocks, so an unusable file takes little time and memory, however large it is.
"""

import codecs
import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from io import BufferedReader, RawIOBase
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import Array, file_head, label_array, shorten
from inercal.recordings.io.text_layout import COMMENTS, TextLayout

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


SMALLEST = 1 << 22  # bytes; for smaller files, importing pyarrow takes longer than it saves
_BLOCK = 1 << 17  # bytes parsed at a time; pyarrow reads ahead 32 of these blocks
_NUMBER_BYTES = b"0123456789+-.eE "
_SAMPLE_BYTES = 1 << 20  # at the beginning of a file
_FEWEST_LINES = 1000  # in the sample; the layout is then found without reading much more


class _NotPlainError(ValueError):
    """The file contains text that the two parsers might read differently."""


def probable_rows(path: Path) -> int:
    """Return about how many rows a text file has; 0 if it is short or obviously not plain."""
    size = path.stat().st_size
    if size < SMALLEST or find_spec("pyarrow") is None:
        return 0
    sample = file_head(path, _SAMPLE_BYTES)
    if b"\0" in sample or (lines := sample.count(b"\n")) < _FEWEST_LINES:
        return 0
    return size * lines // len(sample)


def load_plain(
    path: Path, layout: TextLayout, places: Mapping[str, Array], words: Collection[int]
) -> tuple[dict[int, NDArray[np.str_]], int, Scan] | None:
    """Read numbers into `places`; return the columns of words, the number of rows, and the scan.

    Return None if the file is small or not plain, if it has more rows than `places`, or if pyarrow
    is not installed. The content of `places` is then undefined.

    Parameters
    ----------
    path : Path
    layout : TextLayout
    places : mapping of str to (n,) array
        Arrays for the columns, by column number.
    words : collection of int
        Numbers of the columns with words.
    """
    if not layout.is_plain or path.stat().st_size < SMALLEST or find_spec("pyarrow") is None:
        return None
    try:
        return _load(path, layout, places, words)
    except ValueError:  # also raised by pyarrow, and by NumPy if an array is full
        return None


def _load(
    path: Path, layout: TextLayout, places: Mapping[str, Array], words: Collection[int]
) -> tuple[dict[int, NDArray[np.str_]], int, Scan]:
    parts: dict[int, list[NDArray[np.str_]]] = {k: [] for k in words}
    n = 0
    with path.open("rb") as file:
        source = _ScannedBytes(file, layout, bool(words))
        for batch in _batches(source, layout, places, words):
            rows = int(batch.num_rows)
            for name, place in places.items():
                # `to_numpy` would import pandas where it is installed.
                place[n : n + rows] = np.from_dlpack(batch.column(name))
                if words and not np.isfinite(place[n : n + rows]).all():
                    raise _NotPlainError
            for k, part in parts.items():
                cells = [cell.strip() for cell in batch.column(str(k)).to_pylist()]
                part.append(label_array(cells, layout.names[k], path.name))
            n += rows
    labels = {k: np.concatenate(part) for k, part in parts.items()}
    return labels, n, Scan(source.digest.hexdigest(), source.last_line, n)


def plain_blocks(path: Path, layout: TextLayout, columns: Sequence[str]) -> Iterator[Array]:
    """Yield the rows of number columns in a plain file, (k, c), in blocks.

    Raises
    ------
    InputError
        The file is not plain.
    """
    names = [str(layout.names.index(name)) for name in columns]
    try:
        with path.open("rb") as file:
            for batch in _batches(_PlainBytes(file, layout), layout, names, ()):
                found = [np.from_dlpack(batch.column(name)) for name in names]
                yield np.stack([np.asarray(one, np.float64) for one in found], axis=1)
    except ValueError as error:
        reason = "" if isinstance(error, _NotPlainError) else f" ({shorten(str(error), 120)})"
        raise InputError(
            f"{path.name} is too long to be read at once, and only plain numbers in rows of "
            f"equal length can be read in pieces{reason}: correct it, or export only the "
            "columns you use",
            file=path,
        ) from error


def _batches(
    source: RawIOBase, layout: TextLayout, numbers: Iterable[str], words: Collection[int]
) -> Iterator[Any]:
    """Yield pyarrow's record batches with the wanted columns, named by their numbers."""
    pyarrow: Any = import_module("pyarrow")
    csv: Any = import_module("pyarrow.csv")
    types = {name: pyarrow.float64() for name in numbers}
    types |= {str(k): pyarrow.string() for k in words}
    yield from csv.open_csv(
        source,
        read_options=csv.ReadOptions(
            use_threads=False,
            block_size=_BLOCK,
            column_names=[str(k) for k in range(len(layout.names))],
        ),
        parse_options=csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        convert_options=csv.ConvertOptions(
            include_columns=list(types), column_types=types, null_values=[]
        ),
    )


class _PlainBytes(RawIOBase):
    """The part of a file below its header; raises `_NotPlainError` for content that is not plain.

    Parameters
    ----------
    file : BufferedReader
    layout : TextLayout
    words : bool
        Whether columns of words are wanted.
    """

    def __init__(self, file: BufferedReader, layout: TextLayout, words: bool = False):
        self._file, self._lines = file, layout.first_line - 1
        self._header = b"".join(islice(file, self._lines))
        if b"\r" in self._header.replace(b"\r\n", b""):
            raise _NotPlainError  # a lone carriage return may end a line
        suspect = b'"(\0\r\n' + COMMENTS.encode()
        numbers = _NUMBER_BYTES + (layout.delimiter or "").encode()
        self._plain = bytes(range(256)).translate(None, suspect) if words else numbers

    def readable(self) -> bool:
        """Return True."""
        return True

    def read(self, size: int = -1, /) -> bytes:
        """Read the next bytes.

        Raises
        ------
        _NotPlainError
            The bytes are not plain.
        """
        block = self._file.read(size)
        ends = block.translate(None, self._plain)
        if ends.strip(b"\r\n"):
            raise _NotPlainError
        self._lines += ends.count(b"\n")
        return block


class _ScannedBytes(_PlainBytes):
    """Finds in the same pass what `scan` finds, and raises ValueError if that refuses.

    Attributes
    ----------
    digest : hash
        SHA-256 of the file up to the last byte that was read.
    last_line : int
        Number of the last line that is not blank (1-based).
    """

    def __init__(self, file: BufferedReader, layout: TextLayout, words: bool):
        super().__init__(file, layout, words)
        if b"\0" in self._header or len(self._header) > LONGEST_LINE:
            raise _NotPlainError
        self.digest, self.last_line = hashlib.sha256(self._header), 0
        self._decoder = codecs.getincrementaldecoder("utf-8")() if words else None

    def read(self, size: int = -1, /) -> bytes:
        """Read the next bytes; see `_PlainBytes.read`."""
        block = super().read(size)
        self.digest.update(block)
        if self._decoder is not None:
            self._decoder.decode(block, final=not block)
        if text := block.rstrip():
            self.last_line = self._lines - block.count(b"\n", len(text)) + 1
        return block
