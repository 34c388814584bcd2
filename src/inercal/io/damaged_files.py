"""Files that a library cannot read: whatever it raises on damaged bytes is one clear line."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from inercal.errors import InputError
from inercal.io.column_table import shorten


@contextmanager
def refuse_damage(path: Path, kind: str, advice: str) -> Generator[None]:
    """Raise an error that names the file for every error of a library.

    Libraries raise of many kinds on bytes that were changed. Errors of the system, such as a file
    that may not be read, pass.

    Parameters
    ----------
    path : Path
    kind : str
        What the file is expected to be, "a ULog file".
    advice : str
        What to do, "copy it from the flight controller again".

    Raises
    ------
    InputError
        The file is damaged.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, InputError) or (isinstance(error, OSError) and error.errno):
            raise
        why = shorten(str(error) or type(error).__name__, 100)
        raise InputError(
            f"{path.name} is not {kind} or is damaged: {why}; {advice}", file=path
        ) from error
