"""Select coefficients by full name, short name or group."""

from collections.abc import Sequence
from difflib import get_close_matches
from functools import lru_cache

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.physics.sensors.axis import Axis
from inercal.physics.sensors.coefficient_tables import TABLES


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


def _unknown_word_error(axes: Sequence[Axis], word: str) -> InputError:
    lines = [c for axis in axes for c in TABLES[axis.measures]]
    short = sorted({c.name for c in lines})
    triad = word != "nonorthogonality"  # other clusters do not have this group
    groups = [*dict.fromkeys(c.group for c in lines), *["nonorthogonality"] * triad]
    axis, term = CoefficientName(word).parts
    near = get_close_matches(term, dict.fromkeys([*short, *groups]), n=2)
    if word == "auto":
        advice = 'write also = "auto", without a list and without other words'
    elif axis and axis not in {one.name for one in axes}:
        advice = f"the axes are {', '.join(one.name for one in axes)}"
    elif near and near[0] != term:
        advice = f"did you mean {' or '.join(near)}?"
    else:
        advice = f"coefficients: {', '.join(short)}; groups: {', '.join(groups)}"
    return InputError(f"no coefficient or group {word!r}; {advice}", names=(word,))
