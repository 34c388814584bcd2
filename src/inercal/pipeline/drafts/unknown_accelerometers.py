"""The refusal of a recording whose accelerometers neither names nor values tell."""

from json import dumps
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_roles import ColumnRoles
from inercal.recordings.io.column_table import Table, shorten

_MOST_LISTED = 12


class UnknownAccelerometers(InputError):
    """No columns of accelerometers are recognised; the user may state them.

    `columns` are the columns of numbers, in the file's order.
    """

    columns: tuple[str, ...] = ()


def unknown_accelerometers(log: Path, table: Table, roles: ColumnRoles) -> UnknownAccelerometers:
    """Return the refusal of a recording, with its columns and how to state those of a triad."""
    numbers = tuple(n for n in table.names if table.columns[n].dtype.kind != "U")
    used = {*roles.single.values(), *(c for triad in roles.triads.values() for c in triad)}
    free = [name for name in numbers if name not in used]
    example = free if len(free) >= 3 else list(numbers)
    given = [int(n) if n.isdecimal() else n for n in example[:3]]
    only = " the gyros alone were recognised;" if "gyro" in roles.triads else ""
    listed = ", ".join(map(shorten, table.names[:_MOST_LISTED]))
    error = UnknownAccelerometers(
        f"{log}: neither names nor values tell which columns are the accelerometers;{only} "
        f"the columns are {listed}{', …' * (len(table.names) > _MOST_LISTED)}. State those of "
        f"x, y and z, as in --set data.accelerometer='{dumps(given, ensure_ascii=False)}'",
        file=log,
        names=table.names[:_MOST_LISTED],
    )
    error.columns = numbers
    return error
