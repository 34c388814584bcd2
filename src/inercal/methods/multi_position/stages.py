"""Carry out the successive fits of multi_position, each of which is judged by its own χ².

1. `fit_accelerometers` uses only norms. If χ² requires extra scatter, it is assigned to the rests.
2. `fit_gyros` first uses the rates at rest for bias, sensitivity to acceleration and the bias's
   random walk. Then it fits rotations and rates with the accelerometers fixed. Their covariance P_a
   is propagated (Schmidt's consider filter)::

       cov c_g = P + K P_a Kᵀ,   cov(c_g, c_a) = −K P_a,   K = P J_gᵀ J_a   (whitened)

3. `fit_jointly` fits all rows at once, with the scatter from steps 1 and 2, and starts from their
   solution.

`score_tests` tests omitted effects with the noise before any scatter is added, because the added
scatter would hide them. The tests are computed at the solution for this smaller noise, which is
near the last solution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation import (
    Candidate,
    Estimate,
    Gaussian,
    Problem,
    ResidualGroup,
    ScoreTestSet,
    least_squares,
)
from inercal.methods import Priors
from inercal.methods.candidates import prior_candidates
from inercal.methods.multi_position import row_whitening
from inercal.methods.multi_position.rest_candidates import (
    candidates,
    component_candidates,
    rest_changes,
    step_candidates,
)
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.physics.sensors import G0

_COARSE_ITERATIONS = 6  # steps
# Number of rests above which single axes are not tested: memory grows with its square
_MAX_SCORED_RESTS = 100
_RELATIVE_ERROR = 1e-9  # of χ², because a rotation is the product of hundreds of steps
_EXACT_LIMIT = 1e-15  # SI; quantities with a smaller deviation are exact
_ROUNDING_ERRORS = ("rounding_x", "rounding_y", "rounding_z")  # shared by the rates at rest
KNOWN_QUANTITIES = ("g", "earth_1", "earth_2", "earth_up", "timebase", *_ROUNDING_ERRORS)


@dataclass(frozen=True, eq=False)
class FitStage:
    """The result of one of the fits.

    Parameters
    ----------
    estimate : Estimate
        The χ² of its groups, the kinds of rows tested so far, is before any excess is added.
    x : (p + 8,) array
        All coefficients, g, the earth's rate, the clock error and the rounding errors. Quantities
        that are not fitted yet have their nominal value.
    scatter : Scatter
    """

    estimate: Estimate
    x: Array
    scatter: Scatter


def fit_accelerometers(rests: Rests, priors: Priors) -> FitStage:
    """Fit the accelerometers to the norms at rest.

    Raises
    ------
    NotObserved
        The attitudes do not determine all coefficients.
    """
    alone = Rests(rests.observations, rests.force, rests.bench)
    p = len(rests.force.coefficients)
    x, free = alone.start(), _free_indices(alone)
    free = free[free <= p]  # coefficients and g
    # The noise is first propagated at the nominal model, then at the resulting estimate.
    for _ in range(2):
        x[free] = _fit(alone, free, x, Scatter(), priors).value
    judged = row_whitening.norm_scatter(alone, alone.rows(x))
    scatter = Scatter(judged.spread)
    estimate = _fit(alone, free, x, scatter, priors, drifting=True)
    x[free] = estimate.value
    groups = _residual_groups(alone, alone.rows(x), scatter, [judged[:2]])
    whole = rests.start()
    whole[:p], whole[len(rests.sensor.coefficients)] = x[:p], x[p]
    return _fit_stage(estimate, whole, scatter, groups)


def fit_gyros(rests: Rests, first: FitStage, priors: Priors) -> FitStage:
    """Fit the gyros to rates and rotations, with the accelerometers fixed at `first`.

    Raises
    ------
    NotObserved
        The turns do not determine all coefficients.
    """
    assert rests.transitions is not None
    sensor, p = rests.sensor, len(rests.force.coefficients)
    count = len(sensor.coefficients)
    own = np.arange(p, count)
    free = np.setdiff1d(_free_indices(rests), [*range(p), count])
    # The prior of the clock error adds a row, so the clock error uses no degree of freedom.
    fitted = np.setdiff1d(free, [count + KNOWN_QUANTITIES.index("timebase")])
    lines = [sensor.coefficient(name) for name in sensor.coefficients[p:]]
    still = own[[not line.basis.uses("wi", "wp", "wo") for line in lines]]  # need no turn
    x = first.x.copy()
    rows = rests.rows(x)
    r, k = len(rows.norm.residual), len(rests.transitions.rest)
    # The attitudes during the run, and with them the earth's rate, require a bias estimate first.
    of_rest = slice(r + 2 * k, None)
    by_still, off = rows.jacobian[of_rest, still], rows.residual[of_rest]
    x[still] += np.linalg.lstsq(by_still, off, rcond=None)[0]
    # With only the rates, a common rounding error is part of the bias.
    shown = np.concatenate([still, fitted[own.size :]])
    shown = shown[shown < count + KNOWN_QUANTITIES.index(_ROUNDING_ERRORS[0])]
    rates = row_whitening.rate_scatter(rests, rests.rows(x), shown)
    scatter = first.scatter._replace(rate=rates.spread)
    # The scatter is not known yet, so this fit need not converge to the last digit.
    x[free] = _fit(rests, free, x, scatter, priors, norms=False, most=_COARSE_ITERATIONS).value
    rotations = row_whitening.rotation_scatter(rests, rests.rows(x), shown, fitted, scatter)
    scatter = scatter._replace(turn=rotations.spread)
    fit = _fit(rests, free, x, scatter, priors, norms=False, drifting=True)
    x[free] = fit.value
    rows = rests.rows(x)
    judged = [(0.0, 0), rates[:2], rotations[:2]]
    groups = (*first.estimate.groups, *_residual_groups(rests, rows, scatter, judged)[1:])
    whiten = row_whitening.whitener(rests, rows, scatter, norms=False)
    whiten = row_whitening.whitener_with_drift(rests, rows, whiten)
    estimate = _consider_estimate(rests, fit, first.estimate, whiten(rows.jacobian))
    return _fit_stage(estimate, x, scatter, groups)


def fit_jointly(rests: Rests, last: FitStage, priors: Priors) -> FitStage:
    """Fit all parameters to all rows at once, starting from `last`."""
    x, free = last.x.copy(), _free_indices(rests)
    estimate = _fit(rests, free, x, last.scatter, priors, drifting=True)
    x[free] = estimate.value
    judged = [(group.chi2, group.dof) for group in last.estimate.groups]
    groups = _residual_groups(rests, rests.rows(x), last.scatter, judged)
    return _fit_stage(estimate, x, last.scatter, groups)


def score_tests(rests: Rests, last: FitStage, priors: Priors) -> ScoreTestSet:
    """Return score tests of omitted parameters, with the noise before any scatter was added.

    The tests use all rows, including the accelerometers' rows if the gyros were fitted afterwards.
    """
    free = _free_indices(rests)
    if rests.transitions is None:
        free = free[free <= len(rests.sensor.coefficients)]
    stated = last.scatter.shares
    return _fit(
        rests, free, last.x, stated, priors, most=_COARSE_ITERATIONS, with_score_tests=True
    ).score_tests


def _free_indices(rests: Rests) -> Indices:
    """Return the indices in x of all coefficients and of other quantities that are not exact."""
    loose = [known.sd > _EXACT_LIMIT for known in rests.known_quantities]
    return np.flatnonzero([True] * len(rests.sensor.coefficients) + loose)


def _fit(
    rests: Rests,
    free: Indices,
    x: Array,
    scatter: Scatter,
    priors: Priors,
    *,
    norms: bool = True,
    most: int = 200,
    with_score_tests: bool = False,
    drifting: bool = False,
) -> Estimate:
    """Return the least-squares fit of the entries `free` of x; the others are fixed.

    With `with_score_tests`, the result includes score tests of omitted effects. With `drifting`,
    the noise includes a possible drift of the accelerometers.
    """
    names: tuple[str, ...] = (*rests.sensor.coefficients, *KNOWN_QUANTITIES)
    started = rests.rows(x)
    whiten = row_whitening.whitener(rests, started, scatter, norms=norms)
    if drifting:
        whiten = row_whitening.whitener_with_drift(rests, started, whiten)
    changed = rest_changes(rests, started, x, scatter) if with_score_tests else None
    more = np.zeros(0) if changed is None else changed.residual

    def linearise(part: Array) -> tuple[Array, Array]:
        moved = x.copy()
        moved[free] = part
        rows = rests.rows(moved, started)
        both = whiten(np.column_stack([rows.residual, rows.jacobian[:, free]]))
        below = np.zeros((more.size, free.size))
        return np.concatenate([both[:, 0], more]), np.concatenate([both[:, 1:], below])

    def left_out(part: Array) -> Iterator[Candidate]:
        moved = x.copy()
        moved[free] = part
        rows = rests.rows(moved, started)
        column = dict(zip(rests.sensor.coefficients, rows.jacobian.T, strict=False))
        of_priors = prior_candidates(rests.sensor, chosen, stated, column)
        for one in chain(of_priors, candidates(rests, rows, moved)):
            white = whiten(one.rows)
            if changed is not None:
                white = np.concatenate([white, changed.added_columns(one)])
            yield replace(one, rows=white)
        for one, below in step_candidates(rests, rows, changed) if changed is not None else ():
            whole = replace(one, rows=np.concatenate([whiten(one.rows), below]))
            few = len(rests.observations.labels) <= _MAX_SCORED_RESTS
            yield from component_candidates(whole) if few else (whole,)

    places: list[int] = free.tolist()
    chosen = tuple(names[k] for k in places)
    stated = [marginal for prior in priors if (marginal := prior.marginal(chosen)) is not None]
    known = stated + [
        Gaussian.independent((name,), quantity.value, quantity.sd)
        for name, quantity in zip(KNOWN_QUANTITIES, rests.known_quantities, strict=True)
        if name in chosen
    ]
    return least_squares(
        Problem(
            names=chosen,
            start=x[free],
            linearise=linearise,
            noise=np.ones(len(whiten(started.residual)) + more.size),
            scale=np.concatenate(
                [rests.sensor.unit_scale, [G0], np.ones(len(KNOWN_QUANTITIES) - 1)]
            )[free],
            priors=tuple(known),
            wanted=tuple(name for name in chosen if name not in KNOWN_QUANTITIES),
            rounding=_RELATIVE_ERROR,
            candidates=left_out if with_score_tests else None,
        ),
        max_iterations=most,
    )


def _consider_estimate(rests: Rests, fit: Estimate, first: Estimate, jacobian: Array) -> Estimate:
    """Return accelerometers and gyros as one estimate; `jacobian` is whitened, for all of x."""
    p, a = len(rests.sensor.coefficients), len(rests.force.coefficients)
    with_g = list(first.names[a:])
    others = [*range(a), *([p] if with_g else [])]
    free = [*range(a, p), *(p + KNOWN_QUANTITIES.index(name) for name in fit.names[p - a :])]
    gain = fit.covariance @ jacobian[:, free].T @ jacobian[:, others]
    cross = gain @ first.covariance
    # First in the order accelerometers, g, gyros, earth; then with the gyros before g.
    joined = np.block([[first.covariance, -cross.T], [-cross, fit.covariance + cross @ gain.T]])
    order = [*range(a), *range(len(others), len(others) + p - a)]
    order += [*range(a, len(others)), *range(len(others) + p - a, len(joined))]
    covariance = joined[np.ix_(order, order)]
    own, earth = fit.value[: p - a], fit.value[p - a :]
    value = np.concatenate([first.value[:a], own, first.value[a:], earth])
    singular = np.sort(np.concatenate([first.singular_values, fit.singular_values]))[::-1]
    weakest = min((first, fit), key=lambda e: e.singular_values[-1]).weakest
    return replace(
        fit,
        names=(*rests.sensor.coefficients, *with_g, *fit.names[p - a :]),
        value=value,
        covariance=covariance,
        wanted=rests.sensor.coefficients,
        rank=first.rank + fit.rank,
        singular_values=singular,
        null_directions=(*first.null_directions, *fit.null_directions),
        weakest=weakest,
        converged=first.converged & fit.converged,
        iterations=first.iterations + fit.iterations,
    )


def with_shared_drift(rests: Rests, estimate: Estimate) -> Estimate:
    """Return the estimate with the drift shared by all rests added to the biases' variances."""
    covariance = estimate.covariance.copy()
    for channel, variance in zip(rests.sensor.channels, rests.drift_of_mean, strict=True):
        for name in (f"{channel}.k0", f"{channel}.bias"):
            if name in estimate.names:
                k = estimate.names.index(name)
                covariance[k, k] += variance
    return replace(estimate, covariance=covariance)


