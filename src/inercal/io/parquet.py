"""Parquet files, through pyarrow."""

from collections.abc import Collection
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from inercal.errors import InputError
from inercal.io.table import Column, Table, as_labels, sha256_of, shortened, wanted_columns


def read_parquet(
    path: Path, wanted: Collection[str] | None = None, text: Collection[str] = ()
) -> Table:
    """Read a table from a Parquet file; missing numbers become NaN.

    Parameters
    ----------
    path : Path
        A Parquet file of numbers and text.
    wanted, text
        See `inercal.io.text.read_text`.

    Raises
    ------
    InputError
        pyarrow is not installed, the file is damaged, or a column is neither numbers nor text.
    """
    pyarrow = _pyarrow()
    try:
        with pyarrow.parquet.ParquetFile(path, page_checksum_verification=True) as file:
            names = tuple(str(name) for name in file.schema_arrow.names)
            chosen = wanted_columns(names, wanted, path.name)
            table = file.read(columns=chosen)
        columns = {k: _column(table.column(k), k, k in text, path.name) for k in chosen}
    except (pyarrow.ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        raise InputError(f"{path.name} is damaged: {shortened(str(error), 120)}") from error
    if table.num_rows == 0:
        raise InputError(f"{path.name} has no rows")
    return Table(names, columns, path.name, sha256_of(path), 0, header=True)


def write_parquet(path: Path, columns: dict[str, Column]) -> None:
    """Write columns (n,) of numbers and text to a Parquet file.

    Raises
    ------
    InputError
        pyarrow is not installed.
    """
    pyarrow = _pyarrow()
    # Text goes over as a list: pyarrow does not take NumPy's fixed-width strings.
    arrays = {k: c.tolist() if c.dtype.kind == "U" else c for k, c in columns.items()}
    pyarrow.parquet.write_table(pyarrow.table(arrays), path, write_page_checksum=True)


def _pyarrow() -> Any:
    """Return the package: imported only where a Parquet file is met, since it is an extra."""
    try:
        import_module("pyarrow.parquet")
        return import_module("pyarrow")
    except ImportError as error:
        raise InputError("Parquet files need pyarrow: pip install 'inercal[io]'") from error


def _column(values: Any, name: str, as_text: bool, source: str) -> Column:
    """Return one pyarrow column as an array (n,)."""
    types = _pyarrow().types
    kind = values.type
    if types.is_dictionary(kind):  # how pandas writes categories
        values, kind = values.cast(kind.value_type), kind.value_type
    if types.is_string(kind) or types.is_large_string(kind):
        return as_labels([value or "" for value in values.to_pylist()], name, source)
    integer = types.is_integer(kind) or types.is_boolean(kind)
    if as_text and integer:
        return as_labels([str(value) for value in values.to_pylist()], name, source)
    if not (integer or types.is_floating(kind)):
        raise InputError(f"{source}: column {name!r} of {kind} is neither numbers nor text")
    return np.ascontiguousarray(values.to_numpy(), dtype=np.float64)
