"""Results of a fleet: a dataset of Parquet parts, each written once and named by what it holds.

A row stands for one sensor, calibrated or not, under its key: the hash of its recording, of its run
file as filled and of the version of inercal. Nothing else is the state of a fleet: a part that is
there is done, one that is not there is to do. Of several rows of one sensor the last counts.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError, require_extra

Table = Any  # pyarrow.Table, which is untyped

FOLDER = "fleet"
DONE, FAILED, LOST = "done", "failed", "lost"
_PART = "part-"


def schema() -> Any:
    """Return the columns of a part.

    `status` is "done", "failed" or "lost"; `conformity` is the result of [specification], if any;
    `coefficients` are names with spaces between them, in
    the order of `value`, `std` (SI) and of the rows of `covariance`, the lower triangle row by row;
    `table` are the further columns of the table of sensors; `calibration` is the calibration file.
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
    temporary = folder / f".{_PART}{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        table = pa.Table.from_pylist(list(rows), schema=schema())
        pq.write_table(table, temporary, compression="zstd")
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise InputError(
            f"{path} cannot be written: {error.strerror or error}; what is there is kept, run the "
            "same command to go on",
            file=path,
        ) from None
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
    pa, pc, pq = _arrow(), _arrow("pyarrow.compute"), _arrow("pyarrow.parquet")
    wanted = None if columns is None else list(dict.fromkeys(("id", "created", *columns)))
    tables: list[Table] = []
    for path in sorted(folder.glob(f"{_PART}*.parquet")):
        try:
            # Parts of an earlier version may lack a column.
            known = set(pq.read_schema(path).names)
            there = wanted and [name for name in wanted if name in known]
            tables.append(pq.read_table(path, columns=there))
        except (pa.ArrowInvalid, OSError) as error:
            raise InputError(
                f"{path}: damaged ({str(error).splitlines()[0]}); remove it and calibrate again",
                file=path,
            ) from None
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


def calibration_text(folder: Path, name: str) -> str:
    """Return the calibration file of a sensor.

    Raises
    ------
    InputError
        No such sensor, or one without a calibration.
    """
    pc = _arrow("pyarrow.compute")
    rows = read_results(folder, ("status", "error", "calibration"))
    found = rows.filter(pc.equal(rows["id"], name)).to_pylist()
    if not found:
        raise InputError(f"{folder}: no sensor {name!r}", file=folder, names=(name,))
    if found[0]["status"] != DONE:
        raise InputError(
            f"{folder}: sensor {name!r} was not calibrated: {found[0]['error']}", file=folder
        )
    content = json.loads(found[0]["calibration"])
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
