"""Make text safe to print: names must not control a terminal or act as spreadsheet formulas."""

import unicodedata

# Control characters, format characters (which can reverse the writing direction), and surrogates.
_HIDDEN = frozenset(("Cc", "Cf", "Cs"))


def visible_text(text: str, keep: str = "") -> str:
    r"""Return text with its control characters escaped.

    Parameters
    ----------
    text : str
    keep : str, optional
        Control characters to keep.

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
    """Return text as a CSV cell that no spreadsheet interprets as a formula.

    Text that starts like a formula gets a leading apostrophe, which spreadsheets do not show.
    Numbers are unchanged.

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
