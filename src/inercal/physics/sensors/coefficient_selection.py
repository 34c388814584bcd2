"""Select coefficients by full name, short name or group, and describe them in words.

The words are such as "g-sensitivity of the x gyro along P (gx.g_p)".
"""

import re
from collections.abc import Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import TYPE_CHECKING

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors.axis import Axis
from inercal.physics.sensors.coefficient_tables import TABLES, TERMS

if TYPE_CHECKING:
    from inercal.physics.sensors.sensor import Sensor


def select_coefficients(axes: Sequence[Axis], chosen: Sequence[str]) -> tuple[str, ...]:
    """Return the full names of the selected coefficients, axis by axis in table order.

    Parameters
    ----------
    axes : sequence of Axis
    chosen : sequence of str
        `"k0"`, `"x.k0"`, a group (`"bias"`, `"misalignment"`, …) or `"x.misalignment"`.

    Raises
    ------
    InputError
        A word matches no coefficient of these axes; the message lists the known names.
    """
    return _select_coefficients(tuple(axes), tuple(chosen))


@lru_cache(maxsize=256)
def _select_coefficients(axes: tuple[Axis, ...], chosen: tuple[str, ...]) -> tuple[str, ...]:
    picked: set[str] = set()
    for word in chosen:
        axis_name, short = CoefficientName(word).parts
        matching = {
            CoefficientName.of(axis.name, c)
            for k, axis in enumerate(axes)
            if word == short or axis.name == axis_name
            for c in _expand_word(axes, k, short)
        }
        if not matching:
            raise _unknown_word_error(axes, word)
        picked |= matching
    return tuple(
        full
        for axis in axes
        for c in TABLES[axis.measures]
        if (full := CoefficientName.of(axis.name, c.name)) in picked
    )


def _expand_word(axes: Sequence[Axis], k: int, word: str) -> list[str]:
    """Return the short names that `word` selects on axis k."""
    table = TABLES[axes[k].measures]
    if word == "nonorthogonality":
        return _nonorthogonality(axes, k)
    return [c.name for c in table if word in (c.name, c.group)]


def _nonorthogonality(axes: Sequence[Axis], k: int) -> list[str]:
    """Return the misalignments of axis k towards the preceding axes of its kind.

    With only these, the matrix of a triad is lower triangular. The frame is then the sensor's own
    (x along the first input axis, y in the plane of the first two), without mounting angles.
    """
    _, pendulous, output = axes[k].frame
    earlier = [a.frame[0] for a in axes[:k] if a.measures == axes[k].measures]

    def is_earlier(direction: Array) -> bool:
        return any(abs(abs(direction @ e) - 1) < 1e-9 for e in earlier)

    toward = {"delta_o": pendulous, "delta_p": output}
    return [name for name, direction in toward.items() if is_earlier(direction)]


def _alike(word: str) -> str:
    """Return a word with digits instead of the letters that look like them: k0 for ko."""
    return word.lower().translate(str.maketrans("oli", "011"))


def _unknown_word_error(axes: Sequence[Axis], word: str) -> InputError:
    lines = [c for axis in axes for c in TABLES[axis.measures]]
    short = sorted({c.name for c in lines})
    triad = word != "nonorthogonality"  # other clusters do not have this group
    groups = [*dict.fromkeys(c.group for c in lines), *["nonorthogonality"] * triad]
    axis, term = CoefficientName(word).parts
    words = dict.fromkeys([*short, *groups])
    near = [one for one in words if _alike(one) == _alike(term)]
    near = near or get_close_matches(term.lower(), words, n=2)
    near = near or [one for one in words if term.startswith(f"{one}_")]
    if word == "auto":
        advice = 'write also = "auto", without a list and without other words'
    elif axis and axis not in {one.name for one in axes}:
        advice = f"the axes are {', '.join(one.name for one in axes)}"
    elif near and near[0] != term:
        advice = f"did you mean {' or '.join(near)}?"
    else:
        advice = f"coefficients: {', '.join(short)}; groups: {', '.join(groups)}"
    return InputError(f"no coefficient or group {word!r}; {advice}", names=(word,))


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


def axis_words(sensor: "Sensor", name: str) -> str:
    """Describe an axis in words: "the x gyro", "accelerometer b"."""
    kind = QUANTITIES[sensor.measures[name]].sensor
    letter = _TRIAD_NAME.fullmatch(name)
    return f"the {letter[1]} {kind}" if letter else f"{kind} {name}"


def coefficient_words(sensor: "Sensor", word: str, components: Sequence[str] = ()) -> str:
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
