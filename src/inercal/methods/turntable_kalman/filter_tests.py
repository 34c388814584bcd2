"""Test both filters by the innovations in each step, and by score tests of omitted constants.

If R is the noise, the normalised innovations squared (NIS) follow χ². The degrees of freedom are
the number of components minus those that only determine initially unknown states (Bar-Shalom, Li
and Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, section 5.4). The
source's R is not the noise, so NIS computed with it is not a test.
"""

# SciPy has no type stubs.
# pyright: reportMissingTypeStubs=false
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from inercal.basics.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.estimation import FilterHistory, ModelTest, ResidualGroup, ScoreTestSet, score_tests
from inercal.estimation.candidate_scores import rows_from_products
from inercal.estimation.innovations import (
    StateEstimate,
    epoch_groups,
    group_innovations,
    mean_and_whiteness_tests,
    standardised_innovations,
)
from inercal.estimation.kalman import FilterSteps
from inercal.estimation.omitted_constants import OmittedSums, omitted_constant_sums
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import Priors, temperature
from inercal.methods.candidates import prior_column
from inercal.methods.turntable import score_columns as columns
from inercal.methods.turntable.model import TriadModel
from inercal.methods.turntable.score_columns import ColumnInputs, ConstantColumn, ConstantColumns
from inercal.methods.turntable_kalman._accelerometers import VelocityState
from inercal.methods.turntable_kalman._readback import AttitudeState
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.filter import TILT
from inercal.methods.turntable_kalman.filtered_track import FilteredTrack
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recordings import Observations

AnyFilter = GyroFilter | AccelerometerFilter
AnyTrack = FilteredTrack[AttitudeState] | FilteredTrack[VelocityState]
_CONFIDENCE_LEVEL = 0.95
# Relative to the expected NIS: noise is seldom known to 5 %, and a small overstatement is harmless
_MIN_NIS_RATIO = 0.9
_TIME_PARAMETERS = ("latency", "clock")
_MAX_LATENCY_DEVIATION = 3.0  # stated standard deviations of the latency


class InnovationTestData(NamedTuple):
    """The data for testing one filter's innovations."""

    name: str
    time: Array  # (e,) s
    standardised_innovations: Array  # (e, m), divided by their standard deviations; NaN if none
    states: tuple[str, ...]
    columns: tuple[ConstantColumn, ...]
    sums: OmittedSums | None  # of the columns


def innovation_test_data(
    made: AnyFilter, filtered: AnyTrack, found: StateEstimate, priors: Priors
) -> InnovationTestData:
    """Return the data for testing a filter; `found` is its estimate at the end of the run."""
    track, time = filtered.track, filtered.history.time
    theta = found.value[: len(made.initial_values)]
    # Driving constants act on gyros from the start of the run.
    whole = np.concatenate([track.time[:1], time]) if isinstance(made, GyroFilter) else time
    warmth = temperature.offsets_at_times(track, made.triad.sensor, whole)
    angles = track.angles[np.searchsorted(track.time, whole)]
    at = ColumnInputs(made.triad, made.bench, theta, whole, angles, warmth)
    standard = np.zeros((time.size, made.tested_components))
    phi, sums, names = made.states.index(TILT[0]), None, ()
    if time.size:
        gyros, first = isinstance(made, GyroFilter), _columns(made, at, 0, 1)
        of_priors, prior_start = _prior_columns(made, priors)
        names = first.columns + of_priors
        pieces = _pieces_with_columns(made, filtered, at, standard, len(of_priors))
        sums = omitted_constant_sums(
            pieces,
            np.concatenate([_initial_sensitivity(made, first), prior_start], axis=1),
            phi if gyros else 0,
            0 if gyros else phi,
            None if gyros else made.tested_components,
        )
        if made.triad.drift.mean_over_run:  # biases are estimated as means over the run
            end = float(track.time[-1])
            elapsed = end - float(track.time[0]), end - float(time[-1])
            by = made.mean_bias_transform(*elapsed)
            sums = sums._replace(moved=sums.moved + by @ sums.moved)
    if sums is not None and isinstance(made, GyroFilter):
        sums = _sums_for_time_states(made, found, names, sums)
    return InnovationTestData(made.name, time, standard, made.states, names, sums)


def _pieces_with_columns(
    made: AnyFilter, filtered: AnyTrack, at: ColumnInputs, standard: Array, further: int
) -> Iterator[tuple[FilterSteps, Array, Array]]:
    """Yield the steps and columns of each piece, and write the standardised innovations.

    The observations do not contain the `further` columns.
    """
    first = 0
    for piece in filtered.pieces():
        stop = first + piece.time.size
        if stop > first:
            steps = piece.steps
            some = _without_effects_of_states(made, _columns(made, at, first, stop))
            innovations = standardised_innovations(steps.off, steps.s)
            standard[first:stop] = innovations[:, : made.tested_components]
            seen = some.observed_effects
            if not isinstance(made, GyroFilter):
                seen = made.observed_directions(at.angles[first:stop]) @ seen[:, :2]
            yield steps, some.driving_effects, np.pad(seen, ((0, 0), (0, 0), (0, further)))
        first = stop


