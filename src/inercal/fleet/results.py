"""Results of a fleet: a dataset of Parquet parts, each written once and named by what it holds.

A row stands for one sensor, calibrated or not, under its key: the hash of its recording, of its run
file as filled and of the version of inercal. Nothing else is the state of a fleet: a part that is
there is done, one that is not there is to do. Of several rows of one sensor the last counts.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError, require_extra
from inercal.io.atomic_files import atomic_write

Table = Any  # pyarrow.Table, which is untyped

FOLDER = "fleet"
DONE, FAILED, LOST = "done", "failed", "lost"
_PART = "part-"


def schema() -> Any:
    """Return the columns of a part.

    `status` is "done", "failed" or "lost"; `conformity` is the result of [specification], if any;
    `coefficients` are names with spaces between them, in the order of `value`, `std` (SI) and of
    the rows of `covariance`, the lower triangle row by row; `table` are the further columns of the
    table of sensors; `calibration` is the calibration file.
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
            ("seconds", real), ("created", text),
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


def write_part(folder: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows as one part, completely or not at all; the same rows have the same name.

    Raises
    ------
    InputError
        The part cannot be written: a full disk, no permission.
    """
    pa, pq = _arrow(), _arrow("pyarrow.parquet")
    keys = sha256(" ".join(sorted(row["key"] for row in rows)).encode()).hexdigest()[:24]
    path = folder / f"{_PART}{keys}.parquet"
    table = pa.Table.from_pylist(list(rows), schema=schema())
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")
    return path


def read_results(folder: Path, columns: Iterable[str] | None = None) -> Table:
    """Return the last row of each sensor, sorted by id.

    Parameters
    ----------
    folder : Path
        Of the parts; it need not exist.
    columns : iterable of str, optional
        Only these, and those that are needed here.

    Raises
    ------
    InputError
        A part that is damaged.
    """
    pa, pc = _arrow(), _arrow("pyarrow.compute")
    wanted = None if columns is None else list(dict.fromkeys(("id", "created", *columns)))
    tables = [_read_part(path, wanted) for path in _parts(folder)]
    if not tables:
        fields = [one for one in schema() if wanted is None or one.name in wanted]
        return pa.schema(fields).empty_table()
    whole = pa.concat_tables(tables, promote_options="default")
    for field in schema():
        if field.name not in whole.column_names and (wanted is None or field.name in wanted):
            whole = whole.append_column(field, pa.nulls(len(whole), field.type))
    order = pc.sort_indices(whole, sort_keys=[("id", "ascending"), ("created", "ascending")])
    whole = whole.take(order)
    names = whole["id"].combine_chunks()
    if len(names) > 1:
        last = np.append(pc.not_equal(names[1:], names[:-1]).to_numpy(zero_copy_only=False), True)
        whole = whole.filter(pa.array(last))
    return whole


def last_rows_by_part(folder: Path, columns: Iterable[str]) -> Iterator[list[dict[str, Any]]]:
    """Yield, part by part, the rows that are the last of their sensor: in the memory of a part.

    Parameters
    ----------
    folder : Path
        Of the parts.
    columns : iterable of str
        Of the rows, in addition to `id` and `created`.

    Raises
    ------
    InputError
        A part that is damaged.
    """
    table = read_results(folder, ())
    last = dict(zip(table["id"].to_pylist(), table["created"].to_pylist(), strict=True))
    for path in _parts(folder):
        rows = _read_part(path, ["id", "created", *columns]).to_pylist()
        yield [row for row in rows if last[row["id"]] == row["created"]]


def calibration_text(folder: Path, name: str) -> str:
    """Return the calibration file of a sensor.

    Raises
    ------
    InputError
        No such sensor, or one without a calibration.
    """
    found: dict[str, Any] | None = None
    for path in _parts(folder):
        ids = _read_part(path, ["id", "created"]).to_pylist()
        times = [row["created"] for row in ids if row["id"] == name]
        if times and (found is None or times[-1] > found["created"]):
            rows = _read_part(path, ["id", "created", "status", "error", "calibration"])
            found = next(row for row in reversed(rows.to_pylist()) if row["id"] == name)
    if found is None:
        raise InputError(f"{folder}: no sensor {name!r}", file=folder, names=(name,))
    if found["status"] != DONE:
        raise InputError(
            f"{folder}: sensor {name!r} was not calibrated: {found['error']}", file=folder
        )
    content = json.loads(found["calibration"])
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{_PART}*.parquet"))


def _read_part(path: Path, columns: Sequence[str] | None) -> Table:
    """Return columns of a part; parts of an earlier version may lack some of them."""
    pa, pq = _arrow(), _arrow("pyarrow.parquet")
    try:
        known = set(pq.read_schema(path).names)
        there = columns and [name for name in columns if name in known]
        return pq.read_table(path, columns=there)
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            f"{path}: damaged ({str(error).splitlines()[0]}); remove it and calibrate again",
            file=path,
        ) from None
