"""Back up a register to one SQLite file with the same tables, and restore it.

A backup is a consistent snapshot of the register. Numbers, times and names do not change, so a
register can be moved from a server into a file and back.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, func, insert, select, text

from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError
from inercal.calibration.files import parse
from inercal.laboratory.store import connection
from inercal.laboratory.store.connection import RegisterAddress, resolve_address
from inercal.laboratory.store.register_tables import calibration, certificate, metadata

_ROWS = 200  # number of rows copied at once
_SQLITE_HEAD = b"SQLite format 3\x00"


def backup_register(address: str | None, path: Path) -> dict[str, int]:
    """Write the register to a file atomically, and return the number of rows by table.

    Parameters
    ----------
    address : str or None
        Address of the register; see `Register`.
    path : Path

    Raises
    ------
    InputError
        If the register does not exist, or its content is damaged.
    """
    source = resolve_address(address)
    _require_register(source)
    with atomic_write(path) as temporary:
        return _copy(source, resolve_address(str(temporary)))


def restore_register(path: Path, address: str | None) -> dict[str, int]:
    """Restore a backup into a new or empty register, and return the number of rows by table.

    Raises
    ------
    InputError
        If the file is not a backup or is damaged, or the register is not empty.
    """
    if not _is_sqlite(path):
        raise InputError(
            f"{path} is not a backup of a register; give a file that `inercal store backup` wrote",
            file=path,
        )
    target = resolve_address(address)
    with tempfile.TemporaryDirectory() as folder:
        # A copy is used, because the tables of an older backup are upgraded first.
        copy = Path(shutil.copy(path, Path(folder) / "backup.db"))
        if target.file is None or target.file.exists():
            return _copy(resolve_address(str(copy)), target)
        with atomic_write(target.file) as temporary:
            return _copy(resolve_address(str(copy)), resolve_address(str(temporary)))


def _is_sqlite(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_SQLITE_HEAD)) == _SQLITE_HEAD


def _require_register(address: RegisterAddress) -> None:
    if address.file is not None and not address.file.is_file():
        raise InputError(
            "there is no such register; give another one with --register", key="--register"
        ).located(address.file)


def _copy(source: RegisterAddress, target: RegisterAddress) -> dict[str, int]:
    engines = connection.make_engine(source), connection.make_engine(target)
    try:
        connection.upgrade_register(engines[0], source, create=False)
        connection.upgrade_register(engines[1], target)
        with (
            connection.read_transaction(engines[0], source) as old,
            connection.write_transaction(engines[1], target) as new,
        ):
            if old.dialect.name == "postgresql":  # read all tables in the same state
                old.execute(text("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ"))
            _require_empty(new, target)
            return _copy_tables(old, new)
    finally:
        for engine in engines:
            engine.dispose()


def _require_empty(db: Connection, address: RegisterAddress) -> None:
    for table in metadata.sorted_tables:
        if db.scalar(select(func.count()).select_from(table)):
            raise address.error(" is not empty; restore into a new one")


def _copy_tables(old: Connection, new: Connection) -> dict[str, int]:
    counts: dict[str, int] = {}
    for table in metadata.sorted_tables:
        counts[table.name] = 0
        result = old.execute(select(table).order_by(*table.primary_key.columns))
        for rows in result.mappings().partitions(_ROWS):
            for row in rows:
                if table is calibration:
                    parse(row["content"], f"calibration #{row['id']}")
                elif table is certificate:
                    _require_hashes(dict(row))
            new.execute(insert(table), [dict(row) for row in rows])
            counts[table.name] += len(rows)
        if new.dialect.name == "postgresql" and "id" in table.c:
            _advance_sequence(new, table.name)
    return counts


def _require_hashes(row: Mapping[str, Any]) -> None:
    for name in ("pdf", "dcc"):
        content = row[name]  # it is text if the SQLite file was changed by hand
        raw = content.encode() if isinstance(content, str) else bytes(content)
        if hashlib.sha256(raw).hexdigest() != row[f"{name}_sha256"]:
            raise InputError(
                f"certificate {row['number']}: its {name.upper()} is damaged (the SHA-256 "
                "differs); restore the register from another copy",
                names=(row["number"],),
            )


def _advance_sequence(db: Connection, table: str) -> None:
    """Make the server number new rows after the restored rows, which it has not counted."""
    db.execute(
        text(
            f"SELECT setval(pg_get_serial_sequence('{table}', 'id'), "
            f"(SELECT COALESCE(MAX(id), 0) + 1 FROM {table}), false)"
        )
    )