def _columns(made: AnyFilter, at: ColumnInputs, first: int, stop: int) -> ConstantColumns:
    if isinstance(made, GyroFilter):
        return columns.gyro_columns(at, first, stop)[0]
    return columns.accelerometer_columns(at, first, stop)


def _initial_sensitivity(made: AnyFilter, some: ConstantColumns) -> Array:
    """Return U for the columns at the start, (n, c); columns that are states act as states."""
    known = [one.name for one in made.table]
    start = np.zeros((len(made.states), len(some.columns)))
    for k, one in enumerate(some.columns):
        if one.name in known:
            start[made.states.index(one.name), k] = 1.0
    return start


def _prior_columns(made: AnyFilter, priors: Priors) -> tuple[tuple[ConstantColumn, ...], Array]:
    """Return the priors of the filter's coefficients as columns, and U at the start, (n, c).

    With the covariance P₀ before the data, a prior N(μ, S) that is wrong by δ has shifted the
    initial values by −P₀ S⁻¹ δ.
    """
    sensor = made.triad.sensor
    columns: list[ConstantColumn] = []
    starts = [np.zeros((len(made.states), 0))]
    first = made.states.index(sensor.coefficients[0])
    for prior in priors:
        if not set(prior.names) <= set(sensor.coefficients):
            continue
        root, _ = prior.rows(sensor.coefficients)
        start = np.zeros((len(made.states), len(prior.names)))
        at = [sensor.coefficients.index(name) for name in prior.names]
        start[first : first + len(made.prior)] = (made.prior @ root.T @ root)[:, at]
        starts.append(start)
        for full, sd in zip(prior.names, np.sqrt(np.diagonal(prior.covariance)), strict=True):
            name, unit, _, largest, _ = prior_column(sensor, full, sd, np.zeros(0))
            columns.append(ConstantColumn(name, "bench", unit, largest or 0.0, (name,)))
    return tuple(columns), np.concatenate(starts, axis=1)


def _without_effects_of_states(made: AnyFilter, some: ConstantColumns) -> ConstantColumns:
    """Return the columns, with zero effects for columns that already act as a state."""
    known = [one.name for one in made.table]
    driving = np.array([one.name not in known for one in some.driving_columns])
    observed = np.array([one.name not in known for one in some.observed_columns])
    return replace(
        some,
        driving_effects=np.where(driving, some.driving_effects, 0.0),
        observed_effects=np.where(observed, some.observed_effects, 0.0),
    )


def _sums_for_time_states(
    made: GyroFilter, found: StateEstimate, some: tuple[ConstantColumn, ...], sums: OmittedSums
) -> OmittedSums:
    """Return the sums; those for latency and clock states are computed from their estimates.

    The recursion is of first order, which does not suffice for an uncertain delay until the delay
    is estimated. For a constant with the prior N(μ, P₀) and the estimate x̂ with variance P the
    sums are known::

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
            # If the delay is far from its stated value, the data do not test the clock.
            gram[k], gram[:, k], product[k] = 0.0, 0.0, 0.0
    return OmittedSums(gram, product, moved)


def innovation_tests(one: InnovationTestData, observations: Observations) -> tuple[ModelTest, ...]:
    """Return the tests of one filter's innovations for each step of the run."""
    group = epoch_groups(one.time, observations.time, observations.duration)
    z = group_innovations(one.standardised_innovations[:, :3], group)
    return mean_and_whiteness_tests(
        z,
        f"mean innovations of the {one.name} in each step",
        f"correlation of the {one.name}' innovations between steps",
    )


def score_omissions(
    parts: Sequence[InnovationTestData],
    bench: Turntable,
    names: Sequence[str],
    owners: Sequence[Sequence[str]],
) -> ScoreTestSet:
    """Return score tests of constants without a state, from both filters together.

    Parameters
    ----------
    parts : sequence of InnovationTestData
    bench : Turntable
    names : sequence of q str
        The parameters whose shift is requested.
    owners : sequence of sequence of str
        Parameters that each filter estimates.
    """
    found: dict[str, ConstantColumn] = {}
    for one in parts:
        found |= {column.name: column for column in one.columns}
    at = {key: k for k, key in enumerate(found)}
    moved = np.zeros((len(names), len(at)))
    each: list[tuple[Array, Array]] = []
    for one, own in zip(parts, owners, strict=True):
        if one.sums is None:
            return ScoreTestSet()
        to = [at[column.name] for column in one.columns]
        each.append((np.zeros((len(at), len(at))), np.zeros(len(at))))
        each[-1][0][np.ix_(to, to)] = one.sums.gram
        each[-1][1][to] = one.sums.product
        rows = [names.index(name) for name in own]
        states = [one.states.index(name) for name in own]
        moved[np.ix_(rows, to)] = one.sums.moved[states]
    declared = bench.acting_parameters()
    shared = [name for name in at if name in declared and all(name in one.states for one in parts)]
    prior = bench.qualified.joint_covariance([declared[name] for name in shared])
    gram, product = _joint_sums(each, [at[name] for name in shared], prior)
    residual, rows = rows_from_products(gram, product)
    result = columns.candidates(tuple(found.values()), rows, moved)
    standard = np.concatenate([one.standardised_innovations.ravel() for one in parts])
    standard = standard[np.isfinite(standard)]
    tested = score_tests(residual, np.zeros((len(residual), 0)), result)
    return replace(tested, chi2=float(standard @ standard), dof=standard.size)


