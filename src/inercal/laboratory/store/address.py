"""Read the address of a register: an SQLite file, or a database on a PostgreSQL server."""

import os
import re
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from inercal.basics.errors import InputError

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
