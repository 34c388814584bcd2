"""What goes wrong, in words.

Every error that a user can cause is an `InercalError` whose message is one line: what is wrong,
where (file, line, row, key), and what is possible. The command line prints it and exits with 2.
"""


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
