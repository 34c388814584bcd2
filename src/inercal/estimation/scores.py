"""Test whether parameters that were not estimated explain the residuals (score tests).

Let r be the whitened residual at the solution, for observations and priors together, and J its
Jacobian. If the problem omits a parameter δ, this parameter adds c δ to the observations. The
estimator absorbs the part of c that lies in the span of the columns of J, and r contains the rest::

    c' = (1 − J J⁺) c        t = c'·r / |c'|                 N(0, 1) where δ = 0
    δ̂ = c'·r / |c'|²         sd(δ̂) = 1 / |c'|
    shift of the estimate where δ is left out: J⁺ c δ̂

A candidate with k components has one t for each of its k directions, and |t|² is χ² with k degrees
of freedom. η = |c' δ| is the visibility of δ: no test with these data has more power. Two
candidates whose c' are parallel explain the residuals equally well: data of this kind cannot
distinguish them.

Many candidates are tested at once. The significance level is divided among them so that each, for
any k, has the same probability of detection at η = 6 (weighted Bonferroni). With equal shares, a
candidate with nine directions would be detected far more rarely than one with a single direction. A
candidate with more than six directions gets the share for six, because twelve directions would take
seven times as much from all others. If the candidates span only a few dimensions, the χ² of that
space is used instead (Scheffé), provided that it is less strict for a single direction.

Sources: Rao 1948, Mathematical Proceedings of the Cambridge Philosophical Society 44, 50–57 (score
test); Scheffé 1953, Biometrika 40, 87–104 (all contrasts of a space); Rosenthal and Rubin 1983,
Journal of Educational Psychology 75, 76–81 (weighted Bonferroni).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import erfc, exp, pi, sqrt
from statistics import NormalDist
from typing import Literal, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.run_file_advice import Change
from inercal.estimation.lazy_value import LazyValue

CandidateKind = Literal["coefficient", "bench", "row", "time"]

CERTIFICATE = "polygon certificate"  # start of the names of its candidates
HYSTERESIS = "hysteresis of "  # start of the name of a candidate, followed by the axis
STEP = "step of the "  # begins the name of a step of the magnetic field, of the offset or a bias
BIAS_STEP = f"{STEP}bias"  # between two passes on a dividing head
# Tests of the samples within sections, by the start of their names.
BURST_AT = "burst at the "  # begins the name of a test for a burst at the start or end of a section
COMMON_DRIFT, SLOW_NOISE = "drift common to all sections", "noise slower than the sections"
SIGNIFICANCE_LEVEL = 0.01  # level of all tests of one estimate together
SCORE_TEST_SHARE = 0.8  # for score tests; the rest is for χ² and the method's tests
PARALLEL_COSINE = np.cos(np.pi / 6)  # 30°: closer candidates cannot be told apart
# P(χ² > x) for 1 to 6 directions, where P(χ² < x) is 5 % if the noncentrality is 36 (η = 6).
_LEVEL_WEIGHTS = (
    1.3297803019471317e-05, 4.9631608718554e-05, 0.0001228287000059786,
    0.00024806790713819045, 0.0004409219594254095, 0.0007165562443860348,
)  # fmt: skip
_SUMMED_DOF, _SUMMED_CHI2 = 200, 1000.0  # below these, a tail is a short sum and no underflow
_CONTRADICTION = 6.0  # standard deviations
_MISTYPED = 5.0  # an error of a stated value, relative to the largest plausible departure
_SWITCH_TOLERANCE = 3.0  # standard deviations from the size 1
_HARDLY_VISIBLE = 1e-3  # visible fraction of an effect, below which it is hardly visible
LINEARISATION = 0.05  # relative error of the explained part, a first-order estimate


def chi2_tail_probabilities(
    chi2: Array, dof: int, noise_dof: float = np.inf, channels: int = 1
) -> Array:
    """Return the probability of a χ² at least this large if the model is right; 1 if dof is 0.

    Parameters
    ----------
    chi2 : (...) array
    dof : int
    noise_dof : float
        Degrees of freedom ν of the noise estimate used for χ², for one channel.
    channels : int
        Number of channels m whose noise was estimated separately. χ² is then a sum of m parts: its
        mean equals that of F with ν degrees of freedom, and its scatter equals that of F with m ν.
    """
    if dof <= 0:
        return np.ones(np.shape(chi2))
    if np.isinf(noise_dof):
        if np.ndim(chi2) == 0 and dof <= _SUMMED_DOF and 0 < chi2 < _SUMMED_CHI2:
            return np.array(_chi2_tail(dof, float(chi2)))
        return np.asarray(scipy.special.chdtrc(dof, chi2))
    pooled = channels * noise_dof
    mean = (pooled / (pooled - 2)) * ((noise_dof - 2) / noise_dof) if noise_dof > 2 else 1.0
    return np.asarray(scipy.special.fdtrc(dof, pooled, mean * chi2 / dof))


def _chi2_tail(dof: int, chi2: float) -> float:
    """Return the tail probability of χ² as a finite sum, without the .1 s to import scipy.special.

    Source: Abramowitz and Stegun, 26.4.4 and 26.4.5. All terms are positive.
    """
    half, odd = chi2 / 2, dof % 2
    total = erfc(sqrt(half)) if odd else 0.0
    term = exp(-half) * (2 * sqrt(half / pi) if odd else 1.0)
    for k in range(dof // 2):
        total += term
        term *= half / (k + 1 + odd / 2)
    return total


def chi2_tail_probability(
    chi2: float, dof: int, noise_dof: float = np.inf, channels: int = 1
) -> float:
    """Return `chi2_tail_probabilities` for a single χ²."""
    if noise_dof == np.inf and 0 < dof <= _SUMMED_DOF and 0 < chi2 < _SUMMED_CHI2:
        return _chi2_tail(dof, chi2)
    return float(chi2_tail_probabilities(np.array(chi2), dof, noise_dof, channels))


def sufficiency_p_value(
    remaining: float, dof: int, explained: float, noise_dof: float, effect_error: float
) -> float:
    """Return the p-value of the χ² that a candidate leaves; 1 if dof is 0.

    A candidate's size is a first-order estimate, so part of a large effect remains in the
    residuals. The remainder is treated as a noncentral χ² with this part of the explained
    amplitude, so a candidate with a p-value of 1 may still leave far more than the noise.

    Parameters
    ----------
    remaining, dof : float and int
        χ² that remains with the candidate, and its degrees of freedom.
    explained : float
        Decrease of χ² due to the candidate.
    noise_dof : float
        See `chi2_tail_probability`.
    effect_error : float
        See `Candidate`.
    """
    if dof <= 0:
        return 1.0
    away = effect_error**2 * explained
    if np.isinf(noise_dof):
        return float(1 - scipy.special.chndtr(remaining, dof, away))
    return float(1 - scipy.special.ncfdtr(dof, noise_dof, away, remaining / dof))


class UnlikeTrials(Exception):
    """The trials do not all have the same candidates, so they must be tested one by one."""


def of_all_trials(mask: Bools) -> Bools:
    """Return a mask, (m,), that all trials have in common, from (m,) or (trials, m).

    Raises
    ------
    UnlikeTrials
        The trials differ.
    """
    rows = mask.reshape(-1, mask.shape[-1])
    if (rows != rows[:1]).any():
        raise UnlikeTrials
    return rows[0]


class ModelTest(NamedTuple):
    """One test of the model, whose statistic is χ² with `dof` if the model is right."""

    name: str
    statistic: float
    dof: int

    __test__ = False  # otherwise pytest would collect a class with this name

    @property
    def p_value(self) -> float:
        """Probability of a statistic at least this large if the model is right."""
        return chi2_tail_probability(self.statistic, self.dof)


@dataclass(frozen=True, eq=False)
class Candidate:
    """One or more parameters of one kind that the problem omits or assumes known.

    Parameters
    ----------
    name : str
        Name used in reports: "k3", "ax.k3", "radius", "position x_p".
    kind : "coefficient", "bench", "row" or "time"
        A sensor coefficient, a property of the bench, one row of the data, or a change over the
        run.
    components : tuple of k str
        Full names of the parameters; a name refers to the same column in all candidates.
    units : tuple of k str
        SI units of the components.
    rows : (m, k) or (trials, m, k) array
        ∂(observations)/∂(component).
    moved : (q, k) array, optional
        Shift of each parameter's estimate per unit of each omitted component, in addition to the
        shift that follows from the Jacobian; for filters, which have no Jacobian.
    largest : (k,) array, optional
        The largest plausible size of each component. A direction whose η at that size is below 3 is
        not scored, because its effect on the residuals is too small to identify the cause.
    stated_sds : (k,) array, optional
        The stated standard deviation of each component, if its value is stated; 0 if it is stated
        as exact.
    changes : tuple of Change
        Changes to run-file keys that make the method estimate the parameters, if known.
    is_switch : bool
        Whether the true size is 0 or 1, as for a sense of rotation that may be stated reversed.
    effect_error : float
        Relative error of the effect on the observations. It is larger than that of a first-order
        estimate if `rows` depend on something unknown, such as the attitudes of a triad.
    """

    name: str
    kind: CandidateKind
    components: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    moved: Array | None = None
    largest: Array | None = None
    stated_sds: Array | None = None
    changes: tuple[Change, ...] = ()
    is_switch: bool = False
    effect_error: float = LINEARISATION

    def without_zero_components(self) -> "Candidate":
        """Return the candidate without components that have no effect on the observations."""
        acting = np.flatnonzero(of_all_trials(np.any(self.rows != 0.0, axis=-2)))
        if acting.size == len(self.components):
            return self
        return replace(
            self,
            components=tuple(self.components[k] for k in acting),
            units=tuple(self.units[k] for k in acting),
            rows=self.rows[..., acting],
            moved=None if self.moved is None else self.moved[:, acting],
            largest=None if self.largest is None else self.largest[acting],
            stated_sds=None if self.stated_sds is None else self.stated_sds[acting],
        )


def with_rows(candidates: Sequence[Candidate], rows: Array) -> list[Candidate]:
    """Return the candidates with the columns of `rows`, in their order, instead of their own."""
    ends = np.cumsum([len(one.components) for one in candidates])
    parts = np.split(rows, ends[:-1], axis=-1)
    return [replace(one, rows=part) for one, part in zip(candidates, parts, strict=True)]


@dataclass(frozen=True, eq=False)
class ExplainedResidual:
    """The part of a whitened residual explained by a candidate, (1 − Q Qᵀ) c for one column c.

    The columns of Q span the directions of the estimate. The column and Qᵀc are stored instead of
    their difference: the column for a single row among thousands has few nonzero elements, but the
    difference is nonzero in every row.

    Parameters
    ----------
    indices : (n,) array of int
        The rows in which the column is not zero.
    column : (n,) array
        The column's values in these rows.
    projection : (p,) array
        The projection Qᵀ c.
    """

    indices: Indices
    column: Array
    projection: Array

    def product(self, other: "ExplainedResidual") -> float:
        """Return the scalar product of two candidates' effects."""
        _, one, two = np.intersect1d(
            self.indices, other.indices, assume_unique=True, return_indices=True
        )
        return float(self.column[one] @ other.column[two] - self.projection @ other.projection)


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """The score test of one candidate.

    Parameters
    ----------
    name, kind, components, units
        Attributes of the candidate.
    size, sd : (k,) array
        The estimate that the components would get, and its standard deviation, SI; NaN if the data
        do not determine some combination of them.
    chi2 : float
        Decrease of χ² if the candidate were estimated.
    dof : int
        Number of the candidate's directions that the data can detect, at most k; 0 if none.
    shift : (p,) array
        Shift of each parameter's estimate due to `size`, SI. If the data cannot detect the
        candidate, this is the shift due to its largest plausible size.
    explained : ExplainedResidual
        The part of the whitened residual that the candidate explains.
    largest, stated_sds, changes, is_switch, effect_error
        Attributes of the candidate.
    visible_share : float
        Largest share of the candidate's column that the fit leaves to the residuals; 1 if `moved`
        is given.
    least_size : (k,) array, optional
        The smallest component sizes that explain as much, SI, including components that the data do
        not determine.
    """

    name: str
    kind: CandidateKind
    components: tuple[str, ...]
    units: tuple[str, ...]
    size: Array
    sd: Array
    chi2: float
    dof: int
    shift: Array
    explained: ExplainedResidual
    largest: Array | None = None
    stated_sds: Array | None = None
    changes: tuple[Change, ...] = ()
    visible_share: float = 1.0
    least_size: Array | None = None
    is_switch: bool = False
    effect_error: float = LINEARISATION

    @property
    def p_value(self) -> float:
        """Probability of a χ² decrease at least this large if the candidate is zero."""
        return chi2_tail_probability(self.chi2, self.dof)

    @property
    def is_implausible(self) -> bool:
        """Whether a size exceeds the largest plausible size by more than 6 sd.

        A stated value may be mistyped, so its error may be five times as large, which is half of
        the stated value, and an angle may be wrong by up to 180°. The size of a switch is 1.
        """
        if self.is_switch:
            return bool(np.any(np.abs(self.size - 1) > _SWITCH_TOLERANCE * self.sd))
        if self.largest is None or self.kind not in ("coefficient", "bench"):
            return False
        largest = self.largest
        if self.kind == "bench":
            angle = [np.pi * (unit == "rad") for unit in self.units]
            largest = np.maximum(_MISTYPED * largest, angle)
        beyond = np.abs(np.nan_to_num(self.size)) - largest
        return bool(np.any(beyond > _CONTRADICTION * np.nan_to_num(self.sd)))

    @property
    def departure(self) -> float:
        """Largest deviation from a stated value, in its standard deviations; 0 if none.

        For a value stated as exact, a sixth of the largest plausible size is used as its standard
        deviation.
        """
        if self.stated_sds is None:
            return 0.0
        sixth = np.inf if self.largest is None else self.largest / _CONTRADICTION
        sd = np.where(self.stated_sds > 0, self.stated_sds, sixth)
        return float(np.max(np.abs(np.nan_to_num(self.size)) / sd, initial=0.0))

    @property
    def contradicts_statement(self) -> bool:
        """Whether a stated value seems wrong by more than 6 sd but the error is hardly visible.

        The estimated parameters absorb all but a thousandth of its effect, so the residuals must
        have another cause, which resembles the remaining effect.
        """
        return self.departure > _CONTRADICTION and self.visible_share < _HARDLY_VISIBLE

    def cosine(self, other: "ScoreTest") -> float:
        """Return |cos| of the angle between two candidates' effects; 0 if one has no effect."""
        lengths = float(np.sqrt(self.chi2 * other.chi2))
        return abs(self.explained.product(other.explained)) / lengths if lengths > 0 else 0.0


