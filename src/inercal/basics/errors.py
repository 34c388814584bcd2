"""Define the exceptions of inercal, whose messages state the problem, the place and the remedy.

Every error that a user can cause is an `InercalError` with a one-line message: what is wrong, where
(file, line, row, key), and what is possible. The command line prints it and exits with status 2.
Programs can read the same information from the attributes of the error.
"""

import copy
import re
from collections.abc import Generator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from inercal.basics.visible_text import visible_text


class InercalError(Exception):
    """Base class of all errors raised on purpose; `str(error)` is a one-line message.

    Parameters
    ----------
    message : str
        What happened, where, and what to do.
    file : path, optional
        The file that cannot be used.
    line : int, optional
        The line in the file, counted from 1.
    key : str, optional
        The key, argument or option: "[bench] gravity", "--out".
    names : tuple of str, optional
        The coefficients, axes, columns, steps or bench parameters that the error is about.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        key: str | None = None,
        names: tuple[str, ...] = (),
    ):
        super().__init__(message)
        self.file = None if file is None else Path(file)
        self.line = line
        self.key = key
        self.names = names

    def __str__(self) -> str:
        return visible_text(" ".join(super().__str__().split()))

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors are copied or sent to other processes in this way. `__init__` is not called because
        # its arguments differ from class to class.
        return _rebuild_error, (type(self), self.args, vars(self))

    def located(
        self,
        where: str | Path,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        key: str | None = None,
    ) -> Self:
        """Return this error with `where` before its message, and with its location.

        Parameters
        ----------
        where : str or path
            Start of the message; a path also becomes `file`.
        file, line, key : optional
            See the class; a value that the error already has is not replaced.
        """
        error = copy.copy(self)
        error.args = (f"{where}: {self}", *self.args[1:])
        place = where if isinstance(where, Path) else file
        if error.file is None and place is not None:
            error.file = Path(place)
        error.line = line if error.line is None else error.line
        error.key = key if error.key is None else error.key
        return error


def _rebuild_error(kind: type[InercalError], args: tuple[Any, ...], attributes: dict[str, Any]):
    error = kind.__new__(kind, *args)
    vars(error).update(attributes)
    return error


class InputError(InercalError):
    """A file, a unit, a run file or an argument is invalid."""


class MissingExtra(InputError):
    """An optional part of the package is not installed; `names` contains the missing extra."""


class NotObserved(InercalError):
    """The data do not determine the wanted parameters.

    Parameters
    ----------
    message : str
        A one-line message.
    directions : tuple of str, optional
        Each combination of coefficients that the data do not determine, in words.
    key, names : optional
        See `InercalError`.
    """

    def __init__(
        self,
        message: str,
        directions: tuple[str, ...] = (),
        *,
        key: str | None = None,
        names: tuple[str, ...] = (),
    ):
        super().__init__(message, key=key, names=names)
        self.directions = directions


class NotInvertible(InercalError):
    """A reading that no motion, or more than one motion, would cause in the error model."""


@contextmanager
def error_location(
    where: str | Path, *, file: str | Path | None = None, key: str | None = None
) -> Generator[None]:
    """Add a location to an `InputError` that the block raises; see `InercalError.located`."""
    try:
        yield
    except InputError as error:
        raise error.located(where, file=file, key=key) from None


def require_installed(extra: str, what: str, packages: tuple[str, ...]) -> None:
    """Raise the same error as `require_extra`, but without importing the packages.

    Raises
    ------
    MissingExtra
        One of the packages is not installed.
    """
    if not all(find_spec(package) for package in packages):
        raise MissingExtra(f"{what}: pip install 'inercal[{extra}]'", names=(extra,))


@contextmanager
def require_extra(extra: str, what: str, packages: tuple[str, ...]) -> Generator[None]:
    """If a package of an extra is missing in the block, raise an error that names the extra.

    Parameters
    ----------
    extra : str
        Name of the extra for pip, such as "report".
    what : str
        Start of the message, such as "reports need matplotlib and jinja2".
    packages : tuple of str
        The packages of the extra.

    Raises
    ------
    MissingExtra
        One of the packages cannot be imported. Import errors from other modules are passed on
        unchanged.
    """
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise MissingExtra(f"{what}: pip install 'inercal[{extra}]'", names=(extra,)) from error


def missing_extra(error: ImportError) -> MissingExtra | None:
    """Return the error that says which extra to install for a package that is missing.

    The extras are those in the metadata of inercal. If none contains the package, return None.
    """
    from importlib.metadata import requires  # most programs need no metadata

    package = (error.name or "-").partition(".")[0]
    for requirement in requires("inercal") or ():
        found = re.match(r"([\w-]+).*extra == ['\"](\w+)['\"]", requirement)
        if found and package in (name := found[1].lower(), name.removeprefix("py")):
            what = f"{name} is not installed: pip install 'inercal[{found[2]}]'"
            return MissingExtra(what, names=(found[2],))
    return None
