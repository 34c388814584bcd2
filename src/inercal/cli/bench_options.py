"""Options that several verbs of `inercal bench` have."""

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inercal.host.tasks import RunOptions

TABLE_HELP = (
    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://…?axes=1,2,3 or motor:serial:…"
)
CLOCK_HELP = "Clock of a simulated bench, as `simulate` prints it."
SPEED_HELP = "Most simulated seconds per second, on a simulated bench."
PATIENCE_HELP = "Seconds without IMU data before the run ends."
TEMPERATURE_HELP = "Permitted range of the IMU's temperature, °C, such as 15:40."


def positive_number(option: str, given: float | str, otherwise: str = "") -> float:
    """Return the number of an option.

    Parameters
    ----------
    option : str
        Its name, "--pace".
    given : float or str
    otherwise : str
        What else is possible, for the message.

    Raises
    ------
    InputError
        Not a number above 0.
    """
    from inercal.basics.errors import InputError

    try:
        value = float(given)
    except ValueError:
        value = 0.0
    if not 0 < value < inf:
        raise InputError(f"{option} {given}: give a number above 0{otherwise}", key=option)
    return value


def run_options(speed: float | None, patience: float, temperature: str) -> "RunOptions":
    """Return the options `--speed`, `--patience` and `--temperature`.

    Raises
    ------
    InputError
        Not a number above 0, or not two temperatures in rising order.
    """
    from inercal.basics.errors import InputError
    from inercal.basics.units import ZERO_CELSIUS
    from inercal.host.tasks import RunOptions

    within: tuple[float, float] | None = None
    if temperature:
        low, _, high = temperature.partition(":")
        try:
            within = float(low) + ZERO_CELSIUS, float(high) + ZERO_CELSIUS
        except ValueError:
            within = (1.0, 0.0)
        if not within[0] < within[1]:
            raise InputError(
                f"--temperature {temperature!r}: give lowest and highest °C, such as 15:40",
                key="--temperature",
            )
    for name, value in (("--speed", speed), ("--patience", patience)):
        if value is not None:
            positive_number(name, value)
    return RunOptions(speed, within, patience)