@dataclass(frozen=True)
class ScoreTestSet:
    """The score tests of all candidates for one estimate.

    Parameters
    ----------
    scores : tuple of ScoreTest
    span : int
        Dimension of the space that the candidates span.
    chi2, dof : float and int
        χ² and degrees of freedom of the whole whitened residual.
    noise_dof : float
        Degrees of freedom of the noise estimate.
    """

    scores: tuple[ScoreTest, ...] = ()
    span: int = 0
    chi2: float = 0.0
    dof: int = 0
    noise_dof: float = np.inf

    def with_shifts(self, change: Callable[[Array], Array]) -> "ScoreTestSet":
        """Return the set with shifts of other parameters; `change` computes them from these."""
        scores = tuple(replace(one, shift=change(one.shift)) for one in self.scores)
        return replace(self, scores=scores)

    def adjusted(self, score: ScoreTest, p_value: float | None = None) -> float:
        """Return the p-value of a score test, adjusted for testing all candidates together.

        Parameters
        ----------
        score : ScoreTest
        p_value : float, optional
            Unadjusted p-value of the score test, if its distribution is not that of
            `chi2_tail_probability`.
        """
        if not score.dof:
            return 1.0
        if p_value is None and self._scheffe_is_sharper:
            return chi2_tail_probability(score.chi2, self.span, self.noise_dof)
        if p_value is None:
            p_value = chi2_tail_probability(score.chi2, score.dof, self.noise_dof)
        return min(1.0, p_value * self._weights / _level_weight(score.dof))

    @cached_property
    def _weights(self) -> float:
        return sum(_level_weight(one.dof) for one in self.scores if one.dof)

    @cached_property
    def _scheffe_is_sharper(self) -> bool:
        """Whether the Scheffé test is less strict than Bonferroni for a single direction."""
        level = SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
        single = NormalDist().inv_cdf(level * _level_weight(1) / self._weights / 2) ** 2
        return chi2_tail_probability(single, self.span) < level


def _level_weight(dof: int) -> float:
    """Return the p-value at which an effect with η = 6 is missed with a probability of 5 %."""
    return _LEVEL_WEIGHTS[min(dof, len(_LEVEL_WEIGHTS)) - 1]


NO_SCORE_TESTS = LazyValue(ScoreTestSet)
