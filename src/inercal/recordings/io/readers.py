"""Register the file-format readers of all packages, and choose the reader for a file.

A reader declares which files it reads, by bytes near the beginning of the file and by suffix. A
file is read by the first reader whose bytes it contains. Otherwise it is read by the first reader
with its suffix, or else by the text reader. A reader also declares its keys of [data], such as a
topic. A package registers a reader with::

    [project.entry-points."inercal.readers"]
    flight_log = "their_package.log:READER"

inercal calls it with the file, the `ReadRequest`, and each of its options by name.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import get_args

from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.recordings.io.column_table import Table, shorten
from inercal.recordings.io.isolation import MOST_VALUES, MOST_VALUES_KEY, Isolation

HEAD_BYTES = 128
"""Number of bytes at the beginning of a file in which readers look for their format."""
_UNPACK = "unpack it first"
_BEGINNINGS = {
    b"version https://git-lfs.github.com/spec/": (
        "is a pointer of Git LFS and not the data: run git lfs pull"
    ),
    b"\x1f\x8b": f"is compressed with gzip: {_UNPACK}",
    b"BZh": f"is compressed with bzip2: {_UNPACK}",
    b"\xfd7zXZ\0": f"is compressed with xz: {_UNPACK}",
    b"\x28\xb5\x2f\xfd": f"is compressed with Zstandard: {_UNPACK}",
    b"7z\xbc\xaf\x27\x1c": f"is a 7z archive: {_UNPACK}",
    b"Rar!": f"is a RAR archive: {_UNPACK}",
    b"{\n": "is JSON and not a recording: give the log, or the run file, which ends in .toml",
    b"%PDF-": "is a PDF document: export the data as CSV; "
    "inercal certificate verify reads a certificate",
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": "is an old Excel workbook (.xls): save it as .xlsx or CSV",
}
_ZIP, _NAME_SIZE, _NAME = b"PK\x03\x04", slice(26, 28), 30  # places in the first file's header
_READ_AS_ZIP = (".npy", ".xml", ".rels", "mimetype")  # in archives and sheets of readers
_HTML = (b"<!doctype html", b"<html", b"<head", b"<body", b"<?xml", b"<!--", b"<script", b"<title")
_WORDS = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}


@dataclass(frozen=True)
class Option:
    """A key of [data] that belongs to one reader.

    Parameters
    ----------
    name : str
        Name of the key, which must differ from the keys of [data] that all readers share.
    type : type or union of types
        Type of the value: str, int, float, bool.
    default : object
        Value that is used if the key is not stated.
    meaning : str
        Description for the user, in one line.
    """

    name: str
    type: type | UnionType
    default: object
    meaning: str

    def accepts(self, value: object) -> bool:
        """Return whether a value has the right type; whole numbers are accepted as float."""
        kinds = _member_types(self.type)
        if isinstance(value, bool):
            return bool in kinds
        return isinstance(value, kinds) or (float in kinds and isinstance(value, int))

    @property
    def accepted_types(self) -> str:
        """The accepted types, in words."""
        return " or ".join(_WORDS[kind] for kind in _member_types(self.type))


MOST_VALUES_OPTION = Option(
    MOST_VALUES_KEY.split()[-1],
    int,
    MOST_VALUES,
    "largest number of 8-byte values that the file may have in the columns that are read",
)


def _member_types(kind: type | UnionType) -> tuple[type, ...]:
    return get_args(kind) if isinstance(kind, UnionType) else (kind,)


@dataclass(frozen=True)
class Reader:
    """Describe how files of one format are recognised and read.

    Parameters
    ----------
    name : str
    read : callable
        Function that takes (path, wanted, **options) and returns a `Table`. It imports the
        libraries that it needs.
    content : tuple of (int, bytes)
        Positions within the first 128 bytes, and the bytes there; any of them identifies the
        format.
    suffixes : tuple of str
        File-name suffixes such as ".npz", in lower case.
    binary : bool
        Whether the suffix counts only if there is a zero byte among the first 128 bytes.
    options : tuple of Option
    isolation : Isolation or None
        How the reader runs in a separate process, which it should if damaged bytes can crash a
        library. `MOST_VALUES_OPTION` is then an additional option, which is not passed to `read`.
        None if it reads in this process.
    """

    name: str
    read: Callable[..., Table]
    content: tuple[tuple[int, bytes], ...] = ()
    suffixes: tuple[str, ...] = ()
    binary: bool = False
    options: tuple[Option, ...] = ()
    isolation: Isolation | None = None

    def has_content(self, head: bytes) -> bool:
        """Return whether the first bytes of a file show that it has this format."""
        return any(head[at:].startswith(start) for at, start in self.content)

    def has_suffix(self, path: Path, head: bytes) -> bool:
        """Return whether a file has this format according to its suffix."""
        return path.suffix.lower() in self.suffixes and (b"\0" in head or not self.binary)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the reader's options; the option for its isolation comes last."""
        names = tuple(option.name for option in self.options)
        return names if self.isolation is None else (*names, MOST_VALUES_OPTION.name)

    def option_values(self, given: Mapping[str, object]) -> dict[str, object]:
        """Return the values of this reader's options, with defaults for options not given.

        Raises
        ------
        InputError
            A value has the wrong type.
        """
        for option in (*self.options, MOST_VALUES_OPTION):
            if option.name in given and not option.accepts(value := given[option.name]):
                raise InputError(
                    f"[data] {option.name} is {value!r}; reader {self.name} takes "
                    f"{option.accepted_types}: {option.meaning}",
                    key=f"[data] {option.name}",
                )
        return {option.name: given.get(option.name, option.default) for option in self.options}


