"""Results of a fleet: a dataset of Parquet parts, each written once and named by its content.

A row stands for one sensor, calibrated or not. Its key is the hash of its recording, of its filled
run file and of the version of inercal. A fleet has no other state: a part that exists is done, and
one that does not exist is still to do.

Rows are numbered by generations: each run and each recording at a station takes the next number of
the folder, `_generation-N`. `inercal.fleet.latest` decides which of several rows of one sensor is
valid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.atomic_files import atomic_write, make_folder
from inercal.basics.errors import InputError, require_extra

Table = Any  # pyarrow.Table, which is untyped

FOLDER = "fleet"
DONE, FAILED, LOST = "done", "failed", "lost"
_PART = "part-"
_NUMBER = "_generation-"  # readers of datasets leave such names out


def schema() -> Any:
    """Return the columns of a part.

    `status` is "done", "failed" or "lost"; `conformity` is the result of [specification], if any;
    `coefficients` are names with spaces between them, in the order of `value`, `std` (SI) and of
    the rows of `covariance`, the lower triangle row by row; `table` contains the further columns of
    the table of sensors; `calibration` is the calibration file; `arrived` means that a station took
    the recording, which may not be where the table says.
    """
    pa = _arrow()
    text, real = pa.string(), pa.float64()
    return pa.schema(
        [
            ("key", text), ("id", text), ("recording", text), ("lot", text), ("station", text),
            ("measured", text), ("table", pa.map_(text, text)), ("status", text), ("error", text),
            ("error_type", text), ("traceback", text), ("method", text), ("estimator", text),
            ("grade", text), ("verdict", text), ("conformity", text), ("chi2", real),
            ("dof", real), ("birge", real),
            ("coefficients", text), ("value", pa.list_(real)), ("std", pa.list_(real)),
            ("covariance", pa.list_(real)), ("calibration", text), ("recording_sha256", text),
            ("sections_sha256", text), ("inercal", text), ("size", pa.int64()), ("mark", text),
            ("seconds", real), ("created", text), ("generation", pa.int64()),
            ("arrived", pa.bool_()),
        ]
    )  # fmt: skip


def _arrow(module: str = "pyarrow") -> Any:
    with require_extra("fleet", "results of a fleet need pyarrow", ("pyarrow",)):
        return import_module(module)


def row_key(recording_sha256: str, sections_sha256: str, version: str) -> str:
    """Return the key of a row."""
    return sha256(f"{recording_sha256} {sections_sha256} {version}".encode()).hexdigest()


def lower_triangle(matrix: Array) -> list[float]:
    """Return the lower triangle of a matrix (p, p), row by row."""
    return matrix[np.tril_indices(len(matrix))].tolist()


def from_lower_triangle(values: Sequence[float]) -> Array:
    """Return the symmetric matrix (p, p) of its lower triangle."""
    p = round((np.sqrt(8 * len(values) + 1) - 1) / 2)
    matrix = np.zeros((p, p))
    matrix[np.tril_indices(p)] = values
    return matrix + np.tril(matrix, -1).T


@dataclass(frozen=True)
class ResultWriter:
    """Writes the results of one run, which all have the same generation.

    Parameters
    ----------
    folder : Path
        Of the parts.
    generation : int
        A number larger than those of all results that existed when it was taken.
    """

    folder: Path
    generation: int

    def write(self, rows: Sequence[Mapping[str, Any]]) -> Path:
        """Write rows as one part, completely or not at all; the same rows have the same name.

        Raises
        ------
        InputError
            The part cannot be written, for example because the disk is full.
        """
        pa, pq = _arrow(), _arrow("pyarrow.parquet")
        keys = sha256(" ".join(sorted(row["key"] for row in rows)).encode()).hexdigest()[:24]
        path = self.folder / f"{_PART}{keys}.parquet"
        numbered = [{**row, "generation": self.generation} for row in rows]
        table = pa.Table.from_pylist(numbered, schema=schema())
        with atomic_write(path) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return path


def open_writer(folder: Path, above: int = 0) -> ResultWriter:
    """Return the writer of a folder's next generation, which no other process can get.

    Parameters
    ----------
    folder : Path
        Folder of the parts; it is created if it does not exist.
    above : int
        The latest generation of its results that the caller knows.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    make_folder(folder)
    number = 1 + max(above, *_taken_numbers(folder), 0)
    try:
        while True:
            (folder / f"{_NUMBER}{number}").touch(exist_ok=False)
            # Another process may have taken this number and later ones, and removed it.
            if (largest := max(_taken_numbers(folder))) == number:
                break
            (folder / f"{_NUMBER}{number}").unlink(missing_ok=True)
            number = 1 + largest
    except FileExistsError:
        return open_writer(folder, number)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror}", file=folder) from None
    for smaller in _taken_numbers(folder):
        if smaller < number:
            (folder / f"{_NUMBER}{smaller}").unlink(missing_ok=True)
    return ResultWriter(folder, number)


def _taken_numbers(folder: Path) -> list[int]:
    names = (path.name.removeprefix(_NUMBER) for path in folder.glob(f"{_NUMBER}*"))
    return [int(name) for name in names if name.isdecimal()]


def part_paths(folder: Path) -> list[Path]:
    """Return the paths of the parts in a folder, which need not exist."""
    return sorted(folder.glob(f"{_PART}*.parquet"))


def read_part(path: Path, columns: Sequence[str] | None) -> Table:
    """Return a part with all columns, or only those that are named.

    Columns that a part of an earlier version lacks are null.

    Raises
    ------
    InputError
        The part is damaged.
    """
    pa, pq = _arrow(), _arrow("pyarrow.parquet")
    fields = [one for one in schema() if columns is None or one.name in columns]
    try:
        known = set(pq.read_schema(path).names)
        table = pq.read_table(path, columns=[one.name for one in fields if one.name in known])
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            f"{path} is damaged ({str(error).splitlines()[0]}); remove it and calibrate again",
            file=path,
        ) from None
    for one in fields:
        if one.name not in known:
            table = table.append_column(one, pa.nulls(len(table), one.type))
    return table.select([one.name for one in fields])
