"""The exceptions: what happened, where, and what to do.

Every error that a user can cause is an `InercalError` whose message is one line: what is wrong,
where (file, line, row, key), and what is possible. The command line prints it and exits with 2.
"""

from collections.abc import Generator
from contextlib import contextmanager


class InercalError(Exception):
    """Base of all errors raised on purpose; `str(error)` is one line for a person."""

    def __str__(self) -> str:
        return " ".join(super().__str__().split())


class InputError(InercalError):
    """A file, a unit, a run file or an argument cannot be used as it is."""


class NotObserved(InercalError):
    """The data do not determine what was asked for.

    Parameters
    ----------
    message : str
        One line for a person.
    directions : tuple of str, optional
        Each combination of coefficients that the data leave free, in words.
    """

    def __init__(self, message: str, directions: tuple[str, ...] = ()):
        super().__init__(message)
        self.directions = directions


class NotInvertible(InercalError):
    """A reading that the error model cannot have produced, or that it folds back on."""


@contextmanager
def require_extra(extra: str, what: str, packages: tuple[str, ...]) -> Generator[None]:
    """Say which extra to install where one of the packages that it brings is missing.

    Parameters
    ----------
    extra : str
        As pip takes it, "report".
    what : str
        What needs it, "reports need matplotlib and jinja2".
    packages : tuple of str

    Raises
    ------
    InputError
        One of them cannot be imported. What is wrong with any other module is raised as it is.
    """
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise InputError(f"{what}: pip install 'inercal[{extra}]'") from error
