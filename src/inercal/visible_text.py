"""Text for a terminal: what a name, a note or a file brings along never controls the terminal."""

import unicodedata

# Control, format (which turns the direction of writing) and halves of surrogate pairs.
_HIDDEN = frozenset(("Cc", "Cf", "Cs"))


def visible_text(text: str, keep: str = "") -> str:
    r"""Return text with its control characters escaped.

    Parameters
    ----------
    text : str
    keep : str, optional
        Control characters that stay.

    Examples
    --------
    >>> visible_text("IMU\x1b[2J #17")
    'IMU\\x1b[2J #17'
    """
    if text.isprintable():
        return text
    return "".join(
        ascii(one)[1:-1] if unicodedata.category(one) in _HIDDEN and one not in keep else one
        for one in text
    )
