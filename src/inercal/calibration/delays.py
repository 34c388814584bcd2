"""State how much later one kind of sensor is sampled than the others, among the conditions."""

from collections.abc import Mapping

from inercal.basics.units import Measured, format_quantity, parse_quantity
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.quantities import KINDS, QUANTITIES, Measures

_DIGITS = 3  # of a delay that is printed without U


def delay_condition(kind: str, delay: Measured) -> dict[str, str]:
    """Return the condition that states a delay, s, of the sensors of one kind, with its U."""
    size = format_quantity(delay.value, COVERAGE * delay.sd, "ms")
    return {_name(kind): f"{size} (k = {COVERAGE:g})"}


def stated_delays(conditions: Mapping[str, str]) -> dict[Measures, Measured]:
    """Return the delays, s, among the conditions of a calibration, by kind."""
    return {
        kind: parse_quantity(text, "s")
        for kind in KINDS
        if (text := conditions.get(_name(kind))) is not None
    }


def significant_delays(conditions: Mapping[str, str]) -> dict[Measures, Measured]:
    """Return the stated delays, s, that are larger than their U, by kind."""
    stated = stated_delays(conditions)
    return {kind: late for kind, late in stated.items() if abs(late.value) > COVERAGE * late.sd}


def uncorrected_delays(conditions: Mapping[str, str]) -> list[str]:
    """Return what a user must know if significant delays are not corrected."""
    delays = significant_delays(conditions).items()
    return [f"not corrected: {delay_words(kind, late)}" for kind, late in delays]


def delay_words(kind: str, delay: Measured) -> str:
    """Return a clause about a delay, s; without U if its sd is 0.

    >>> delay_words("w", Measured(-0.79417, 8e-5))
    "the gyros' samples are 794.17 ± 0.16 ms (k = 2) earlier than the accelerometers'"
    """
    size = format_quantity(abs(delay.value), COVERAGE * delay.sd, "ms", _DIGITS)
    size += f" (k = {COVERAGE:g})" * (delay.sd > 0)
    order = "later" if delay.value > 0 else "earlier"
    others = "accelerometers" if kind == "w" else "other sensors"
    return f"the {QUANTITIES[kind].sensors}' samples are {size} {order} than the {others}'"


def _name(kind: str) -> str:
    return f"delay of the {QUANTITIES[kind].sensors}"
