"""Store the results of a fleet in Parquet files (parts), each written once.

Each row is the result for one sensor, which may be a failure. The key of a row is a hash of the
recording, the completed run file and the version of inercal. A fleet has no other state: sensors in
an existing part are done, and all others remain to be calibrated.

Each row states its generation: each run, and each recording at a station, takes the next number N,
for which a file `_generation-N` is created in the folder. If a sensor has several rows,
`inercal.fleet.latest` decides which row is valid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from inercal.basics.arrays import Array
from inercal.basics.atomic_files import atomic_write, make_folder
from inercal.basics.errors import InputError, require_extra

Table = Any  # pyarrow.Table, which is untyped

FOLDER = "fleet"
DONE, FAILED, LOST = "done", "failed", "lost"
_PART = "part-"
_NUMBER = "_generation-"  # dataset readers ignore such names


def schema() -> Any:
    """Return the schema of a part.

    `status` is "done", "failed" or "lost"; `conformity` is the result of [specification], if
    there are limits and the calibration can be relied on, and `beyond` contains the names of the
    coefficients that are beyond their limits, separated by spaces;
    `coefficients` contains names separated by spaces, in the order of `value`, `std` (SI) and of
    the rows of `covariance`, which is the lower triangle row by row; `table` contains the other
    columns of the table of sensors; `calibration` is the calibration file; `arrived` means that the
    recording arrived at a station and may be elsewhere than stated in the table; `readings`
    contains hashes of some readings in each section, which copies of a recording share.
    """
    pa = arrow()
    text, real = pa.string(), pa.float64()
    return pa.schema(
        [
            ("key", text), ("id", text), ("recording", text), ("lot", text), ("station", text),
            ("measured", text), ("table", pa.map_(text, text)), ("status", text), ("error", text),
            ("error_type", text), ("traceback", text), ("method", text), ("estimator", text),
            ("grade", text), ("verdict", text), ("conformity", text), ("beyond", text),
            ("chi2", real), ("dof", real), ("birge", real),
            ("coefficients", text), ("value", pa.list_(real)), ("std", pa.list_(real)),
            ("covariance", pa.list_(real)), ("calibration", text), ("recording_sha256", text),
            ("sections_sha256", text), ("inercal", text), ("size", pa.int64()), ("mark", text),
            ("seconds", real), ("created", text), ("generation", pa.int64()),
            ("arrived", pa.bool_()), ("readings", pa.list_(text)),
        ]
    )  # fmt: skip


def arrow(module: str = "pyarrow") -> Any:
    """Return pyarrow or one of its modules; a `MissingExtra` error names the extra."""
    with require_extra("fleet", "results of a fleet need pyarrow", ("pyarrow",)):
        return import_module(module)


def row_key(recording_sha256: str, sections_sha256: str, version: str) -> str:
    """Return the key of a row."""
    return sha256(f"{recording_sha256} {sections_sha256} {version}".encode()).hexdigest()


def lower_triangle(matrix: Array) -> list[float]:
    """Return the lower triangle of a matrix (p, p), row by row."""
    return [x for k, row in enumerate(matrix.tolist(), 1) for x in row[:k]]


def matrix(column: Any, p: int) -> Array:
    """Return a column of lists of p numbers, without nulls, as an array (n, p)."""
    flat: Array = column.combine_chunks().flatten().to_numpy()
    return flat.reshape(-1, p)


@dataclass(frozen=True)
class ResultWriter:
    """Writer for the results of one run; all these results have the same generation.

    Parameters
    ----------
    folder : Path
        Folder with the parts.
    generation : int
        A number that is larger than the generation of every earlier result.
    """

    folder: Path
    generation: int

    def write(self, rows: Sequence[Mapping[str, Any]]) -> Path:
        """Write rows as one part, completely or not at all.

        The file name depends only on the rows.

        Raises
        ------
        InputError
            The part cannot be written, for example because the disk is full.
        """
        pa, pq = arrow(), arrow("pyarrow.parquet")
        keys = sha256(" ".join(sorted(row["key"] for row in rows)).encode()).hexdigest()[:24]
        path = self.folder / f"{_PART}{keys}.parquet"
        numbered = [{**row, "generation": self.generation} for row in rows]
        table = pa.Table.from_pylist(numbered, schema=schema())
        with atomic_write(path) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return path


def open_writer(folder: Path, above: int = 0) -> ResultWriter:
    """Return a writer for the next generation in a folder, reserved for this process.

    Parameters
    ----------
    folder : Path
        Folder with the parts of the results; it is created if it does not exist.
    above : int
        The latest generation that the caller knows.

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
            # Another process may have used this number and later numbers, and removed the file.
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
    """Return the paths of the parts in a folder; the folder need not exist."""
    return sorted(folder.glob(f"{_PART}*.parquet"))


def read_part(path: Path, columns: Sequence[str] | None) -> Table:
    """Read all columns of a part, or only the named columns.

    Columns that are missing in a part from an earlier version are null.

    Raises
    ------
    InputError
        The part is damaged.
    """
    pa, pq = arrow(), arrow("pyarrow.parquet")
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
