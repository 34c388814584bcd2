"""What several verbs of `inercal bench` take."""

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inercal.host.options import RunOptions

TABLE_HELP = (
    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://…?axes=1,2,3 or motor:serial:…"
)
CLOCK_HELP = "Of a simulated bench, as `simulate` says it."
SPEED_HELP = "Most seconds of a simulated bench in one of the wall's."
PATIENCE_HELP = "s that the IMU may be gone before the run ends."
TEMPERATURE_HELP = "°C that the IMU must stay within, as 15:40."


def positive_number(option: str, given: float | str, otherwise: str = "") -> float:
    """Return the number that was given to an option.

    Parameters
    ----------
    option : str
        As it is written.
    given : float or str
    otherwise : str
        What else is possible, said where it is not a number above 0.

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


def run_options(speed: float | None, patience: float, temperature: str) -> "RunOptions":
    """Return what was given to `--speed`, `--patience` and `--temperature`.

    Raises
    ------
    InputError
        No number above 0, or no two temperatures of which the lower one comes first.
    """
    from inercal.errors import InputError
    from inercal.host.options import RunOptions
    from inercal.units import ZERO_CELSIUS

    within: tuple[float, float] | None = None
    if temperature:
        low, _, high = temperature.partition(":")
        try:
            within = float(low) + ZERO_CELSIUS, float(high) + ZERO_CELSIUS
        except ValueError:
            within = (1.0, 0.0)
        if not within[0] < within[1]:
            raise InputError(f"--temperature {temperature!r}; give lowest and highest °C, as 15:40")
    for name, value in (("--speed", speed), ("--patience", patience)):
        if value is not None:
            positive_number(name, value)
    return RunOptions(speed, within, patience)
