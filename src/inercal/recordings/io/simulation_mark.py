"""The mark of a simulated recording in its file, which a calibration of the file carries on.

CSV: a comment, the first line. NumPy archive: the comment of the ZIP file. Parquet: the key
"simulation" of the schema's metadata. HDF5: the attribute "simulation" of the root. Programs that
read the data as columns read them as before, except for CSV, where comments must be skipped.
"""

import codecs
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

from inercal.recordings.io.isolation import Isolation, read_isolated

SIMULATION_KEY = "simulation"
"""The key in the metadata of Parquet and HDF5."""
SIMULATION_OF = "simulation of "
"""Begins each mark, such as "simulation of run.toml, seed 0"."""
_COMMENT = f"# {SIMULATION_OF}".encode()
_LONGEST = 4096  # bytes of a first line that are looked at
_ISOLATION = Isolation("a recording")
_ZIP, _PARQUET, _HDF5 = b"PK\x03\x04", b"PAR1", b"\x89HDF\r\n\x1a\n"


def read_simulation_mark(path: Path) -> str:
    """Return by what a recording's file says to be simulated; empty where it does not say so.

    Parameters
    ----------
    path : Path
        A file that one of the readers has read.

    Raises
    ------
    InputError
        The file is damaged.
    OSError
        The file cannot be read.
    """
    binary = _head(path).startswith((_ZIP, _PARQUET, _HDF5))
    return read_isolated(_ISOLATION, path, stored_mark) if binary else stored_mark(path)


def stored_mark(path: Path) -> str:
    """Return the same, read by this process, which libraries can crash."""
    head = _head(path)
    if head.startswith(_COMMENT):
        line = head.splitlines()[0].decode(errors="replace")
        return line.removeprefix("# ").rstrip(" ,;\t")  # a spreadsheet fills the line with these
    found = ""
    if head.startswith(_ZIP):
        with zipfile.ZipFile(path) as archive:
            found = archive.comment.decode(errors="replace")
    elif head.startswith(_PARQUET):
        parquet: Any = import_module("pyarrow.parquet")
        metadata: dict[bytes, bytes] = parquet.read_schema(path).metadata or {}
        found = metadata.get(SIMULATION_KEY.encode(), b"").decode(errors="replace")
    elif head.startswith(_HDF5):
        h5py: Any = import_module("h5py")
        with h5py.File(path, "r") as opened:
            found = str(opened.attrs.get(SIMULATION_KEY, ""))
    return found if found.startswith(SIMULATION_OF) else ""


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_LONGEST).removeprefix(codecs.BOM_UTF8)
