"""Describe coefficients in words: "g-sensitivity of the x gyro along P (gx.g_p)"."""

import re
from collections.abc import Sequence

from inercal.basics.keys import CoefficientName
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors.coefficient_tables import TERMS
from inercal.physics.sensors.sensor import Sensor

_GROUPS = {
    "bias": "bias",
    "scale": "scale-factor error",
    "misalignment": "misalignment",
    "nonlinearity": "nonlinearity",
    "asymmetry": "asymmetry",
    "cross": "cross-axis nonlinearity",
    "rotation": "sensitivity to rotation",
    "arm": "lever arm",
    "temperature": "sensitivity to temperature",
    "temperature_order": "nonlinear sensitivity to temperature",
    "temperature_rate": "sensitivity to the rate of the temperature",
    "g": "sensitivity to acceleration",
    "g2": "sensitivity to the square of the acceleration",
}
GROUP_WORDS = {
    "scale": "scale factor",
    "cross": "cross-axis",
    "g": "g-sensitivity",
    "g2": "g²-sensitivity",
    "arm": "lever arm",
}
"""Short words for groups whose name in a run file is not a plain word."""
_OF_AXIS = re.compile(r"(?= about | along | against | to |, )")
_TRIAD_NAME = re.compile(r"[agwm]?([xyz])")


def axis_words(sensor: Sensor, name: str) -> str:
    """Describe an axis in words: "the x gyro", "accelerometer b"."""
    kind = QUANTITIES[sensor.measures[name]].sensor
    letter = _TRIAD_NAME.fullmatch(name)
    return f"the {letter[1]} {kind}" if letter else f"{kind} {name}"


def coefficient_words(sensor: Sensor, word: str, components: Sequence[str] = ()) -> str:
    """Return the meaning of a coefficient's key in words, followed by the key in brackets.

    Parameters
    ----------
    sensor : Sensor
        The sensor that has the axes; the coefficients need not be estimated.
    word : str
        A full name, a term, or a group for several axes: "gx.g_p", "k2", "g".
    components : sequence of str
        Full names of the coefficients that the word stands for; by default the word itself.
    """
    names = [CoefficientName(one) for one in components or (word,)]
    axes = dict.fromkeys(one.axis for one in names)
    tables = [TERMS[sensor.measures[one.axis]] for one in names]
    lines = [known[one.term] for one, known in zip(names, tables, strict=True) if one.term in known]
    term = CoefficientName(word).term
    meanings = dict.fromkeys(line.meaning for line in lines)
    if term in _GROUPS and any(line.name != term for line in lines):
        meanings = {_GROUPS[term]: None}
    meaning = " and ".join(meanings)
    if len(axes) == 1 and (CoefficientName(word).axis or len(sensor.axes) == 1):
        whose = axis_words(sensor, next(iter(axes)))
    else:
        kinds = dict.fromkeys(QUANTITIES[sensor.measures[axis]].sensors for axis in axes)
        whose = f"the {' and '.join(kinds)}"
    what, *rest = _OF_AXIS.split(meaning, maxsplit=1)
    return f"{what} of {whose}{''.join(rest)} ({word})"


__all__ = ["GROUP_WORDS", "axis_words", "coefficient_words"]
