"""Give the columns of a table their signs, if signed counts were written as unsigned numbers."""

from dataclasses import replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.draft_entries import DraftKey
from inercal.recordings.io.column_table import Column, Table
from inercal.recordings.io.unsigned_counts import are_counts, signed_counts, unsigned_bits

_GROWS = 0.9  # share of the steps of a time or a counter that are positive


def sign_columns(table: Table, stated: object = None) -> tuple[Table, tuple[DraftKey, ...]]:
    """Return the table with signed readings, and the key of [data] that reads them so.

    Columns that grow, such as times and counters, stay as they are.

    Parameters
    ----------
    table : Table
    stated : object
        The bits that the user states; None to find them from the values.

    Raises
    ------
    InputError
        The stated value is not a number of bits.
    """
    numbers = {
        name: column.astype(np.float64)
        for name, column in table.columns.items()
        if column.dtype.kind != "U"
    }
    numbers = {n: x for n, x in numbers.items() if np.sum(np.diff(x) > 0) < _GROWS * x.size}
    if stated is not None and (not isinstance(stated, int) or not 8 <= stated <= 32):
        raise InputError(f"data.signed_bits: {stated!r} is not 8 to 32", key="data.signed_bits")
    found = {name: unsigned_bits(values) for name, values in numbers.items()}
    bits = stated if stated is not None else next(filter(None, found.values()), None)
    if bits is None:
        return table, ()
    signed: dict[str, Column] = {
        name: signed_counts(values, bits)
        for name, values in numbers.items()
        if are_counts(values, bits)
    }
    seen = [name for name, one in found.items() if one == bits]
    reason = f"{', '.join(seen)} read only near 0 and near {2**bits - 1}" if seen else "as stated"
    signed_table = replace(table, columns={**table.columns, **signed}, block=None)
    return signed_table, (DraftKey("data", "signed_bits", bits, reason),)
