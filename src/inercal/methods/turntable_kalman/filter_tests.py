"""Tests of both filters' models: innovations by step, and scores of constants without a state."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate import ModelTest, ScoreTestSet, score_tests
from inercal.estimate.innovations import (
    epoch_groups,
    group_innovations,
    mean_and_whiteness_tests,
    standardised_innovations,
)
from inercal.estimate.kalman import FilterSteps
from inercal.estimate.omitted_constants import OmittedSums, omitted_constant_sums
from inercal.estimate.scores import rows_from_products
from inercal.methods import temperature
from inercal.methods.turntable import score_columns as columns
from inercal.methods.turntable.score_columns import ColumnInputs, ConstantColumn, ConstantColumns
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.filter import TILT, FilterEstimate
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recording import Observations, Track

_TIME_PARAMETERS = ("latency", "clock")
_MAX_LATENCY_DEVIATION = 3.0  # standard deviations of the latency as stated


class InnovationTestData(NamedTuple):
    """The data for the tests of one filter's innovations."""

    name: str
    time: Array  # (e,) s
    standardised_innovations: Array  # (e, m), over their standard deviations; NaN where none
    states: tuple[str, ...]
    columns: tuple[ConstantColumn, ...]
    sums: OmittedSums | None  # of the columns


def innovation_test_data(
    made: GyroFilter | AccelerometerFilter,
    found: FilterEstimate,
    track: Track,
    time: Array,
    steps: FilterSteps,
) -> InnovationTestData:
    """Return the data for the tests of a filter.

    Parameters
    ----------
    made : GyroFilter or AccelerometerFilter
    found : FilterEstimate
        At the end of the run.
    track : Track
    time : (e,) array
        s, of its epochs.
    steps : FilterSteps
        Of them all.
    """
    theta = found.value[: len(made.initial_values)]
    # Driving constants act on gyros from the start of the run.
    whole = np.concatenate([track.time[:1], time]) if isinstance(made, GyroFilter) else time
    warmth = temperature.offsets_at_times(track, made.triad.sensor, whole)
    at = ColumnInputs(made.triad, made.bench, theta, whole, _angles(track, whole), warmth)
    phi = made.states.index(TILT[0])
    if isinstance(made, GyroFilter):
        some, _ = columns.gyro_columns(at)
        sums = omitted_constant_sums(
            steps,
            _initial_sensitivity(made, some),
            some.driving_effects,
            phi,
            some.observed_effects,
            0,
        )
        sums = _sums_for_time_states(
            made, found, some.columns, _sums_for_mean_biases(made, track, time, sums)
        )
    else:
        some = columns.accelerometer_columns(at)
        start = _initial_sensitivity(made, some)
        seen = some.observed_effects[:, : steps.s.shape[1] - phi]
        sums = omitted_constant_sums(
            steps, start, some.driving_effects, 0, seen, phi, made.tested_components
        )
        sums = _sums_for_mean_biases(made, track, time, sums)
    standard = standardised_innovations(steps.off, steps.s)[:, : made.tested_components]
    return InnovationTestData(made.name, time, standard, made.states, some.columns, sums)


def _sums_for_mean_biases(
    made: GyroFilter | AccelerometerFilter, track: Track, time: Array, sums: OmittedSums
) -> OmittedSums:
    """Return the sums with biases as means over the run, as they are estimated."""
    if not (made.triad.drift.mean_over_run and time.size):
        return sums
    end = float(track.time[-1])
    by, _ = made.mean_bias_transform(end - float(track.time[0]), end - float(time[-1]))
    return sums._replace(moved=sums.moved + by @ sums.moved)


def _initial_sensitivity(made: GyroFilter | AccelerometerFilter, some: ConstantColumns) -> Array:
    """Return U of the columns at the start, (n, c); columns that are states act by the state."""
    known, c = [one.name for one in made.table], len(some.driving_columns)
    start = np.zeros((len(made.states), len(some.columns)))
    for k, one in enumerate(some.columns):
        if one.name in known:
            start[made.states.index(one.name), k] = 1.0
            acting, at = (some.driving_effects, k) if k < c else (some.observed_effects, k - c)
            acting[..., at] = 0.0
    return start


def _sums_for_time_states(
    made: GyroFilter, found: FilterEstimate, some: tuple[ConstantColumn, ...], sums: OmittedSums
) -> OmittedSums:
    """Return the sums with those of latency and clock, where they are states, from their estimates.

    The recursion is of first order, but an uncertain delay is not, until it is estimated. For a
    constant with the prior N(μ, P₀) and the estimate x̂ of variance P the sums are known::

        G = (P₀ − P)/P₀²        b = (x̂ − μ)/P₀        −U = −P e/P₀

    The products with other columns are set to zero: the sums contain only the one combination of
    innovations that determines the delay.
    """
    gram, product, moved = (one.copy() for one in sums)
    names = [one.name for one in some]
    first = len(made.states) - len(found.value)
    for one in made.table:
        if one.name not in _TIME_PARAMETERS:
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
        if product[late] ** 2 > _MAX_LATENCY_DEVIATION**2 * gram[late, late]:
            # After a delay far from its stated value the data do not test the clock.
            gram[k], gram[:, k], product[k] = 0.0, 0.0, 0.0
    return OmittedSums(gram, product, moved)


def _angles(track: Track, time: Array) -> Array:
    """Return the readback at some times, (e, k)."""
    axes: list[Array] = [np.interp(time, track.time, axis) for axis in track.angles.T]
    return np.stack(axes, axis=-1)


def innovation_tests(one: InnovationTestData, observations: Observations) -> tuple[ModelTest, ...]:
    """Return the tests of one filter's innovations by step of the run."""
    group = epoch_groups(one.time, observations.time, observations.duration)
    z = group_innovations(one.standardised_innovations[:, :3], group)
    return mean_and_whiteness_tests(
        z,
        f"mean innovations of the {one.name} in each step",
        f"correlation of the {one.name}' innovations between steps",
    )


def score_omissions(
    parts: Sequence[InnovationTestData], names: Sequence[str], owners: Sequence[Sequence[str]]
) -> ScoreTestSet:
    """Return the scores of constants without a state, by both filters together.

    Parameters
    ----------
    parts : sequence of InnovationTestData
    names : sequence of q str
        The parameters whose shift is wanted.
    owners : sequence of sequence of str
        Which of them each filter estimates.
    """
    found: dict[str, ConstantColumn] = {}
    for one in parts:
        found |= {column.name: column for column in one.columns}
    at = {key: k for k, key in enumerate(found)}
    gram, product = np.zeros((len(at), len(at))), np.zeros(len(at))
    moved = np.zeros((len(names), len(at)))
    for one, own in zip(parts, owners, strict=True):
        if one.sums is None:
            return ScoreTestSet()
        to = [at[column.name] for column in one.columns]
        gram[np.ix_(to, to)] += one.sums.gram
        product[to] += one.sums.product
        rows = [names.index(name) for name in own]
        states = [one.states.index(name) for name in own]
        moved[np.ix_(rows, to)] = one.sums.moved[states]
    residual, rows = rows_from_products(gram, product)
    result = columns.candidates(tuple(found.values()), rows, moved)
    standard = np.concatenate([one.standardised_innovations.ravel() for one in parts])
    standard = standard[np.isfinite(standard)]
    tested = score_tests(residual, np.zeros((len(residual), 0)), result)
    return replace(tested, chi2=float(standard @ standard), dof=standard.size)
