"""Tests of what both filters assume: innovations by step, and scores of what has no state."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate import Scored, Test, scored
from inercal.estimate.innovations import grouped, means_and_whiteness, standardised
from inercal.estimate.kalman import Steps
from inercal.estimate.left_out import LeftOut, left_out
from inercal.estimate.scores import compressed
from inercal.methods import temperature
from inercal.methods.turntable import left_out as columns
from inercal.methods.turntable.left_out import Column, Columns, Epochs
from inercal.methods.turntable_kalman.accelerometers import Accelerometers
from inercal.methods.turntable_kalman.filter import TILT, Found
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.recording import Observations, Track

_TIMES = ("latency", "clock")
_FAR = 3.0  # standard deviations of the latency as stated


class Checked(NamedTuple):
    """What one filter's innovations are tested by."""

    name: str
    time: Array  # (e,) s
    standard: Array  # (e, m), innovations over their standard deviations; NaN where none
    states: tuple[str, ...]
    columns: tuple[Column, ...]
    sums: LeftOut | None  # of the columns


def of_filter(
    made: Gyros | Accelerometers, found: Found, track: Track, time: Array, steps: Steps
) -> Checked:
    """Return what tests of a filter need.

    Parameters
    ----------
    made : Gyros or Accelerometers
    found : Found
        At the end of the run.
    track : Track
    time : (e,) array
        s, of its epochs.
    steps : Steps
        Of them all.
    """
    theta = found.value[: len(made.first)]
    # What drives gyros does so from the run's start on.
    whole = np.concatenate([track.time[:1], time]) if isinstance(made, Gyros) else time
    warmth = temperature.at(track, made.part.sensor, whole)
    at = Epochs(made.part, made.bench, theta, whole, _angles(track, whole), warmth)
    phi = made.states.index(TILT[0])
    if isinstance(made, Gyros):
        some, _ = columns.of_gyros(at)
        sums = left_out(steps, _start(made, some), some.driven, phi, some.seen, 0)
        sums = _timed(made, found, some.all, _averaged(made, track, time, sums))
    else:
        some = columns.of_accelerometers(at)
        start, seen = _start(made, some), some.seen[:, : steps.s.shape[1] - phi]
        sums = left_out(steps, start, some.driven, 0, seen, phi, made.observed)
        sums = _averaged(made, track, time, sums)
    standard = standardised(steps.off, steps.s)[:, : made.observed]
    return Checked(made.name, time, standard, made.states, some.all, sums)


def _averaged(made: Gyros | Accelerometers, track: Track, time: Array, sums: LeftOut) -> LeftOut:
    """Return the sums with biases as means over the run, as they are estimated."""
    if not (made.part.drift.averaged and time.size):
        return sums
    end = float(track.time[-1])
    by, _ = made.averaging(end - float(track.time[0]), end - float(time[-1]))
    return sums._replace(moved=sums.moved + by @ sums.moved)


def _start(made: Gyros | Accelerometers, some: Columns) -> Array:
    """Return U of the columns at the start, (n, c): those that are states act as these do."""
    known, c = [one.name for one in made.table], len(some.driving)
    start = np.zeros((len(made.states), len(some.all)))
    for k, one in enumerate(some.all):
        if one.name in known:
            start[made.states.index(one.name), k] = 1.0
            acting, at = (some.driven, k) if k < c else (some.seen, k - c)
            acting[..., at] = 0.0
    return start


def _timed(made: Gyros, found: Found, some: tuple[Column, ...], sums: LeftOut) -> LeftOut:
    """Return the sums with latency and clock, where they are states, scored by what they came to.

    A delay that is hardly known does not act in first order before it is found, as the recursion
    would have it. Of a constant with the prior N(μ, P₀) that comes to x̂ and P the sums are known::

        G = (P₀ − P)/P₀²        b = (x̂ − μ)/P₀        −U = −P e/P₀

    Nothing else is alike: they hold the one combination of innovations that finds the delay.
    """
    gram, product, moved = (one.copy() for one in sums)
    names = [one.name for one in some]
    first = len(made.states) - len(found.value)
    for one in made.table:
        if one.name not in _TIMES:
            continue
        k, at = names.index(one.name), made.states.index(one.name)
        before, after = one.sd**2, found.covariance[:, at - first]
        gram[k], gram[:, k] = 0.0, 0.0
        gram[k, k] = max(before - after[at - first], 0.0) / before**2
        product[k] = (found.value[at - first] - one.value) / before
        moved[:, k] = 0.0
        moved[first:, k] = -after / before
    known = [one.name for one in made.table]
    if "latency" in known and "clock" not in known:
        k, late = names.index("clock"), names.index("latency")
        if product[late] ** 2 > _FAR**2 * gram[late, late]:
            # About a delay that was far off, nothing is told of how it grows.
            gram[k], gram[:, k], product[k] = 0.0, 0.0, 0.0
    return LeftOut(gram, product, moved)


def _angles(track: Track, time: Array) -> Array:
    """Return the readback at some times, (e, k)."""
    axes: list[Array] = [np.interp(time, track.time, axis) for axis in track.angles.T]
    return np.stack(axes, axis=-1)


def tests(one: Checked, observations: Observations) -> tuple[Test, ...]:
    """Return the tests of one filter's innovations by step of the run."""
    group = np.full(one.time.size, -1)
    spans = zip(observations.time, observations.duration, strict=True)
    for number, (middle, seconds) in enumerate(spans):
        group[np.abs(one.time - middle) <= seconds / 2] = number
    z = grouped(one.standard[:, :3], group)
    return means_and_whiteness(
        z,
        f"mean innovations of the {one.name} in each step",
        f"correlation of the {one.name}' innovations between steps",
    )


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
        found |= {column.name: column for column in one.columns}
    at = {key: k for k, key in enumerate(found)}
    gram, product = np.zeros((len(at), len(at))), np.zeros(len(at))
    moved = np.zeros((len(names), len(at)))
    for one, own in zip(parts, owners, strict=True):
        if one.sums is None:
            return Scored()
        to = [at[column.name] for column in one.columns]
        gram[np.ix_(to, to)] += one.sums.gram
        product[to] += one.sums.product
        rows = [names.index(name) for name in own]
        states = [one.states.index(name) for name in own]
        moved[np.ix_(rows, to)] = one.sums.moved[states]
    residual, rows = compressed(gram, product)
    made = columns.candidates(tuple(found.values()), rows, moved)
    standard = np.concatenate([one.standard.ravel() for one in parts])
    standard = standard[np.isfinite(standard)]
    tested = scored(residual, np.zeros((len(residual), 0)), made)
    return replace(tested, chi2=float(standard @ standard), dof=standard.size)
