"""Connections to a register, and what goes wrong with them in words.

A transaction that writes has the whole register to itself, on SQLite and on PostgreSQL alike: what
it looked up is still so when it writes. Others wait for it, as long as `_LOCK_TIMEOUT` says.
"""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, NullPool, create_engine, event, text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from inercal.errors import InputError
from inercal.store.address import RegisterAddress

_LOCK_TIMEOUT = 30  # s
# A server that is gone without a word is noticed within half a minute, not after hours.
_KEEPALIVE_OPTIONS = {
    "connect_timeout": 10,  # s
    "keepalives_idle": 10,  # s
    "keepalives_interval": 5,  # s
    "keepalives_count": 3,
    "tcp_user_timeout": 30_000,  # ms
}
_LOCK_KEY = 0x696E6572  # "iner": of PostgreSQL's advisory locks the one that writing takes
_SQLITE_MESSAGES = {  # of what SQLite says
    "unable to open database file": "cannot be opened: is its folder there, and can it be written?",
    "file is not a database": "is there, but is not an SQLite database",
    "database disk image is malformed": "is damaged: restore it from a copy",
    "attempt to write a readonly database": "cannot be written",
    "database is locked": f"another program has held it for {_LOCK_TIMEOUT} s",
}


def make_engine(address: RegisterAddress) -> Engine:
    """Return what makes connections; none is kept between two transactions."""
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
    """Give a connection in a transaction that only reads."""
    with translate_errors(address), engine.connect() as connection:
        yield connection


@contextmanager
def write_transaction(engine: Engine, address: RegisterAddress) -> Generator[Connection]:
    """Give a connection in a transaction that has the register to itself; all of it or nothing."""
    with translate_errors(address), engine.execution_options(writes=True).begin() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text(f"SET LOCAL lock_timeout = '{_LOCK_TIMEOUT}s'"))
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK_KEY})"))
        yield connection


@contextmanager
def translate_errors(address: RegisterAddress) -> Generator[None]:
    """Turn what a database says into one line with the register's address, without a password.

    Raises
    ------
    InputError
        Whatever went wrong.
    """
    try:
        yield
    except SQLAlchemyError as error:
        raise InputError(f"register {address.display_url}: {_error_text(error)}") from None
    except UnicodeEncodeError:
        raise InputError(f"register {address.display_url}: a text that is not Unicode") from None


def _error_text(error: SQLAlchemyError) -> str:
    # The whole text of an error would hold the statement and what it was given.
    told = str(error.orig) if isinstance(error, DBAPIError) else str(error)
    return next(
        (words for begin, words in _SQLITE_MESSAGES.items() if told.startswith(begin)), told
    )


def _configure_sqlite(connection: Any, _: object) -> None:
    # The driver begins transactions where it thinks fit; here `_begin_transaction` does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.close()


def _begin_transaction(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    # A reader that would write later could find that it must not any more; so ask at once.
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
