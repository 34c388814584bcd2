"""Read and write Parquet files with pyarrow."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError, require_extra
from inercal.recordings.io import column_table
from inercal.recordings.io.column_table import Array, Column, ReadRequest, Table
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import Reader
from inercal.recordings.io.simulation_mark import SIMULATION_KEY

_BUFFER = 1 << 20  # bytes of each column read at a time


def read_parquet(path: Path, wanted: ReadRequest) -> Table:
    """Read a table from a Parquet file in blocks of rows; missing numbers become NaN.

    Parameters
    ----------
    path : Path
        A Parquet file with numbers and text.
    wanted : ReadRequest

    Raises
    ------
    InputError
        pyarrow is not installed, the file is damaged, or a column contains neither numbers nor
        text.
    """
    pyarrow = _pyarrow()
    schema = pyarrow.parquet.read_schema(path)
    names = tuple(str(name) for name in schema.names)
    chosen = column_table.select_columns(names, wanted.names, path.name)
    texts = [k for k in chosen if _is_text(pyarrow, schema.field(k).type, k, False, path.name)]
    with pyarrow.parquet.ParquetFile(
        path,
        page_checksum_verification=True,
        pre_buffer=False,
        buffer_size=_BUFFER,
        read_dictionary=texts,  # a long text that many rows have is decoded once
    ) as file:
        columns, block = _columns(pyarrow, file, chosen, wanted, path.name)
    return Table(names, columns, path.name, column_table.file_sha256(path), block=block)


def _columns(
    pyarrow: Any, file: Any, chosen: list[str], wanted: ReadRequest, source: str
) -> tuple[dict[str, Column], Array]:
    """Return the chosen columns by name, and their block."""
    n = int(file.metadata.num_rows)
    if n == 0:
        raise InputError(f"{source} has no rows: record or export it again")
    words: dict[str, list[NDArray[np.str_]]] = {
        name: []
        for name in chosen
        if _is_text(pyarrow, file.schema_arrow.field(name).type, name, name in wanted.text, source)
    }
    numbers, block = wanted.empty_columns(n, [name for name in chosen if name not in words])
    stamps: dict[str, list[NDArray[Any]]] = {
        name: [] for name in chosen if name in wanted.whole and name not in words
    }
    start = 0
    for batch in file.iter_batches(
        batch_size=column_table.BLOCK_ROWS, columns=chosen, use_threads=False
    ):
        stop = start + batch.num_rows
        for name in chosen:
            values = batch.column(name)
            if name in words:
                words[name].append(_labels(values, name, source))
            elif name in stamps:
                stamps[name].append(_numbers(pyarrow, values))
            else:
                numbers[name][start:stop] = _numbers(pyarrow, values)
        start = stop
    if start != n:
        raise InputError(
            f"{source} is damaged: it has {start} rows, but its header states {n}; write the file "
            "again"
        )
    columns: dict[str, Column] = {**numbers}
    columns |= {name: np.concatenate(parts) for name, parts in words.items()}
    for name, parts in stamps.items():
        columns[name] = wanted.number_column(name, np.concatenate(parts))
    return {name: columns[name] for name in chosen}, block


def write_parquet(path: Path, columns: dict[str, Column], mark: str) -> None:
    """Write columns (n,) with numbers and text, and the mark of a simulation, to a Parquet file.

    Raises
    ------
    InputError
        pyarrow is not installed.
    """
    pyarrow = _pyarrow()
    # Convert text to a list, because pyarrow does not accept NumPy's fixed-width strings.
    arrays = {k: c.tolist() if c.dtype.kind == "U" else c for k, c in columns.items()}
    table = pyarrow.table(arrays, metadata={SIMULATION_KEY: mark} if mark else None)
    pyarrow.parquet.write_table(table, path, write_page_checksum=True)


def _pyarrow() -> Any:
    """Import pyarrow only when a Parquet file is used, because it is an optional extra."""
    with require_extra("io", "Parquet files need pyarrow", ("pyarrow",)):
        import_module("pyarrow.parquet")
        return import_module("pyarrow")


def _is_text(pyarrow: Any, kind: Any, name: str, as_text: bool, source: str) -> bool:
    """Return whether a column of this type is read as text."""
    types = pyarrow.types
    if types.is_dictionary(kind):  # how pandas writes categories
        kind = kind.value_type
    if types.is_string(kind) or types.is_large_string(kind):
        return True
    integer = types.is_integer(kind) or types.is_boolean(kind)
    if not (integer or types.is_floating(kind)):
        text = f"has the type {kind}; save real numbers or text"
        raise column_table.column_error(source, name, text)
    return as_text and integer


def _labels(values: Any, name: str, source: str) -> NDArray[np.str_]:
    """Return a pyarrow column of text or whole numbers as labels; "" for missing entries."""
    # A label column repeats few texts, so convert each text once.
    encoded = values if hasattr(values, "dictionary") else values.dictionary_encode()
    texts = ["", *("" if one is None else str(one) for one in encoded.dictionary.to_pylist())]
    places = encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype(np.intp)
    return column_table.label_array(texts, name, source)[places + 1]


def _numbers(pyarrow: Any, values: Any) -> NDArray[Any]:
    """Return a pyarrow column of numbers as an array (n,); float64 if some are missing."""
    if pyarrow.types.is_dictionary(values.type):
        values = values.cast(values.type.value_type)
    return np.asarray(values.to_numpy(zero_copy_only=False))


READER = Reader(
    "parquet",
    read_parquet,
    content=((0, b"PAR1"),),
    suffixes=(".parquet", ".pq"),
    isolation=Isolation("a Parquet file", libraries=("pyarrow.parquet",), extra="io"),
)