def _fit_stage(
    estimate: Estimate, x: Array, scatter: Scatter, groups: tuple[ResidualGroup, ...]
) -> FitStage:
    judged = replace(
        estimate,
        groups=groups,
        chi2=np.array(sum(group.chi2 for group in groups)),
        dof=sum(group.dof for group in groups),
        residual=np.concatenate([group.residual.ravel() for group in groups]),
        whitened=np.concatenate([(group.residual / group.sd).ravel() for group in groups]),
        observations=(),
    )
    return FitStage(judged, x, scatter)


def _residual_groups(
    rests: Rests, rows: ResidualRows, scatter: Scatter, judged: Sequence[tuple[float, int]]
) -> tuple[ResidualGroup, ...]:
    """Return each kind of rows with its stated scatter; `judged` contains χ² and ν of each."""
    labels, r = rests.observations.labels, len(rows.norm.residual)
    of_rests, of_turns = row_whitening.row_covariance(rests, rows, scatter)
    variance = np.linalg.diagonal(of_rests)
    own = variance[:, [row_whitening.NORM_ROW]]
    kinds = [("norms", "m/s²", labels, rows.norm.residual[:, None], own)]
    if rows.rotations is not None:
        before = rows.rotations.rest
        ways = tuple(f"{labels[k]}–{labels[k + 1]}" for k in before)
        arriving, leaving = variance[before + 1, :2], variance[before, 6:]
        of_ways = arriving + leaving + np.linalg.diagonal(of_turns)
        rates = rows.residual[-3 * r :].reshape(r, 3)
        kinds.append(("rates", "rad/s", labels, rates, variance[:, row_whitening.RATE_ROWS]))
        kinds.append(("rotations", "rad", ways, rows.rotations.residual, of_ways))
    return tuple(
        ResidualGroup(name, unit, names, residual, np.sqrt(own), chi2, dof, found)
        for (name, unit, names, residual, own), (chi2, dof), found in zip(
            kinds, judged, scatter, strict=False
        )
    )
