"""Connect to a register, report its errors in one line, and upgrade its tables.

A transaction that writes locks the whole register, both on SQLite and on PostgreSQL. The data that
it has read can therefore not change before it writes. Other transactions wait for at most
`_LOCK_TIMEOUT`.

Addresses of registers: SQLite files, or databases on a PostgreSQL server.
"""

import os
import re
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import (
    URL,
    Connection,
    Engine,
    NullPool,
    create_engine,
    event,
    inspect,
    make_url,
    text,
)
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError

from inercal.basics.errors import InputError
from inercal.laboratory.store.register_tables import metadata

ENVIRONMENT_VARIABLE = "INERCAL_REGISTER"
DEFAULT = "default"
_SQLITE = "sqlite:///"
_SERVERS = ("postgresql", "postgres", "postgresql+psycopg")
_SHOWN_PARAMETERS = frozenset(("sslmode", "connect_timeout", "application_name", "host", "port"))
# Texts that look like a server address but are not valid: "postgresql:/u:secret@h/db",
# "u:secret@h/db", "host=h password=secret". They are not used as a file name, because they may
# contain a password.
_MISTYPED_SERVER = re.compile(
    r"""\W*postgres(?:ql)?(?:\+\w+)?(?::|//)  # the scheme without ://
      | (?:(?![./~])|//).*:[^/]*@             # user and password before a host
      | (?:.*\s)?(?:(?:ssl)?pass(?:word|file)?|host(?:addr)?|dbname|user)\s*=""",
    re.IGNORECASE | re.VERBOSE | re.DOTALL,
)
_ADDRESS_FORMS = "a path, sqlite:///PATH or postgresql://USER@HOST/DATABASE"


@dataclass(frozen=True)
class RegisterAddress:
    """The address of a register.

    Parameters
    ----------
    url : URL
        Address as SQLAlchemy accepts it.
    file : Path or None
        Absolute path of the SQLite file; None for a server.
    display_url : str
        Address for printing, without a password.
    """

    url: URL = field(repr=False)  # may contain a password that SQLAlchemy would show
    file: Path | None
    display_url: str

    def error(self, text: str) -> InputError:
        """Return an error about this register, whose message continues with `text`."""
        return InputError(f"register {self.display_url}{text}", file=self.file, key="--register")


def resolve_address(text: str | None = None) -> RegisterAddress:
    """Return the address of a register from its text.

    Parameters
    ----------
    text : str, optional
        A path, "sqlite:///PATH" or "postgresql://USER@HOST/DATABASE". None or "default" means
        $INERCAL_REGISTER. If this is not set, it means inercal/register.db in $XDG_DATA_HOME or
        ~/.local/share.

    Raises
    ------
    InputError
        If the address is of another kind, or the home folder is unknown.
    """
    if text in (None, DEFAULT):
        text = os.environ.get(ENVIRONMENT_VARIABLE) or None
    if text is None:
        return _file_address(_default_path())
    scheme, mark, _ = text.partition("://")
    if mark and scheme in _SERVERS:
        return _server_address(text)
    path = text.removeprefix(_SQLITE)
    if path and os.path.isdir(path):
        raise InputError(
            f"register {path} is a folder; give the file of the register in it",
            file=path,
            key="--register",
        )
    if _MISTYPED_SERVER.match(path):
        raise _unreadable_server_address()
    if not mark or (path != text and path):
        return _file_address(Path(path))
    shown = f"{scheme}://" if scheme.isalnum() else "of this kind"
    raise InputError(
        f"a register cannot have an address {shown}; give {_ADDRESS_FORMS}", key="--register"
    )


