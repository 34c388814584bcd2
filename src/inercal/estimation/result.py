"""Store the results of an estimator: values, their covariance, and tests of the model.

χ² is the sum over the whitened residuals of the observations and of the priors. Its degrees of
freedom are observations + prior rows + gauge rows − parameters. If χ² exceeds its 95 % bound, noise
or model are worse than stated, and uncertainties are enlarged by the Birge ratio √(χ²/ν) (Birge
1932, Physical Review 40, 207–227).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.estimation.innovations import FilterHistory
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.nullspace import NullDirection
from inercal.estimation.residual_scatter import ScatterModel, WhitenedRows
from inercal.estimation.scores import (
    NO_SCORE_TESTS,
    ModelTest,
    ScoreTestSet,
    chi2_tail_probabilities,
    chi2_tail_probability,
)

_LEVEL = 0.95
NO_ROWS: LazyValue[None] = LazyValue(lambda: None)
OF_TRIALS = ("value", "covariance", "chi2", "residual", "whitened", "converged", "iterations")
"""The fields of an estimate with a trials dimension."""


@dataclass(frozen=True, eq=False)
class ResidualGroup:
    """Observations of one kind, with their own χ² test.

    Parameters
    ----------
    name, unit : str
        Name of the kind, and the SI unit of its residuals.
    labels : tuple of k str
        One label for each observation.
    residual : (k, q) array
        Residuals with q components each, in `unit`.
    sd : (k, q) array
        Stated standard deviations of the residuals, including `spread`.
    chi2, dof : float and int
        χ² and its degrees of freedom, for the stated noise.
    spread : ScatterModel
        Share and excess of the noise derived from χ², in the unit of the residuals or of the
        readings from which they are computed.
    enlarged : bool
        Whether the uncertainties derived from the group were enlarged by its Birge ratio.
    """

    name: str
    unit: str
    labels: tuple[str, ...]
    residual: Array
    sd: Array
    chi2: float
    dof: int
    spread: ScatterModel
    enlarged: bool = False

    @property
    def p_value(self) -> float:
        """Probability of a χ² at least as large if the noise is as stated; 1 if dof is 0."""
        return chi2_tail_probability(self.chi2, self.dof)

    @property
    def scatter_ratio(self) -> float:
        """Ratio of the residuals' scatter to the stated scatter, √(χ²/ν); 1 if dof is 0."""
        return float((self.chi2 / self.dof) ** 0.5) if self.dof > 0 else 1.0


