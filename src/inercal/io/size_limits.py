"""How much a file may declare: a small file can stand for more than any memory holds.

Compression and repetition let 100 kB declare 10⁹ values. What a file declares is summed before it
is decoded, and the sum is limited; `[data] most_values` raises the limit.
"""

from inercal.errors import InputError
from inercal.io.readers import Option

MOST_VALUES = 250_000_000  # of 8 bytes: 2 GB; seven channels at 200 Hz have them after 50 hours
_KEY = "most_values"

MOST_VALUES_OPTION = Option(
    _KEY,
    int,
    MOST_VALUES,
    "values of 8 bytes that the file may declare in the columns that are read",
)


def refuse_too_many_values(size: float, most_values: int, source: str) -> None:
    """Refuse a file whose columns that are read declare too many bytes.

    Parameters
    ----------
    size : float
        Bytes once decoded.
    most_values : int
        Limit in values of 8 bytes.
    source : str

    Raises
    ------
    InputError
        The size exceeds the limit.
    """
    values = size / 8
    if values > most_values:
        raise InputError(
            f"{source} declares {values:.3g} values, more than [data] {_KEY} = {most_values}: "
            f"export the used columns alone, or state {_KEY}",
            key=f"[data] {_KEY}",
        )
