"""Files that a library cannot read: whatever it raises on damaged bytes is one clear line."""

from collections.abc import Generator
from contextlib import contextmanager
from errno import EINVAL, EOVERFLOW
from pathlib import Path

from inercal.basics.errors import InercalError, InputError
from inercal.recordings.io.column_table import shorten

_OF_THE_BYTES = (None, 0, EINVAL, EOVERFLOW)  # as of a place before the begin of the file


@contextmanager
def refuse_damage(path: Path, kind: str, advice: str) -> Generator[None]:
    """Raise an error that names the file for every error of a library.

    Libraries raise of many kinds on bytes that were changed. Errors of the system, such as a file
    that may not be read or too little memory, pass.

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
    except (InercalError, ImportError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno not in _OF_THE_BYTES:
            raise
        why = shorten(str(error) or type(error).__name__, 100)
        raise InputError(
            f"{path.name} is not {kind} or is damaged: {why}; {advice}", file=path
        ) from error