_OWN = ("ulog", "dataflash", "rosbag", "xlsx", "hdf5", "mat", "npz", "parquet", "text")
READERS: Registry[Reader] = Registry(
    "inercal.readers", "reader", {name: f"inercal.recordings.io.{name}:READER" for name in _OWN}
)


def select_reader(path: Path, head: bytes) -> Reader:
    """Return the reader for a file that begins with `head`, its first 128 bytes."""
    for reader in READERS.values():
        if reader.has_content(head):
            return reader
    for reader in READERS.values():
        if reader.has_suffix(path, head):
            return reader
    return READERS["text"]


def refuse_wrong_content(path: Path, head: bytes) -> None:
    """Refuse a file that is not what its name says, and name what it is.

    Parameters
    ----------
    path : Path
    head : bytes
        The first bytes of the file.

    Raises
    ------
    InputError
        The file is empty, a pointer of Git LFS, compressed, JSON, a document, or a web page.
    """
    what = next((text for start, text in _BEGINNINGS.items() if head.startswith(start)), "")
    if not head:
        what = "is empty: record or export it again"
    elif head.startswith(_ZIP) and (packed := _first_packed_name(head)):
        what = f"is a ZIP archive with {shorten(packed)}: {_UNPACK}"
    elif b"digitalCalibrationCertificate" in head:
        what = "is a calibration certificate: check it with inercal certificate verify"
    elif head.removeprefix(b"\xef\xbb\xbf").lstrip().lower().startswith(_HTML):
        what = "is an HTML page and not the data: download the file itself, or save the data as CSV"
    if what:
        raise InputError(f"{path.name} {what}", file=path)


def _first_packed_name(head: bytes) -> str:
    """Return the first file in a ZIP archive; empty for archives that a reader understands."""
    size = int.from_bytes(head[_NAME_SIZE], "little")
    name = head[_NAME : _NAME + size].decode("ascii", "replace")
    known = len(name) < size or name.endswith(_READ_AS_ZIP) or not name.isprintable()
    return "" if known else name


def readers_with_option(key: str) -> list[str]:
    """Return the names of the readers that know an option."""
    return [one.name for one in READERS.values() if key in one.keys]


def known_options() -> Iterator[str]:
    """Yield the names of all readers' options."""
    yield from dict.fromkeys(key for one in READERS.values() for key in one.keys)


def refuse_unknown_options(
    options: Mapping[str, object], source: str, readers: Collection[Reader]
) -> None:
    """Refuse options that none of the readers knows.

    Raises
    ------
    InputError
        An option is unknown; the message names the readers that know the first such option.
    """
    known = {key for one in readers for key in one.keys}
    for key in options:
        if key not in known:
            here = " and ".join(dict.fromkeys(one.name for one in readers))
            others = " and ".join(readers_with_option(key))
            of = f"an option of reader {others}" if others else "not an option of any reader"
            raise InputError(
                f"[data] {key} is {of}, and {source} is read by {here}: remove {key}",
                key=f"[data] {key}",
            )
