"""What ties the table's clock to the host's, at the start and after an outage."""

from math import isfinite

from inercal.basics.errors import InputError

CLOCK_LOST = frozenset({"the table"})  # names of the refusal: a new run is needed
MATCHING_TIME = 5.0  # s in which the least difference of two clocks is looked for
_ARRIVAL_TOLERANCE, _DRIFT = 1.0, 2e-4  # s, and of an outage: what arrival may be off by
# Uncertainty of an arrival, s: turns of a clock are distinguished where half a turn is more
_ARRIVAL_UNCERTAINTY = 0.1


def wrap_correction(behind: float, wraps: float, outage: float) -> float:
    """Return what to add to the clock of a table that may have begun again, s.

    Parameters
    ----------
    behind : float
        By the host's clock its time should be later by so much, s.
    wraps : float
        s after which it begins again; infinite: never.
    outage : float
        s for which nothing was heard of it.

    Raises
    ------
    InputError
        It was set anew, or may have gone round any number of times.
    """
    drift = _DRIFT * abs(outage)
    added = 0.0
    if isfinite(wraps):
        added = wraps * round(behind / wraps)
        if wraps / 2 < _ARRIVAL_UNCERTAINTY + drift:
            raise InputError(
                f"the table sent nothing for {outage:.3g} s, and its clock starts again every "
                f"{wraps:.3g} s: its clock can no longer be matched to that of the bench; begin a "
                "new run",
                names=tuple(CLOCK_LOST),
            )
    if abs(behind - added) > _ARRIVAL_TOLERANCE + drift:
        raise InputError(
            "the table has reset its clock: it can no longer be matched to the IMU's clock; begin "
            "a new run",
            names=tuple(CLOCK_LOST),
        )
    return added