def _joint_sums(
    each: Sequence[tuple[Array, Array]], shared: Sequence[int], prior: Array
) -> tuple[Array, Array]:
    """Return CᵀV⁻¹C and CᵀV⁻¹r for the columns C and the innovations r of both filters.

    If a table error with the prior covariance P₀ is a state of both filters, it affects the
    innovations of both filters. Their joint covariance is V = I + W M Wᵀ, where W = diag(A₁, A₂)
    contains the error's columns in each filter and M = [[0, P₀], [P₀, 0]]. By Woodbury's identity
    the sums with V⁻¹ follow from those for each filter::

        CᵀV⁻¹C = CᵀC − CᵀW (M⁻¹ + WᵀW)⁻¹ WᵀC

    Parameters
    ----------
    each : sequence of (gram, product)
        (c, c) and (c,) for each filter.
    shared : sequence of q int
        Columns that are states of both filters.
    prior : (q, q) array
        Covariance P₀.
    """
    gram, product = (np.sum([one[k] for one in each], axis=0) for k in range(2))
    q = len(shared)
    if len(each) < 2 or not q:
        return gram, product
    inner = np.zeros((2 * q, 2 * q))
    inner[:q, q:] = inner[q:, :q] = np.linalg.inv(prior)
    for k, (own, _) in enumerate(each):
        inner[k * q : (k + 1) * q, k * q : (k + 1) * q] = own[np.ix_(shared, shared)]
    across = np.concatenate([own[:, shared] for own, _ in each], axis=1)
    along = np.concatenate([own[shared] for _, own in each])
    gram = gram - across @ np.linalg.solve(inner, across.T)
    return (gram + gram.T) / 2, product - across @ np.linalg.solve(inner, along)


class FilterResult(NamedTuple):
    """The result of one filter for one track; coefficients come first."""

    triad: TriadModel
    names: tuple[str, ...]
    value: Array
    covariance: Array
    course: FilterHistory
    nis: float  # sum over its components
    dof: int  # of its NIS, if noise and table are as stated
    unit: str
    untested_reason: str  # why NIS does not test noise and table; empty if it does
    shared_covariance: Array  # (p, p), the part due to gravity, which changes no innovation
    test_data: InnovationTestData | None = None  # if the steps were stored
    rejections: int = 0  # number of readbacks beyond the gate

    @property
    def sd(self) -> float:
        """Standard deviation of the first three innovations according to the filter's model."""
        z = self.course.innovation[self.course.nis > 0, :3]
        ratio = self.nis / max(self.dof, 1)
        return float(np.sqrt(np.mean(z**2) / ratio)) if z.size and ratio else 1.0


def variance_inflation(one: FilterResult) -> float:
    """Return the factor by which the innovations increase the variances."""
    if one.dof <= 0 or one.nis <= chdtri(one.dof, 1 - _CONFIDENCE_LEVEL):
        return 1.0
    return one.nis / one.dof


def residual_group(one: FilterResult, observations: Observations) -> ResidualGroup:
    """Return the mean innovations in each step of the run."""
    kept = one.course.nis > 0
    time, z = one.course.time[kept], one.course.innovation[kept, :3]
    every = zip(observations.labels, observations.time, observations.duration, strict=True)
    parts = [(label, z[np.abs(time - t) <= seconds / 2]) for label, t, seconds in every]
    parts = [(label, part) for label, part in parts if len(part)]
    counts = np.array([len(part) for _, part in parts], dtype=float)
    return ResidualGroup(
        name=f"innovations of the {one.course.name}' filter, mean of each step",
        unit=one.unit,
        labels=tuple(label for label, _ in parts),
        residual=np.array([part.mean(axis=0) for _, part in parts]).reshape(-1, 3),
        # Innovations are independent.
        sd=one.sd / np.sqrt(counts)[:, None] * np.ones(3),
        chi2=one.nis,
        dof=one.dof,
        spread=ScatterModel(excess=one.sd * float(np.sqrt(variance_inflation(one) - 1))),
        enlarged=variance_inflation(one) > 1,
    )


def describe_innovations(one: FilterResult) -> str:
    """Describe in a sentence whether the innovations agree with the stated noise and table."""
    mean = one.nis / max(one.dof, 1)
    text = f"{one.course.name}: the innovations' NIS per degree of freedom is {mean:.2f}"
    if variance_inflation(one) > 1:
        return f"{text}, above its 95 % bound, so all variances are multiplied by it"
    if one.untested_reason:
        return f"{text}; this does not test noise and table, because {one.untested_reason}"
    if one.nis < _MIN_NIS_RATIO * chdtri(max(one.dof, 1), _CONFIDENCE_LEVEL):
        return (
            f"{text}, below 1: noise or table are better than stated, so the uncertainties are "
            "too large"
        )
    return f"{text}: consistent with the stated noise and table"
