"""A register is brought to the tables of this version when it is opened."""

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, inspect

from inercal.errors import InputError
from inercal.store.address import RegisterAddress
from inercal.store.connection import read_transaction, write_transaction

VERSION_TABLE = "inercal_version"


def upgrade_register(engine: Engine, address: RegisterAddress, *, create: bool = True) -> None:
    """Create the tables of a register that is new, or migrate an older one, in one transaction.

    Raises
    ------
    InputError
        Its tables are of a newer version, or it is a database of something else; with `create`
        false also where the database is empty.
    """
    config = _config()
    script = ScriptDirectory.from_config(config)
    head = script.get_current_head()
    with read_transaction(engine, address) as connection:
        found = _revision(connection, address)
    if found == head:
        return
    if found is None and not create:
        raise InputError(
            f"register {address.display_url} is an empty database: enter a calibration first, by "
            "`inercal store import PATH…`",
            file=address.file,
        )
    with write_transaction(engine, address) as connection:
        # Another process may have been here first.
        found = _revision(connection, address)
        if found == head:
            return
        known = {revision.revision for revision in script.walk_revisions()}
        if found is not None and found not in known:
            raise InputError(
                f"register {address.display_url}: a newer version of inercal made its tables "
                f"(revision {found}; this version knows up to {head}): install that one"
            )
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _config() -> Config:
    config = Config()
    folder = str(Path(__file__).parent / "migrations")
    config.set_main_option("script_location", folder.replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["version_table"] = VERSION_TABLE
    return config


def _revision(connection: Connection, address: RegisterAddress) -> str | None:
    """Return the revision of the tables; None of a database that is empty."""
    names = inspect(connection).get_table_names()
    if names and VERSION_TABLE not in names:
        raise InputError(
            f"register {address.display_url}: it is a database of something else, with a table "
            f"{names[0]!r}; a register takes one of its own"
        )
    context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
    return context.get_current_revision()
