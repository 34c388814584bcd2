"""Read small hand-written files safely: run files, packet descriptions, tables.

Reading never waits, because FIFOs and devices are rejected. Files larger than `LARGEST` are not
read. TOML nested deeper than `DEEPEST` is rejected, because code that walks through the levels
would exceed Python's recursion limit.
"""

import codecs
import csv
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from inercal.basics.errors import InputError, error_location

# Windows has no FIFOs, but it would translate line ends without this flag.
_FLAGS = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
LARGEST = 4 << 20  # bytes; run files take a few kilobytes
DEEPEST = 32  # levels of nested sections and lists
# This matches strings and comments, which may contain anything, and then a dotted key with more
# levels than allowed. Quantifiers are possessive and a key is only matched from its start, so the
# time grows linearly with the length of the text.
_STRING_OR_COMMENT = re.compile(
    r'''"""(?s:[^"\\]|\\.|"(?!""))*+"""|'{3}(?s:.)*?'{3}|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+'|#[^\n]*+'''
)
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")


def read_small_file(path: Path, what: str = "file", largest: int = LARGEST) -> bytes:
    """Return the bytes of a regular file, unless it is too large.

    Parameters
    ----------
    path : path
    what : str
        The expected kind of file, used in messages, such as "run file".
    largest : int
        Largest accepted size in bytes.

    Raises
    ------
    InputError
        The file does not exist, is not a regular file, is larger than `largest`, or cannot be read.
    """
    try:
        # Without O_NONBLOCK, opening a FIFO that nobody writes to would wait forever.
        descriptor = os.open(path, os.O_RDONLY | _FLAGS)
        with open(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise InputError(f"{path}: not a regular file; give a {what}", file=path)
            raw = file.read(largest + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}; check the path", file=path) from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; give a {what}", file=path) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}", file=path) from None
    except ValueError as error:  # a null character in the name
        raise InputError(
            f"{str(path)!r} is not a possible name for a {what}: {error}; give another path"
        ) from None
    if len(raw) > largest:
        raise InputError(
            f"more than {largest} bytes, too many for a {what}; check that this is the right file"
        ).located(path)
    return raw


def is_file(path: Path) -> bool:
    """Return whether a path refers to a regular file; False if it is not a valid name.

    `Path.is_file` raises OSError if a name is too long.
    """
    return os.path.isfile(path)


def parse_toml(raw: bytes | str, what: str = "file") -> dict[str, Any]:
    """Parse a TOML text.

    Parameters
    ----------
    raw : bytes or str
    what : str
        The expected kind of text, used in messages, such as "run file".

    Raises
    ------
    InputError
        The text is not TOML, not UTF-8, or nested deeper than `DEEPEST`. The caller adds the file
        name to the message.
    """
    text = raw if isinstance(raw, str) else _decoded(raw, what)
    # Checked before parsing: the memory for a dotted key grows with the square of its depth.
    if _DEEP_KEY.search(_STRING_OR_COMMENT.sub("x", text)):
        raise InputError(_too_deep(what))
    try:
        content = tomllib.loads(text)
    except ValueError as error:  # a syntax error, or an integer with 5000 digits
        place = re.search(r"at line (\d+)", str(error))
        line = int(place[1]) if place else None
        # tomllib's message for a key that is stated twice.
        reason = str(error).replace("Cannot overwrite a value", "a key is stated twice")
        raise InputError(
            f"not a TOML {what}: {_other_content(raw, what) or reason}", line=line
        ) from None
    except RecursionError:
        raise InputError(_too_deep(what)) from None
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        level = [
            inner for outer in level for inner in _members(outer) if isinstance(inner, dict | list)
        ]
        if not level:
            return content
    raise InputError(_too_deep(what))


def _other_content(raw: bytes | str, what: str) -> str:
    """Return a message about the format that a file seems to have if not TOML, or ""."""
    head = raw[:1000] if isinstance(raw, str) else raw[:1000].decode("utf-8-sig", "replace")
    lines = (line.strip() for line in head.splitlines())
    line = next((line for line in lines if line and not line.startswith("#")), "")
    if line.startswith("{"):
        return "it is JSON, as a calibration file is; give the .toml file of the run"
    if "=" not in line and not line.startswith("[") and re.search("[,;\t]", line):
        advice = "; draft its run file with `inercal init`" * (what == "run file")
        return f"it looks like a table of data{advice}"
    return ""


def _decoded(raw: bytes, what: str) -> str:
    """Decode bytes to text, and remove the byte order mark that Windows writes.

    Raises
    ------
    InputError
        The encoding is not UTF-8; the message states the line.
    """
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise InputError(f"not a TOML {what}: UTF-16 text; save it as UTF-8")
    if b"\0" in raw:
        raise InputError(f"not a TOML {what}: it is a binary file; name a text file")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"not a TOML {what}: line {line}: byte {raw[error.start]:#04x} is not UTF-8 text; save "
            "the file as UTF-8",
            line=line,
        ) from None


def _members(outer: dict[str, Any] | list[Any]) -> Iterable[Any]:
    return outer.values() if isinstance(outer, dict) else outer


def _too_deep(what: str) -> str:
    return f"not a TOML {what}: nested deeper than {DEEPEST} levels"


def texts_of(content: object) -> Iterator[str]:
    """Yield all keys and strings in a TOML document."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping):
        for key, value in cast(Mapping[str, object], content).items():
            yield key
            yield from texts_of(value)
    elif isinstance(content, list):
        for value in cast(list[object], content):
            yield from texts_of(value)


def read_toml(path: Path, what: str = "file") -> dict[str, Any]:
    """Read and parse a small TOML file.

    Parameters
    ----------
    path : path
    what : str
        The expected kind of file, used in messages, such as "run file".

    Raises
    ------
    InputError
        See `read_small_file` and `parse_toml`; the message includes the file name.
    """
    raw = read_small_file(path, what)
    with error_location(path):
        return parse_toml(raw, what)


def csv_lines(
    path: Path, needed: Sequence[str], what: str = "table", largest: int = LARGEST
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the location and the cells, by column, of each nonempty line of a CSV table.

    Parameters
    ----------
    path : path
    needed : sequence of str
        Columns that the table must have.
    what, largest
        See `read_small_file`.

    Raises
    ------
    InputError
        See `read_small_file` and `check_columns`. The error is also raised if the text is not UTF-8
        or a line has the wrong number of cells.
    """
    try:
        text = read_small_file(path, what, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8; save the table as UTF-8", file=path
        ) from None
    reader = csv.reader(text.splitlines(), strict=True)
    empty: list[str] = []
    try:
        names = [name.strip() for name in next(reader, empty)]
        check_columns(path, names, needed)
        for cells in reader:
            if not any(cells):
                continue
            where = f"line {reader.line_num}"
            if len(cells) != len(names):
                raise InputError(
                    f"{where} has {len(cells)} cells; the table has {len(names)} columns"
                ).located(path)
            yield where, dict(zip(names, cells, strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}", file=path) from None


def check_columns(path: Path, names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise an error if a column is missing in a table or two columns have the same name.

    Raises
    ------
    InputError
        The message lists the existing columns.
    """
    for one in needed:
        if one not in names:
            raise InputError(
                f"no column {one!r}; {'its columns are ' * any(names)}"
                f"{', '.join(names) or 'the file is empty'}"
                f"{'; save it with commas between' * (len(names) == 1 and ';' in names[0])}",
                names=(one,),
            ).located(path)
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise InputError(f"{path}: column {twice[0]!r} appears twice", file=path, names=(twice[0],))