@dataclass(frozen=True, eq=False)
class Estimate:
    """The solution of a problem, or the solutions of all trials of a problem.

    Parameters
    ----------
    names : tuple of str
        The p parameters, in the order of every vector.
    value : (..., p) array
        Estimates.
    covariance : (..., p, p) array
        Modelled covariance of the estimates, from the stated noise and priors; NaN if it does not
        exist.
    chi2 : (...) array
        Sum of squared whitened residuals; with a robust loss, each residual is replaced by its
        bounded influence ψ.
    dof : int
        Degrees of freedom of `chi2`.
    wanted : tuple of str
        The wanted parameters; the others are nuisances.
    rank : int
        Number of directions of the wanted parameters that the data determine (first trial).
    singular_values : array
        Singular values of those directions, descending, in noise standard deviations per typical
        size.
    converged : (...) bool array
        False if the search ended without a minimum; such an estimate must not be used.
    iterations : (...) int array
        Number of steps tried.
    residual, whitened : (..., m) array
        y − h(x) in the observations' units, and whitened (without robust weights); empty for closed
        formulas and filters.
    observations : tuple of str
        Labels of the observations, or empty.
    null_directions : tuple of NullDirection
        Directions that the data do not determine, for which the values come from priors.
    weakest : NullDirection or None
        The direction with the smallest singular value.
    groups : tuple of ResidualGroup
        Kinds of observations, if the method tests each kind separately. The covariance then
        includes their excess noise, `chi2` is computed without it, and no Birge ratio is applied.
    notes : tuple of str
        The method's remarks on the result.
    courses : tuple of FilterHistory
        For sequential estimators, the estimates over the run (first trial).
    tests : tuple of ModelTest
        Tests of the model in addition to `chi2` and the tests of its groups (first trial).
    scoring : LazyValue of ScoreTestSet
        The score tests, computed at the first call.
    sensitivities : mapping of str to (..., p) array
        ∂(estimates)/∂(stated value) for quantities that are not parameters but whose uncertainty is
        included in `covariance`: known or eliminated quantities, or quantities shared by parts of
        an estimator.
    noise_dof : float
        Degrees of freedom of the noise estimate of one channel; not finite if the noise is stated.
    noise_channels : int
        Number of channels whose noise was estimated separately.
    joint_priors : frozenset of str
        Previously known quantities whose correlations the estimator has included.
    rows : LazyValue of WhitenedRows or None
        The problem linearised at the solution, or None if it was not kept.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    chi2: Array
    dof: int
    wanted: tuple[str, ...]
    rank: int
    singular_values: Array
    converged: Bools
    iterations: Indices
    residual: Array = field(default_factory=lambda: np.zeros(0))
    whitened: Array = field(default_factory=lambda: np.zeros(0))
    observations: tuple[str, ...] = ()
    null_directions: tuple[NullDirection, ...] = ()
    weakest: NullDirection | None = None
    groups: tuple[ResidualGroup, ...] = ()
    notes: tuple[str, ...] = ()
    courses: tuple[FilterHistory, ...] = ()
    tests: tuple[ModelTest, ...] = ()
    scoring: LazyValue[ScoreTestSet] = NO_SCORE_TESTS
    sensitivities: Mapping[str, Array] = field(default_factory=dict[str, Array])
    noise_dof: float = np.inf
    noise_channels: int = 1
    joint_priors: frozenset[str] = frozenset()
    rows: LazyValue[WhitenedRows] | LazyValue[None] = NO_ROWS

    @classmethod
    def from_closed_form(
        cls,
        names: tuple[str, ...],
        value: Array,
        covariance: Array,
        singular_values: Array,
        notes: tuple[str, ...] = (),
    ) -> "Estimate":
        """Return an estimate from closed formulas, (p,), which have no residuals to test."""
        return cls(
            names=names,
            value=value,
            covariance=covariance,
            chi2=np.zeros(()),
            dof=0,
            wanted=names,
            rank=len(names),
            singular_values=singular_values,
            converged=np.array(True),
            iterations=np.array(0),
            notes=notes,
        )

    @cached_property
    def score_tests(self) -> ScoreTestSet:
        """Score tests of parameters that were not estimated; empty for a problem with trials."""
        return replace(self.scoring(), noise_dof=self.noise_dof)

    @property
    def p_value(self) -> Array:
        """Probability of a χ² at least as large if noise and model are as stated; 1 if dof is 0."""
        return chi2_tail_probabilities(self.chi2, self.dof, self.noise_dof, self.noise_channels)

    @cached_property
    def consistent(self) -> Bools:
        """Whether χ² is within its one-sided 95 % bound or, with groups, no group has excess."""
        if self.groups:
            return np.array(all(group.spread.excess == 0 for group in self.groups))
        if not self.dof:
            return np.ones(np.shape(self.chi2), dtype=bool)
        return chi2_tail_probabilities(self.chi2, self.dof) >= 1 - _LEVEL

    @cached_property
    def birge(self) -> Array:
        """Factor on uncertainties, (...): √(χ²/ν), or 1 if consistent or excess was added."""
        if self.groups:
            return np.ones(np.shape(self.chi2))
        return np.where(self.consistent, 1.0, np.sqrt(self.chi2 / max(self.dof, 1)))

    @property
    def largest_birge_ratio(self) -> Array:
        """Ratio of the residuals' scatter to the stated scatter, (...), at least 1.

        The result is the Birge ratio, or the largest ratio among the groups whose uncertainties
        were enlarged by it or by an excess.
        """
        ratios = [one.scatter_ratio for one in self.groups if one.enlarged or one.spread.excess]
        return np.maximum(self.birge, max(ratios, default=1.0))

    @property
    def stated_covariance(self) -> Array:
        """Covariance to report, (..., p, p): as modelled, times the squared Birge ratio."""
        return self.birge[..., None, None] ** 2 * self.covariance

    @cached_property
    def std(self) -> Array:
        """Standard uncertainties to report, (..., p)."""
        return np.sqrt(np.linalg.diagonal(self.stated_covariance))

    @property
    def correlation(self) -> Array:
        """Correlation coefficients, (..., p, p); zero for parameters fixed by convention."""
        sd = np.sqrt(np.linalg.diagonal(self.covariance))
        product = sd[..., :, None] * sd[..., None, :]
        return self.covariance / np.where(product > 0, product, 1.0)

    def sensitivity(self, name: str, sd: float) -> Array | None:
        """Return ∂(estimates)/∂(stated value) for a previously known quantity, (..., p).

        For a prior N(q₀, sd²) this is cov(estimates, q) / sd², from the modelled covariance.

        Parameters
        ----------
        name : str
        sd : float
            Standard deviation of the prior, positive.

        Returns
        -------
        (..., p) array or None
            None if the covariance does not include the quantity.
        """
        if name in self.sensitivities:
            return self.sensitivities[name]
        if name not in self.names:
            return None
        return self.covariance[..., self.names.index(name)] / sd**2

    def select(self, names: Sequence[str]) -> "Estimate":
        """Return the estimate of these parameters only, in this order.

        Raises
        ------
        InputError
            A name is not among the estimated parameters.
        """
        unknown = tuple(name for name in names if name not in self.names)
        if unknown:
            raise InputError(
                f"'{unknown[0]}' was not estimated; the estimate has {', '.join(self.names)}",
                names=unknown,
            )
        index = [self.names.index(name) for name in names]
        return replace(
            self,
            names=tuple(names),
            value=self.value[..., index],
            covariance=self.covariance[..., index, :][..., index],
            wanted=tuple(name for name in self.wanted if name in names),
            sensitivities={name: by[..., index] for name, by in self.sensitivities.items()},
        )


def with_prior_covariance(
    estimate: Estimate, names: Sequence[str], mean: Array, covariance: Array
) -> Estimate:
    """Return the estimate with a joint prior for quantities that it treated as independent.

    An estimator uses quantities b with the prior N(b₀, D), where D is diagonal except for
    quantities whose correlations it includes (`Estimate.joint_priors`). If their covariance is
    actually Σ, the difference in information, ΔΛ = Σ⁻¹ − D⁻¹, is added to its result::

        M = ΔΛ (1 + P_bb ΔΛ)⁻¹,   x′ = x + P_xb M (b₀ − b),   P′ = P − P_xb M P_bx
        χ²′ = χ² + (b₀ − b)ᵀ M (b₀ − b),   ∂x′/∂b₀ = P′_xb Σ⁻¹

    The formulas are exact for a linear problem. A quantity that is not a parameter of the estimate
    but has a sensitivity J = ∂x/∂b₀ is treated as not determined by the data: P_xb = J D and P_bb =
    D, which gives P′ = P + J (Σ − D) Jᵀ. Source: the update of a Gaussian by information
    (Bar-Shalom, Li & Kirubarajan 2001, 3.4.2).

    Parameters
    ----------
    estimate : Estimate
        The estimate, whose priors had the means and variances of the joint prior, and the
        covariances of its `joint_priors`.
    names : sequence of k str
        Names of the quantities; those without effect on the estimate are ignored.
    mean : (k,) array
    covariance : (k, k) array
        Joint covariance, positive definite.
    """
    sd = np.sqrt(np.diagonal(covariance))
    columns = [estimate.sensitivity(name, s) for name, s in zip(names, sd, strict=True)]
    at = [k for k, column in enumerate(columns) if column is not None]
    if not at:
        return estimate
    prior, kept = covariance[np.ix_(at, at)], [names[k] for k in at]
    counted = np.array([name in estimate.joint_priors for name in kept])
    taken = np.where(np.outer(counted, counted) | np.eye(len(at), dtype=bool), prior, 0.0)
    slopes = np.broadcast_arrays(estimate.value, *(c for c in columns if c is not None))[1:]
    cross = np.stack(slopes, axis=-1) @ taken
    lead = estimate.value.shape[:-1]
    b = np.broadcast_to(mean[at], (*lead, len(at))).copy()
    within = np.broadcast_to(taken, (*lead, len(at), len(at))).copy()
    for k, name in enumerate(kept):
        if name in estimate.names and name not in estimate.sensitivities:
            own = estimate.names.index(name)
            b[..., k] = estimate.value[..., own]
            within[..., k, :] = within[..., :, k] = cross[..., own, :]
    added = np.linalg.inv(prior) - np.linalg.inv(taken)
    gain: Array = added @ np.linalg.inv(np.eye(len(at)) + within @ added)
    gain = (gain + gain.mT) / 2
    off = mean[at] - b
    step = (gain @ off[..., None])[..., 0]
    moved: Array = estimate.covariance - cross @ gain @ cross.mT
    after = (cross - cross @ gain @ within) @ np.linalg.inv(prior)
    tested = bool(estimate.dof) and not estimate.groups
    return replace(
        estimate,
        value=estimate.value + (cross @ step[..., None])[..., 0],
        covariance=(moved + moved.mT) / 2,
        chi2=estimate.chi2 + np.sum(off * step, axis=-1) if tested else estimate.chi2,
        sensitivities={
            **estimate.sensitivities,
            **{name: after[..., k] for k, name in enumerate(kept)},
        },
        joint_priors=estimate.joint_priors | set(kept),
    )
