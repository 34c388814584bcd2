"""Where a register is: a file of SQLite, or a database of a PostgreSQL server."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from inercal.errors import InputError

ENVIRONMENT_VARIABLE = "INERCAL_REGISTER"
DEFAULT = "default"
_SQLITE = "sqlite:///"
_SERVERS = ("postgresql", "postgres", "postgresql+psycopg")
_SECRET_PARAMETERS = ("password", "sslpassword")
_ADDRESS_FORMS = "a path, sqlite:///PATH or postgresql://USER@HOST/DATABASE"


@dataclass(frozen=True)
class RegisterAddress:
    """Where a register is.

    Parameters
    ----------
    url : URL
        As SQLAlchemy takes it.
    file : Path or None
        Of SQLite, absolute.
    display_url : str
        To be printed: it holds no password.
    """

    url: URL = field(repr=False)  # it may hold a password where SQLAlchemy does not hide one
    file: Path | None
    display_url: str


def resolve_address(text: str | None = None) -> RegisterAddress:
    """Return where a register is.

    Parameters
    ----------
    text : str, optional
        A path, "sqlite:///PATH" or "postgresql://USER@HOST/DATABASE". None or "default" is the
        address in $INERCAL_REGISTER, else inercal/register.db in $XDG_DATA_HOME or ~/.local/share,
        whose folder is created.

    Raises
    ------
    InputError
        An address of another kind, or the folder cannot be created.
    """
    if text in (None, DEFAULT):
        text = os.environ.get(ENVIRONMENT_VARIABLE) or None
    if text is None:
        return _file_address(_default_path())
    scheme, mark, _ = text.partition("://")
    if not mark:
        return _file_address(Path(text))
    if text.startswith(_SQLITE) and text != _SQLITE:
        return _file_address(Path(text.removeprefix(_SQLITE)))
    if scheme in _SERVERS:
        return _server_address(text)
    raise InputError(
        f"a register cannot have an address {scheme}://; give {_ADDRESS_FORMS}", key="--register"
    )


def _default_path() -> Path:
    own = os.environ.get("XDG_DATA_HOME", "")
    try:
        # A relative path in that variable counts for nothing (XDG Base Directory Specification).
        folder = Path(own) if os.path.isabs(own) else Path.home() / ".local" / "share"
        path = folder / "inercal" / "register.db"
        path.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"the register's folder cannot be created: {error}; name another register by "
            f"--register or ${ENVIRONMENT_VARIABLE}",
            key="--register",
        ) from None
    return path


def _file_address(path: Path) -> RegisterAddress:
    if not str(path) or path == Path():
        raise InputError(
            f"the address of the register is empty; give {_ADDRESS_FORMS}", key="--register"
        )
    file = Path(os.path.abspath(path.expanduser()))
    # Not read from a text: a path may hold any character.
    return RegisterAddress(
        URL.create("sqlite+pysqlite", database=str(file)), file, f"{_SQLITE}{file}"
    )


def _server_address(text: str) -> RegisterAddress:
    # An address that cannot be parsed is not printed: any part of it may be a password.
    refusal = InputError(
        "the address of a PostgreSQL register cannot be read: write "
        "postgresql://USER:PASSWORD@HOST:PORT/DATABASE, with %40 for @, %2F for / and %3A for : in "
        "the password",
        key="--register",
    )
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        raise refusal from None
    if "@" in (url.host or ""):
        raise refusal
    hidden = url.set(drivername="postgresql").update_query_dict(
        dict.fromkeys((name for name in _SECRET_PARAMETERS if name in url.query), "hidden")
    )
    return RegisterAddress(
        url.set(drivername="postgresql+psycopg"), None, hidden.render_as_string()
    )
