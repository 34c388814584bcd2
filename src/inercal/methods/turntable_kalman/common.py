"""What both filters hand to their kernels, and read from them."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable import Turntable
from inercal.estimate import Course, Smoothed
from inercal.estimate.kalman import Steps, smoothed, steps
from inercal.methods.turntable.model import Triad, earth
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman._common import Model

Array = NDArray[np.float64]
_NUMBERS = ("nis", "epochs")  # of a state; all else is an array
S = TypeVar("S", _accelerometers.State, _readback.State)
TILT = ("phi_e", "phi_n", "phi_u")
"""φ: how far the attitude that a filter went by is off, about east, north and up."""


def copied(state: S) -> S:
    """Return a state of its own, which a kernel may change in place."""
    arrays: dict[str, Array] = {k: v for k, v in state._asdict().items() if k not in _NUMBERS}
    return state._replace(**{name: array.copy() for name, array in arrays.items()})


def known(part: Triad, bench: Turntable) -> Model:
    """Return what a kernel knows of a triad, and of where it is."""
    return Model(
        part.terms, part.white, part.drift, part.correlation, earth(bench), bench.gravity.value
    )


def drift_of(part: Triad) -> tuple[str, ...]:
    """Return the names of the drift of each bias."""
    return tuple(f"drift[{axis.name}]" for axis in part.sensor.axes)


def drifting_of(part: Triad) -> tuple[str, ...]:
    """Return the same, or none where biases do not drift."""
    return drift_of(part) if part.drift.any() else ()


def room(states: tuple[str, ...], smooth: Sequence[str], epochs: int, k: int, m: int) -> Steps:
    """Return room for what a kernel does at each epoch, for the way back of some states."""
    wanted = np.array([states.index(name) for name in smooth], dtype=np.int64)
    return steps(epochs, len(states), k, m, wanted)


def course(
    name: str,
    states: tuple[str, ...],
    smooth: Sequence[str],
    time: Array,
    history: Array,
    made: Steps,
) -> Course:
    """Return the course of what a kernel wrote, (e, m + 1 + 2 n), and its way back.

    The first k states, φ among them, are in the latter alone.
    """
    (_, k, n), m = made.a.shape, made.s.shape[1]
    value, variance = history[:, m + 1 : m + 1 + n], history[:, m + 1 + n :]
    found = None
    if smooth:
        added, spread = smoothed(made)
        # What is known exactly is the difference of equal variances: rounding may leave it below 0.
        std = np.sqrt(np.maximum(spread, 0.0))
        found = Smoothed(tuple(smooth), value[:, made.wanted] + added, std)
    return Course(
        name, states[k:], time, value[:, k:], np.sqrt(variance[:, k:]),
        history[:, :m], history[:, m], found,
    )  # fmt: skip
