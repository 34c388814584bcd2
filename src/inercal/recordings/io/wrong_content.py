"""Refuse files that are not what their names say: compressed files, documents, web pages."""

from pathlib import Path

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import shorten

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
    b"%PDF-": "is a PDF document: export the data as CSV",
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": "is an old Excel workbook (.xls): save it as .xlsx or CSV",
}
_ZIP, _NAME_SIZE, _NAME = b"PK\x03\x04", slice(26, 28), 30  # places in the first file's header
_READ_AS_ZIP = (".npy", ".xml", ".rels", "mimetype")  # in archives and sheets of readers
_HTML = (b"<!doctype html", b"<html", b"<head", b"<body", b"<?xml", b"<!--", b"<script", b"<title")


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