def require_place_of_register(file: Path, *, create: bool) -> None:
    """Raise an error if a missing register must not or cannot be created.

    Parameters
    ----------
    file : path
        Path of a file that does not exist.
    create : bool
        Whether the file will be created.

    Raises
    ------
    InputError
        If the register is not created; the message suggests the file with the most similar name.
    """
    folder = file.parent
    if create:
        try:
            if file == _default_path():
                folder.mkdir(parents=True, exist_ok=True)
            if folder.is_dir() and os.access(folder, os.W_OK | os.X_OK):
                return
            reason = "its folder must exist and be writable: create it, or give"
        except OSError as error:
            reason = f"its folder cannot be created ({error}); give"
        raise InputError(
            f"register {_SQLITE}{file} cannot be opened; {reason} another register with "
            f"--register or ${ENVIRONMENT_VARIABLE}",
            file=file,
            key="--register",
        )
    there = [one.name for one in folder.iterdir() if one.is_file()] if folder.is_dir() else []
    near = get_close_matches(file.name, there, 1, 0.5)
    raise InputError(
        f"{file}: there is no such register; "
        + (f"did you mean {folder / near[0]}? " if near else "")
        + "give another one with --register, or create one with `inercal store import PATH…`",
        file=file,
        key="--register",
        names=tuple(near),
    )


def _default_path() -> Path:
    own = os.environ.get("XDG_DATA_HOME", "")
    try:
        # A relative path in this variable is ignored (XDG Base Directory Specification).
        folder = Path(own) if os.path.isabs(own) else Path.home() / ".local" / "share"
    except RuntimeError as error:
        raise InputError(
            f"the home folder is unknown: {error}; give a register with --register or "
            f"${ENVIRONMENT_VARIABLE}",
            key="--register",
        ) from None
    return folder / "inercal" / "register.db"


def _file_address(path: Path) -> RegisterAddress:
    if not str(path) or path == Path():
        raise InputError(
            f"the address of the register is empty; give {_ADDRESS_FORMS}", key="--register"
        )
    file = Path(os.path.abspath(path.expanduser()))
    # The URL is not parsed from text, because a path may contain any character.
    return RegisterAddress(
        URL.create("sqlite+pysqlite", database=str(file)), file, f"{_SQLITE}{file}"
    )


def _unreadable_server_address() -> InputError:
    # An address that cannot be parsed is not printed, because any part may be a password.
    return InputError(
        "this address of a PostgreSQL register is not valid: write "
        "postgresql://USER@HOST:PORT/DATABASE, with %40 for @, %2F for / and %3A for : in its "
        "parts, and put the password into $PGPASSWORD or ~/.pgpass. For a file of that name "
        "write ./NAME",
        key="--register",
    )


def _server_address(text: str) -> RegisterAddress:
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        raise _unreadable_server_address() from None
    shown = (url.host or "", url.database or "", url.username or "")
    if any(letter in part for part in shown for letter in "@:=") or "/" in shown[1]:
        raise _unreadable_server_address()
    hidden = url.set(drivername="postgresql").update_query_dict(
        dict.fromkeys((name for name in url.query if name not in _SHOWN_PARAMETERS), "hidden")
    )
    return RegisterAddress(
        url.set(drivername="postgresql+psycopg"), None, hidden.render_as_string()
    )


VERSION_TABLE = "inercal_version"
_BEFORE_RELEASE = ("0001", "0002", "0003", "0004")  # revisions before the first release
_LOCK_TIMEOUT = 30  # s
# With these settings, a server that stops answering is detected within half a minute, not after
# hours.
_KEEPALIVE_OPTIONS = {
    "connect_timeout": 10,  # s
    "keepalives_idle": 10,  # s
    "keepalives_interval": 5,  # s
    "keepalives_count": 3,
    "tcp_user_timeout": 30_000,  # ms
}
_LOCK_KEY = 0x696E6572  # "iner": key of the PostgreSQL advisory lock for writing
_SQLITE_MESSAGES = {  # our messages, by SQLite's message
    "unable to open database file": "cannot be opened; its folder must exist and be writable",
    "file is not a database": "is not an SQLite database; give another file",
    "database disk image is malformed": "is damaged; restore it from a copy",
    "attempt to write a readonly database": "is read-only; make the file writable",
    "database is locked": f"another program has locked it for {_LOCK_TIMEOUT} s; end that program",
}


