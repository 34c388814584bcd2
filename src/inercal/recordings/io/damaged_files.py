"""Convert the errors that libraries raise on damaged files into clear messages."""

from codecs import getincrementaldecoder
from collections.abc import Generator
from contextlib import contextmanager
from errno import EINVAL, EOVERFLOW
from pathlib import Path

from inercal.basics.errors import InercalError, InputError
from inercal.recordings.io.column_table import file_head, shorten

_OF_THE_BYTES = (None, 0, EINVAL, EOVERFLOW)  # for example, a position before the start of the file

_HEAD = 1024  # bytes


@contextmanager
def refuse_damage(path: Path, kind: str, advice: str) -> Generator[None]:
    """Convert every error that a library raises into an error that names the file.

    Libraries raise many kinds of errors if bytes were changed. System errors, such as a missing
    permission or insufficient memory, are passed on unchanged.

    Parameters
    ----------
    path : Path
    kind : str
        The expected kind of file, "a ULog file".
    advice : str
        Advice on what to do, "copy it from the flight controller again".

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
        if _is_text(path):
            why, advice = "its content is text", "give a table the suffix .csv"
        raise InputError(
            f"{path.name} is not {kind} or is damaged: {why}; {advice}", file=path
        ) from error


def _is_text(path: Path) -> bool:
    """Return whether a file begins with characters that are printable, or end lines."""
    if not path.is_file():
        return False
    decoder = getincrementaldecoder("utf-8-sig")("replace")
    head = decoder.decode(file_head(path, _HEAD))  # without a character that is cut at the end
    printable = all(one.isprintable() or one.isspace() for one in head)
    return bool(head) and printable and "\ufffd" not in head
