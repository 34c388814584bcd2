"""What both filters hand to their kernels, and read from them."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Course, Smoothed
from inercal.estimate.kalman import Steps, smoothed, steps
from inercal.methods.turntable.model import Triad, earth
from inercal.methods.turntable.terms import BIAS
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
        part.terms, part.white, part.drift, part.drift.size, earth(bench), bench.gravity.value
    )


def drift_of(part: Triad) -> tuple[str, ...]:
    """Return the names of the states of the biases' drift."""
    return part.drift.names([axis.name for axis in part.sensor.axes])


def drifting_of(part: Triad) -> tuple[str, ...]:
    """Return the names of the biases' drift as it is drawn, one an axis; none without drift."""
    return tuple(f"drift[{axis.name}]" for axis in part.sensor.axes) if part.drift.varies else ()


def room(
    part: Triad, states: tuple[str, ...], smooth: Sequence[str], epochs: int, k: int, m: int
) -> Steps:
    """Return room for what a kernel does at each epoch, for the way back of what `varying` has."""
    wanted = np.zeros((len(smooth), len(states)))
    for row, name in zip(wanted, smooth, strict=True):
        if name in states:
            row[states.index(name)] = 1.0
        else:
            _bias_of(part, states, name, row)
    return steps(epochs, len(states), k, m, wanted)


def _bias_of(part: Triad, states: tuple[str, ...], name: str, row: Array) -> None:
    """Write how a bias, its constant and the components of its drift, depends on the states."""
    i = [axis.name for axis in part.sensor.axes].index(name[len("drift[") : -1])
    first = states.index(drift_of(part)[0])
    row[first + i + 3 * np.arange(len(part.drift.times))] = 1.0
    for m in np.flatnonzero(part.terms.bias & (part.terms.axis == i)):
        row[states.index(part.sensor.coefficients[m])] = part.terms.weights[m, BIAS]


def averaging(
    part: Triad, states: Sequence[str], elapsed: float, since: float = 0.0
) -> tuple[Array, Array]:
    """Return how biases as means over the run depend on the states, and what varies them further.

    Parameters
    ----------
    part : Triad
    states : sequence of n str
        With the coefficients and the drift among them.
    elapsed, since : float
        As of `Drift.mean`.

    Returns
    -------
    by : (n, n) array
        What each state adds to each coefficient beyond itself.
    variance : (n,) array
        Of what the drift did since the states were predicted.
    """
    by, variance = np.zeros((len(states), len(states))), np.zeros(len(states))
    first, p = states.index(drift_of(part)[0]), len(part.sensor.coefficients)
    rows, beyond = part.drift.mean(elapsed, since)
    for m in np.flatnonzero(part.terms.bias):
        i, weight = part.terms.axis[m], part.terms.weights[m, BIAS]
        at = first - p + m
        by[at, first : first + part.drift.size] = rows[i] / weight
        variance[at] = beyond[i] / weight**2
    return by, variance


def course(
    part: Triad,
    name: str,
    states: tuple[str, ...],
    smooth: Sequence[str],
    time: Array,
    history: Array,
    made: Steps,
    state: S,
) -> Course:
    """Return the course of what a kernel wrote, (e, m + 1 + 2 n), and its way back.

    The first k states, φ among them, are in the latter alone. Of flicker a bias is the mean so far,
    as the result is; its drift in the way back is its departure from the mean of all epochs.
    """
    (_, k, n), m = made.a.shape, made.s.shape[1]
    value, variance = history[:, m + 1 : m + 1 + n], history[:, m + 1 + n :]
    found = None
    if smooth:
        found = _back(part, states, smooth, time - float(state.time[2]), value, made, state.p)
    return Course(
        name, states[k:], time, value[:, k:], np.sqrt(variance[:, k:]),
        history[:, :m], history[:, m], found,
    )  # fmt: skip


def _back(
    part: Triad,
    states: tuple[str, ...],
    smooth: Sequence[str],
    elapsed: Array,
    value: Array,
    made: Steps,
    p: Array,
) -> Smoothed:
    """Return the way back of a filter that came to a covariance p, some s after its start."""
    value, against = value.copy(), np.zeros(made.wanted.shape)
    if part.drift.averaged and elapsed.size:
        first = states.index(drift_of(part)[0])
        mean = part.drift.so_far(value[:, first : first + part.drift.size], elapsed)
        for m in np.flatnonzero(part.terms.bias):
            at = states.index(part.sensor.coefficients[m])
            value[:, at] -= mean[:, part.terms.axis[m]] / part.terms.weights[m, BIAS]
        whole = np.eye(len(states)) + averaging(part, states, float(elapsed[-1]))[0]
        for row, weights, name in zip(against, made.wanted, smooth, strict=True):
            if name.startswith("drift["):
                constants = weights * [state in part.sensor.coefficients for state in states]
                row[:] = constants @ whole
    added, spread = smoothed(made, against, p)
    # What is known exactly is the difference of equal variances: rounding may leave it below 0.
    std = np.sqrt(np.maximum(spread, 0.0))
    last = against @ value[-1] if elapsed.size else 0.0
    return Smoothed(tuple(smooth), value @ made.wanted.T + added - last, std)
