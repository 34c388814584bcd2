"""The exceptions: what happened, where, and what to do.

Every error that a user can cause is an `InercalError` whose message is one line: what is wrong,
where (file, line, row, key), and what is possible. The command line prints it and exits with 2.
A program reads the same from the attributes of the error.
"""

import copy
from collections.abc import Generator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from inercal.basics.visible_text import visible_text


class InercalError(Exception):
    """Base of all errors raised on purpose; `str(error)` is one line for a person.

    Parameters
    ----------
    message : str
        What happened, where, and what to do.
    file : path, optional
        The file that cannot be used.
    line : int, optional
        Its line, counted from 1.
    key : str, optional
        The key, argument or option: "[bench] gravity", "--out".
    names : tuple of str, optional
        What the error is about: coefficients, axes, columns, steps, parameters of the bench.
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
        # To a copy, or to another process; not by `__init__`: its arguments differ by class.
        return _rebuild_error, (type(self), self.args, vars(self))

    def located(
        self,
        where: str | Path,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        key: str | None = None,
    ) -> Self:
        """Return this error with `where` before its message, and what is known of the place.

        Parameters
        ----------
        where : str or path
            What the message begins with; a path is the `file` too.
        file, line, key : optional
            As of the class; what the error states already is kept.
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
    """A file, a unit, a run file or an argument cannot be used as it is."""


class MissingExtra(InputError):
    """An optional part of the package is not installed; `names` is the extra."""


class NotObserved(InercalError):
    """The data do not determine the wanted parameters.

    Parameters
    ----------
    message : str
        One line for a person.
    directions : tuple of str, optional
        Each combination of coefficients that the data do not determine, in words.
    key, names : optional
        As of `InercalError`.
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
    """The error model has no motion, or no unique motion, for a reading."""


def require_installed(extra: str, what: str, packages: tuple[str, ...]) -> None:
    """Raise the error of `require_extra` before any work, without importing the packages.

    Raises
    ------
    MissingExtra
        One of the packages is not installed.
    """
    if not all(find_spec(package) for package in packages):
        raise MissingExtra(f"{what}: pip install 'inercal[{extra}]'", names=(extra,))


@contextmanager
def require_extra(extra: str, what: str, packages: tuple[str, ...]) -> Generator[None]:
    """Raise an error that names the extra to install where one of its packages is missing.

    Parameters
    ----------
    extra : str
        Name of the extra for pip, "report".
    what : str
        Begin of the message, "reports need matplotlib and jinja2".
    packages : tuple of str
        The packages of the extra.

    Raises
    ------
    MissingExtra
        One of the packages cannot be imported. Import errors of other modules are not changed.
    """
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise MissingExtra(f"{what}: pip install 'inercal[{extra}]'", names=(extra,)) from error
