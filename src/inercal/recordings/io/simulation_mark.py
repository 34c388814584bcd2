"""Mark the files of simulated recordings; the calibration receives a copy of the mark.

In a CSV file it is a comment in the first line, and in a NumPy archive the comment of the ZIP file.
In a Parquet file it is the key "simulation" in the schema's metadata, and in an HDF5 file the
attribute "simulation" of the root. In a ROS 2 bag it is the text of the topic /inercal/simulation,
which `inercal.recordings.io.rosbag` reads. Programs that read the data as columns are not affected,
except that comments must be skipped in CSV files.
"""

import codecs
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

from inercal.recordings.io.isolation import Isolation, read_isolated

SIMULATION_KEY = "simulation"
"""The key in the metadata of Parquet and HDF5 files."""
SIMULATION_TOPIC = "/inercal/simulation"
"""The topic of a ROS 2 bag, of type std_msgs/String."""
SIMULATION_OF = "simulation of "
"""The beginning of each mark, such as "simulation of run.toml, seed 0"."""
_COMMENT = f"# {SIMULATION_OF}".encode()
_LONGEST = 4096  # bytes of the first line that are examined
_ISOLATION = Isolation("a recording")
_ZIP, _PARQUET, _HDF5 = b"PK\x03\x04", b"PAR1", b"\x89HDF\r\n\x1a\n"


def read_simulation_mark(path: Path) -> str:
    """Return the simulation that a recording's file states as its source; empty if none.

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
    """Read the mark in this process, although a damaged file can crash the libraries."""
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
