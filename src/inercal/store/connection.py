"""Connections to a register, and what goes wrong with them in words.

A transaction that writes has the whole register to itself, on SQLite and on PostgreSQL alike: what
it looked up is still so when it writes. Others wait for it, as long as `_WAIT` says.
"""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, NullPool, create_engine, event, text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from inercal.errors import InputError
from inercal.store.address import Address

_WAIT = 30  # s
# A server that is gone without a word is noticed within half a minute, not after hours.
_ALIVE = {
    "connect_timeout": 10,  # s
    "keepalives_idle": 10,  # s
    "keepalives_interval": 5,  # s
    "keepalives_count": 3,
    "tcp_user_timeout": 30_000,  # ms
}
_LOCK = 0x696E6572  # "iner": of PostgreSQL's advisory locks the one that writing takes
_WORDS = {  # of what SQLite says
    "unable to open database file": "cannot be opened: is its folder there, and can it be written?",
    "file is not a database": "is there, but is no SQLite database",
    "database disk image is malformed": "is damaged: restore it from a copy",
    "attempt to write a readonly database": "cannot be written",
    "database is locked": f"another program has held it for {_WAIT} s",
}


def engine_of(address: Address) -> Engine:
    """Return what makes connections; none is kept between two transactions."""
    if address.file is None:
        query = address.url.query
        options = {name: value for name, value in _ALIVE.items() if name not in query}
        engine = create_engine(address.url, poolclass=NullPool, connect_args=options)
    else:
        engine = create_engine(address.url, poolclass=NullPool, connect_args={"timeout": _WAIT})
        event.listen(engine, "connect", _set_up)
        event.listen(engine, "begin", _begin)
    return engine


@contextmanager
def reading(engine: Engine, address: Address) -> Generator[Connection]:
    """Give a connection in a transaction that only reads."""
    with said(address), engine.connect() as connection:
        yield connection


@contextmanager
def writing(engine: Engine, address: Address) -> Generator[Connection]:
    """Give a connection in a transaction that has the register to itself; all of it or nothing."""
    with said(address), engine.execution_options(writes=True).begin() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text(f"SET LOCAL lock_timeout = '{_WAIT}s'"))
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
        yield connection


@contextmanager
def said(address: Address) -> Generator[None]:
    """Turn what a database says into one line with the register's address, without a password.

    Raises
    ------
    InputError
        Whatever went wrong.
    """
    try:
        yield
    except SQLAlchemyError as error:
        raise InputError(f"register {address.shown}: {_words(error)}") from None
    except UnicodeEncodeError:
        raise InputError(f"register {address.shown}: a text that is no Unicode") from None


def _words(error: SQLAlchemyError) -> str:
    # The whole text of an error would hold the statement and what it was given.
    told = str(error.orig) if isinstance(error, DBAPIError) else str(error)
    return next((words for begin, words in _WORDS.items() if told.startswith(begin)), told)


def _set_up(connection: Any, _: object) -> None:
    # The driver begins transactions where it thinks fit; here `_begin` does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.close()


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    # A reader that would write later could find that it must not any more; so ask at once.
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
