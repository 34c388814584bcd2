"""What several verbs of `inercal bench` take."""

from math import inf

TABLE = "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://…?axes=1,2,3 or motor:serial:…"
CLOCK = "Of a simulated bench, as `simulate` says it."
SPEED = "Most seconds of a simulated bench in one of the wall's."


def above_zero(option: str, given: float | str, otherwise: str = "") -> float:
    """Return the number that was given to an option.

    Parameters
    ----------
    option : str
        As it is written.
    given : float or str
    otherwise : str
        What else is possible, said where it is no number above 0.

    Raises
    ------
    InputError
        It is none.
    """
    from inercal.errors import InputError

    try:
        value = float(given)
    except ValueError:
        value = 0.0
    if not 0 < value < inf:
        raise InputError(f"{option} {given}; give a number above 0{otherwise}")
    return value
