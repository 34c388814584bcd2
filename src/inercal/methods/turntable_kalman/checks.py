"""Tests of what both filters assume: innovations by step, and scores of what has no state."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.estimate import Scored, Test, scored
from inercal.estimate.innovations import grouped, means_and_whiteness, standardised
from inercal.estimate.kalman import Steps
from inercal.estimate.left_out import LeftOut, left_out
from inercal.estimate.scores import UNSCORED, compressed
from inercal.methods.turntable import left_out as columns
from inercal.methods.turntable.left_out import Column
from inercal.methods.turntable_kalman import ways
from inercal.methods.turntable_kalman.accelerometers import Accelerometers
from inercal.methods.turntable_kalman.common import TILT
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.recording import Observations, Track

Array = NDArray[np.float64]


class Checked(NamedTuple):
    """What one filter's innovations are tested by."""

    name: str
    time: Array  # (e,) s
    standard: Array  # (e, m), innovations over their standard deviations; NaN where none
    states: tuple[str, ...]
    columns: tuple[Column, ...]
    sums: LeftOut | None  # of the columns


def of_gyros(made: Gyros, theta: Array, track: Track, time: Array, steps: Steps) -> Checked:
    """Return what tests of the gyros' filter need.

    Parameters
    ----------
    made : Gyros
    theta : (p,) array
        The coefficients that it has found.
    track : Track
    time : (e,) array
        s, of its epochs.
    steps : Steps
        Of them all.
    """
    whole = np.concatenate([track.time[:1], time])
    found, _ = columns.of_gyros(made.part, made.bench, theta, whole, _angles(track, whole))
    sums = left_out(steps, found.driven, made.states.index(TILT[0]), found.seen, 0)
    return _checked("gyros", made, time, steps, found.all, sums)


def of_accelerometers(
    made: Accelerometers, theta: Array, track: Track, time: Array, steps: Steps
) -> Checked:
    """Return what tests of the accelerometers' filter need; arguments as of `of_gyros`."""
    found = columns.of_accelerometers(made.part, made.bench, theta, time, _angles(track, time))
    seen = found.seen[:, : steps.s.shape[1] - 3]
    sums = left_out(steps, found.driven, 0, seen, 3, ways.observed(made))
    return _checked("accelerometers", made, time, steps, found.all, sums)


def _checked(
    name: str,
    made: Gyros | Accelerometers,
    time: Array,
    steps: Steps,
    found: tuple[Column, ...],
    sums: LeftOut,
) -> Checked:
    standard = standardised(steps.off, steps.s)[:, : ways.observed(made)]
    return Checked(name, time, standard, made.states, found, sums)


def _angles(track: Track, time: Array) -> Array:
    """Return the readback at some times, (e, k)."""
    axes: list[Array] = [np.interp(time, track.time, axis) for axis in track.angles.T]
    return np.stack(axes, axis=-1)


def tests(one: Checked, observations: Observations) -> tuple[Test, ...]:
    """Return the tests of one filter's innovations: by step, and of slow changes of its biases."""
    group = np.full(one.time.size, -1)
    spans = zip(observations.time, observations.duration, strict=True)
    for number, (middle, seconds) in enumerate(spans):
        group[np.abs(one.time - middle) <= seconds / 2] = number
    z = grouped(one.standard[:, :3], group)
    made = means_and_whiteness(
        z,
        f"mean innovations of the {one.name} in each step",
        f"correlation of the {one.name}' innovations between steps",
    )
    slow = [k for k, column in enumerate(one.columns) if not column.families]
    if one.sums is None or not slow:
        return made
    residual, _ = compressed(one.sums.gram[np.ix_(slow, slow)], one.sums.product[slow])
    name = f"slow changes of the {one.name}' biases"
    return (*made, Test(name, float(residual @ residual), len(residual)))


def scores(
    parts: Sequence[Checked], names: Sequence[str], owners: Sequence[Sequence[str]]
) -> Scored:
    """Return the scores of what the filters leave out, by both of them together.

    Parameters
    ----------
    parts : sequence of Checked
    names : sequence of q str
        The parameters whose shift is wanted.
    owners : sequence of sequence of str
        Which of them each filter estimates.
    """
    found: dict[str, Column] = {}
    for one in parts:
        found |= {column.name + column.kind: column for column in one.columns if column.families}
    at = {key: k for k, key in enumerate(found)}
    gram, product = np.zeros((len(at), len(at))), np.zeros(len(at))
    moved = np.zeros((len(names), len(at)))
    for one, own in zip(parts, owners, strict=True):
        if one.sums is None:
            return UNSCORED
        kept = [k for k, column in enumerate(one.columns) if column.families]
        to = [at[one.columns[k].name + one.columns[k].kind] for k in kept]
        gram[np.ix_(to, to)] += one.sums.gram[np.ix_(kept, kept)]
        product[to] += one.sums.product[kept]
        rows = [names.index(name) for name in own]
        states = [one.states.index(name) for name in own]
        moved[np.ix_(rows, to)] = one.sums.moved[np.ix_(states, kept)]
    residual, rows = compressed(gram, product)
    made = columns.candidates(tuple(found.values()), rows, moved)
    return scored(residual, np.zeros((len(residual), 0)), made)
