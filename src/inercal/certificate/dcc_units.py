r"""Units in the notation of D-SI (PTB, D-SI 2.1.0): \metre\second\tothe{-2}."""

from collections import Counter

from inercal.units.expression import read_unit

_WORDS = {
    "length": r"\metre",
    "time": r"\second",
    "angle": r"\radian",
    "temperature": r"\kelvin",
}


def dsi_unit(*units: str) -> str:
    r"""Return the product of SI units in the notation of D-SI.

    Parameters
    ----------
    *units : str
        SI units as inercal writes them.

    Examples
    --------
    >>> dsi_unit("(rad/s)/(m/s²)"), dsi_unit("1"), dsi_unit("m/s²", "m/s²")
    ('\\metre\\tothe{-1}\\second\\radian', '\\one', '\\metre\\tothe{2}\\second\\tothe{-4}')
    """
    powers: Counter[str] = Counter()
    for unit in units:
        for name, power in read_unit(unit).dimension:
            powers[name] += round(power)
    words = [
        word + ("" if powers[name] == 1 else rf"\tothe{{{powers[name]}}}")
        for name, word in _WORDS.items()
        if powers[name]
    ]
    return "".join(words) or r"\one"