def make_engine(address: RegisterAddress) -> Engine:
    """Return an engine that closes its connection after each transaction."""
    if address.file is None:
        query = address.url.query
        options = {name: value for name, value in _KEEPALIVE_OPTIONS.items() if name not in query}
        engine = create_engine(address.url, poolclass=NullPool, connect_args=options)
    else:
        engine = create_engine(
            address.url, poolclass=NullPool, connect_args={"timeout": _LOCK_TIMEOUT}
        )
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_transaction)
    return engine


@contextmanager
def read_transaction(engine: Engine, address: RegisterAddress) -> Generator[Connection]:
    """Yield a connection in a transaction that only reads."""
    with translate_errors(address), engine.connect() as connection:
        yield connection


@contextmanager
def write_transaction(engine: Engine, address: RegisterAddress) -> Generator[Connection]:
    """Yield a connection in a transaction that locks the register; it is written as a whole."""
    with translate_errors(address), engine.execution_options(writes=True).begin() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text(f"SET LOCAL lock_timeout = '{_LOCK_TIMEOUT}s'"))
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK_KEY})"))
        yield connection


@contextmanager
def translate_errors(address: RegisterAddress) -> Generator[None]:
    """Convert database errors to one line with the address of the register but no password.

    Raises
    ------
    InputError
        For any error of the database.
    """
    try:
        yield
    except SQLAlchemyError as error:
        raise address.error(f": {_error_text(error)}") from None
    except UnicodeEncodeError:
        raise address.error(
            ": a text to be stored is not valid Unicode; correct the name or the file that "
            "contains it"
        ) from None


def _error_text(error: SQLAlchemyError) -> str:
    # str(error) would contain the statement and its parameters.
    message = str(error.orig) if isinstance(error, DBAPIError) else str(error)
    return next(
        (text for begin, text in _SQLITE_MESSAGES.items() if message.startswith(begin)), message
    )


def _configure_sqlite(connection: Any, _: object) -> None:
    # Transactions begin in `_begin_transaction`, and not where the driver chooses.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.close()


def _begin_transaction(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    # A transaction that starts by reading might not get the lock when it writes.
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def upgrade_register(engine: Engine, address: RegisterAddress, *, create: bool = True) -> None:
    """Create the tables of a new register, or upgrade an older register, in one transaction.

    Raises
    ------
    InputError
        If the tables were written by a newer version, by a version before 0.1.0 or by another
        program, or if the database is empty and `create` is false.
    """
    config = _config()
    script = ScriptDirectory.from_config(config)
    head = script.get_current_head()
    with read_transaction(engine, address) as connection:
        revision = _revision(connection, address)
    if revision == head:
        return
    if revision is None and not create:
        raise address.error(
            " is an empty database; enter a calibration first with `inercal store import PATH…`"
        )
    with write_transaction(engine, address) as connection:
        # Another process may have upgraded the register in the meantime.
        revision = _revision(connection, address)
        if revision == head:
            return
        known = {each.revision for each in script.walk_revisions()}
        if revision is not None and revision in _BEFORE_RELEASE:
            raise address.error(
                " was written before the first release of inercal, and this version cannot read "
                "it; import the calibration files into a new register"
            )
        if revision is not None and revision not in known:
            raise address.error(
                f" was written by a newer inercal (its tables have revision {revision}, this "
                f"version knows revisions up to {head}); install the newer version"
            )
        config.attributes["connection"] = connection
        if revision is None:
            metadata.create_all(connection)
            command.stamp(config, "head")
        else:
            command.upgrade(config, "head")


def _config() -> Config:
    config = Config()
    folder = str(Path(__file__).parent / "migrations")
    config.set_main_option("script_location", folder.replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["version_table"] = VERSION_TABLE
    return config


def _revision(connection: Connection, address: RegisterAddress) -> str | None:
    """Return the revision of the tables; None for an empty database."""
    names = inspect(connection).get_table_names()
    if names and VERSION_TABLE not in names:
        raise address.error(
            f": this database belongs to another program, because it has a table {names[0]!r}; "
            "create a separate database for the register"
        )
    context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
    return context.get_current_revision()
