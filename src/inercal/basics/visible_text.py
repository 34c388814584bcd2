"""Text for others, which controls no terminal and no spreadsheet, whatever a name contains."""

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


def spreadsheet_cell(text: str) -> str:
    """Return text as a cell of a CSV file that no spreadsheet takes for a formula.

    A text that begins like a formula gets an apostrophe, which spreadsheets do not show. Numbers
    stay as they are.

    Examples
    --------
    >>> [spreadsheet_cell(text) for text in ("=1+1", "-0.5", "A-17")]
    ["'=1+1", '-0.5', 'A-17']
    """
    shown = visible_text(text)
    if not shown.startswith(("=", "+", "-", "@")):
        return shown
    try:
        float(shown)
    except ValueError:
        return f"'{shown}"
    return shown
