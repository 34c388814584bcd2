"""Fast parsing of plain text with pyarrow, if the result equals that of NumPy's parser.

A file is plain if, below its header, it contains only digits, signs, exponents, decimal points,
separators, spaces and line ends. If columns of words are wanted, it must contain no quotation mark,
comment or bracket. Both parsers round correctly, so the numbers are equal to the last bit. If
pyarrow refuses a file, for example because of an empty cell or a row of a different length, the
tolerant parser reads it instead and fills the cell or names the line.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from io import RawIOBase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import Array, label_array, shorten
from inercal.recordings.io.text_layout import TextLayout

SMALLEST = 1 << 22  # bytes; for smaller files, importing pyarrow takes longer than it saves
_BLOCK = 1 << 17  # bytes parsed at a time; pyarrow reads ahead 32 of these blocks
_NUMBER_BYTES = b"0123456789+-.eE \r\n"


class _NotPlainError(ValueError):
    """The file contains text that the two parsers might read differently."""


def load_plain(
    path: Path, layout: TextLayout, places: Mapping[str, Array], words: Collection[int]
) -> tuple[dict[int, NDArray[np.str_]], int] | None:
    """Read numbers into `places`, and return the columns of words and the number of rows.

    Return None if the file is small or not plain, or if pyarrow is not installed. The content of
    `places` is then undefined.

    Parameters
    ----------
    path : Path
    layout : TextLayout
    places : mapping of str to (n,) array
        Arrays for the columns, by column number, with at least as many rows as the file.
    words : collection of int
        Numbers of the columns with words.
    """
    if not layout.is_plain or path.stat().st_size < SMALLEST or find_spec("pyarrow") is None:
        return None
    try:
        return _load(path, layout, places, words)
    except ValueError:  # pyarrow's refusals are ValueErrors too
        return None


def _load(
    path: Path, layout: TextLayout, places: Mapping[str, Array], words: Collection[int]
) -> tuple[dict[int, NDArray[np.str_]], int]:
    parts: dict[int, list[NDArray[np.str_]]] = {k: [] for k in words}
    n = 0
    for batch in _batches(path, layout, places, words):
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
    return {k: np.concatenate(part) for k, part in parts.items()}, n


def plain_blocks(path: Path, layout: TextLayout, columns: Sequence[str]) -> Iterator[Array]:
    """Yield the rows of number columns in a plain file, (k, c), in blocks.

    Raises
    ------
    InputError
        The file is not plain.
    """
    names = [str(layout.names.index(name)) for name in columns]
    try:
        for batch in _batches(path, layout, names, ()):
            found = [np.asarray(np.from_dlpack(batch.column(name)), np.float64) for name in names]
            yield np.stack(found, axis=1)
    except ValueError as error:
        reason = "" if isinstance(error, _NotPlainError) else f" ({shorten(str(error), 120)})"
        raise InputError(
            f"{path.name} is too long to be read at once, and only plain numbers in rows of "
            f"equal length can be read in pieces{reason}: correct it, or export only the "
            "columns you use",
            file=path,
        ) from error


def _batches(
    path: Path, layout: TextLayout, numbers: Iterable[str], words: Collection[int]
) -> Iterator[Any]:
    """Yield pyarrow's record batches with the wanted columns, named by their numbers."""
    pyarrow: Any = import_module("pyarrow")
    csv: Any = import_module("pyarrow.csv")
    types = {name: pyarrow.float64() for name in numbers}
    types |= {str(k): pyarrow.string() for k in words}
    with path.open("rb", buffering=0) as file:
        _skip_lines(file, layout.first_line - 1)
        yield from csv.open_csv(
            _PlainBytes(file, layout, bool(words)),
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


def _skip_lines(file: RawIOBase, lines: int) -> None:
    """Move to the start of a line by skipping the given number of lines."""
    start, skipped = 0, 0
    while skipped < lines:
        block = file.read(_BLOCK) or b""
        if not block or b"\r" in block.replace(b"\r\n", b"").rstrip(b"\r"):
            raise _NotPlainError  # a lone carriage return may end a line
        ends = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n"))
        left = lines - skipped
        if left <= ends.size:
            file.seek(start + int(ends[left - 1]) + 1)
            return
        start, skipped = start + len(block), skipped + ends.size


class _PlainBytes(RawIOBase):
    """The remaining part of a file; raises `_NotPlainError` for content that is not plain.

    Parameters
    ----------
    file : RawIOBase
    layout : TextLayout
    words : bool
        Whether columns of words are wanted.
    """

    def __init__(self, file: RawIOBase, layout: TextLayout, words: bool):
        self._file, self._words = file, words
        self._number_bytes = _NUMBER_BYTES + (layout.delimiter or "").encode()
        self._suspect = (b'"', b"(", b"\0", layout.comment.encode())

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
        block = self._file.read(size) or b""
        if self._words:
            odd = any(some in block for some in self._suspect)
        else:
            odd = bool(block.translate(None, self._number_bytes))
        if odd:
            raise _NotPlainError
        return block
