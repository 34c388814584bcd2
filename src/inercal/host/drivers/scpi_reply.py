"""Numbers in replies of measuring instruments.

A reply contains one number, or several separated by commas, semicolons or spaces. In SCPI, 9.9E37
stands for infinity and 9.91E37 for "not a number" (HP 53131A/132A programming guide, table 3-3; HP
54620 programmer's guide, "Infinity representation"). Multimeters send both for an overload.
"""

import re
from math import isfinite

from inercal.basics.errors import InputError
from inercal.host.drivers.rotary_table import ProtocolError

_OVERLOAD = 9e36
_WORD = re.compile(r"[A-Za-zµμΩ°/²%]*")  # a unit after a number is not a value


def numbers_in_reply(reply: str, address: str, query: str = "--query") -> list[float]:
    """Return the numbers in a reply; a message names the option `query` that requests them.

    Raises
    ------
    ProtocolError
        The reply contains no number, a word that is not a unit, or a number that is not finite.
    InputError
        The reply means an overload.

    Examples
    --------
    >>> numbers_in_reply("+1.25E-03,-2.0 V", "tcp://10.0.0.5:5025")
    [0.00125, -2.0]
    """
    found: list[float] = []
    for word in re.split(r"[,;\s]+", reply.strip()):
        try:
            found.append(float(word))
        except ValueError:
            if not found or not _WORD.fullmatch(word):
                found.clear()
                break
    if not found or not all(map(isfinite, found)):
        raise ProtocolError(
            f"{address}: {reply[:60]!r} is not a reading: expected numbers separated by commas; "
            f"check the instrument and {query}",
            names=(address,),
        )
    if any(abs(value) >= _OVERLOAD for value in found):
        raise InputError(
            f"{address}: the instrument reports an overload ({reply[:60]}); choose a larger range, "
            "or check the input",
            names=(address,),
        )
    return found
