"""Score tests: which parameter that was not estimated would explain the residuals.

Let r be the whitened residual at the solution, observations and priors together, and J its
Jacobian. A parameter δ that the problem omits adds c δ to the observations. The estimator absorbs
the part of c in the span of the columns of J, and r contains the rest::

    c' = (1 − J J⁺) c        t = c'·r / |c'|                 N(0, 1) where δ = 0
    δ̂ = c'·r / |c'|²         sd(δ̂) = 1 / |c'|
    shift of the estimate where δ is left out: J⁺ c δ̂

A candidate with k components has t in its k directions, and |t|² is χ² with k degrees of freedom.
η = |c' δ| is the visibility of δ: no test of these data has more power. Two candidates whose c' are
parallel explain the residuals equally well: data of this kind cannot distinguish them.

Many candidates are tested at once. They share the level so that each, for any k, has the same
probability of detection at η = 6 (Bonferroni, weighted): with equal shares a candidate of nine
directions would be detected far more rarely than one of a single direction. More than six
directions get the share of six: twelve would take seven times as much from all others. Where the
candidates span few dimensions, the χ² of that space is used instead (Scheffé), if it is less strict
for a single direction.

Sources: Rao 1948, Mathematical Proceedings of the Cambridge Philosophical Society 44, 50–57 (score
test); Scheffé 1953, Biometrika 40, 87–104 (all contrasts of a space); Rosenthal and Rubin 1983,
Journal of Educational Psychology 75, 76–81 (weighted Bonferroni).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.run_file_advice import Change
from inercal.estimation.lazy_value import LazyValue

CandidateKind = Literal["coefficient", "bench", "row", "time"]

SIGNIFICANCE_LEVEL = 0.01  # of all tests of one estimate together
SCORE_TEST_SHARE = 0.8  # of the level, for the scores; the rest is for χ² and the method's tests
PARALLEL_COSINE = np.cos(np.pi / 6)  # 30°: closer candidates cannot be told apart
_ETA, _MISSED = 6.0, 0.05  # at which η all candidates are missed alike, with what probability
_MOST = 6  # directions, for the share of the level
_CONTRADICTION = 6.0  # standard deviations
_HARDLY_VISIBLE = 1e-3  # of the effect of a candidate
_LINEARISATION = 0.05  # relative error of what a score test explains: its size is of first order


def chi2_tail_probabilities(
    chi2: Array, dof: int, noise_dof: float = np.inf, channels: int = 1
) -> Array:
    """Return the probability of a χ² at least as large if the model holds; 1 without dof.

    Parameters
    ----------
    chi2 : (...) array
    dof : int
    noise_dof : float
        Degrees of freedom ν behind the noise by which χ² was formed, of one channel.
    channels : int
        Number of channels m whose noise was found separately. χ² is then a sum of m parts, whose
        mean is that of F with ν, and whose scatter is that of F with m ν.
    """
    if dof <= 0:
        return np.ones(np.shape(chi2))
    if np.isinf(noise_dof):
        return np.asarray(scipy.special.chdtrc(dof, chi2))
    pooled = channels * noise_dof
    mean = (pooled / (pooled - 2)) * ((noise_dof - 2) / noise_dof) if noise_dof > 2 else 1.0
    return np.asarray(scipy.special.fdtrc(dof, pooled, mean * chi2 / dof))


def chi2_tail_probability(
    chi2: float, dof: int, noise_dof: float = np.inf, channels: int = 1
) -> float:
    """Return `chi2_tail_probabilities` of one χ²."""
    return float(chi2_tail_probabilities(np.array(chi2), dof, noise_dof, channels))


def remaining_p_value(remaining: float, dof: int, explained: float, noise_dof: float) -> float:
    """Return the probability of a χ² as large as the one a candidate leaves; 1 without dof.

    The size of a candidate is that of the first order, so that of a large cause some is left: a
    noncentral χ² with a twentieth of the amplitude that was explained.

    Parameters
    ----------
    remaining, dof : float and int
        χ² that the candidate leaves, and its degrees of freedom.
    explained : float
        By how much χ² falls.
    noise_dof : float
        As for `chi2_tail_probability`.
    """
    if dof <= 0:
        return 1.0
    away = _LINEARISATION**2 * explained
    if np.isinf(noise_dof):
        return float(1 - scipy.special.chndtr(remaining, dof, away))
    return float(1 - scipy.special.ncfdtr(dof, noise_dof, away, remaining / dof))


class ModelTest(NamedTuple):
    """One test of the model, with a statistic that is χ² with `dof` if the model is right."""

    name: str
    statistic: float
    dof: int

    __test__ = False  # pytest takes a class of this name for a test of its own

    @property
    def p_value(self) -> float:
        """Probability of a statistic at least this large if the model is right."""
        return chi2_tail_probability(self.statistic, self.dof)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A parameter, or parameters of one kind, that the problem left out or took as known.

    Parameters
    ----------
    name : str
        What a report calls it: "k3", "ax.k3", "radius", "position x_p".
    kind : "coefficient", "bench", "row" or "time"
        Of the sensor, of the bench, one row of the data, or a change over the run.
    components : tuple of k str
        Full names of the parameters; one name is one column in all candidates.
    units : tuple of k str
        SI.
    rows : (m, k) array
        ∂(observations)/∂(component).
    moved : (q, k) array, optional
        By how much one unit of each component that is left out moves the estimate of each
        parameter beyond what the Jacobian says: a filter has none.
    largest : (k,) array, optional
        The largest plausible size of each component. A direction whose η at that size is below 3
        is not scored: what little the residuals show of it says nothing of its cause.
    stated_sds : (k,) array, optional
        The standard deviation of what is stated of each component, where that is a value; 0 if
        it is stated as exact.
    changes : tuple of Change
        Keys of the run file that let the method estimate it, if known here.
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

    def without_zero_components(self) -> "Candidate":
        """Return the candidate without the components that act on no observation."""
        acting = np.flatnonzero(np.any(self.rows != 0.0, axis=0))
        if acting.size == len(self.components):
            return self
        return replace(
            self,
            components=tuple(self.components[k] for k in acting),
            units=tuple(self.units[k] for k in acting),
            rows=self.rows[:, acting],
            moved=None if self.moved is None else self.moved[:, acting],
            largest=None if self.largest is None else self.largest[acting],
            stated_sds=None if self.stated_sds is None else self.stated_sds[acting],
        )


@dataclass(frozen=True, eq=False)
class ExplainedResidual:
    """The part of a whitened residual that a candidate explains, (1 − Q Qᵀ) c for one column c.

    Q are the directions of the estimate. The column and Qᵀc are stored
    instead of their difference, because the column of a single row among thousands has few
    elements, and the difference has one in every row.

    Parameters
    ----------
    indices : (n,) array of int
        The rows in which the column is not zero.
    column : (n,) array
        The column there.
    projection : (p,) array
        Qᵀ c.
    """

    indices: NDArray[np.intp]
    column: Array
    projection: Array

    def product(self, other: "ExplainedResidual") -> float:
        """Return the scalar product of the effects of two candidates."""
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
        Of the candidate.
    size, sd : (k,) array
        The components' estimate if they were estimated, and its standard deviation, SI; NaN if
        the data leave a combination of them open.
    chi2 : float
        By how much χ² would fall.
    dof : int
        Directions of the candidate that the data show, at most k; 0 if none.
    shift : (p,) array
        By how much `size` moved the estimate of each parameter, SI. Where the data show nothing of
        the candidate: by how much its largest plausible size would move it.
    explained : ExplainedResidual
        The part of the whitened residual that the candidate explains.
    largest, stated_sds, changes
        Of the candidate.
    visible_share : float
        Largest share of the candidate's column that the fit leaves to the residuals.
    least_size : (k,) array, optional
        The smallest sizes of the components that explain as much, SI; also of components that the
        data leave open.
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

    @property
    def p_value(self) -> float:
        """Probability of a drop of χ² at least this large if the candidate is zero."""
        return chi2_tail_probability(self.chi2, self.dof)

    @property
    def is_implausible(self) -> bool:
        """Whether a coefficient is larger than the largest plausible size, by more than 6 sd.

        A statement may be wrong by anything: a mounting, by a mistyped angle.
        """
        if self.largest is None or self.kind != "coefficient":
            return False
        beyond = np.abs(np.nan_to_num(self.size)) - self.largest
        return bool(np.any(beyond > _CONTRADICTION * np.nan_to_num(self.sd)))

    @property
    def departure(self) -> float:
        """The largest departure from a stated value, in its standard deviations; 0 for others.

        Of what is stated as exact a sixth of the largest plausible size stands for the deviation.
        """
        if self.stated_sds is None:
            return 0.0
        sixth = np.inf if self.largest is None else self.largest / _CONTRADICTION
        sd = np.where(self.stated_sds > 0, self.stated_sds, sixth)
        return float(np.max(np.abs(np.nan_to_num(self.size)) / sd, initial=0.0))

    @property
    def contradicts_statement(self) -> bool:
        """Whether it departs from its stated value by more than 6 sd although it is hardly visible.

        What is estimated takes up all but a thousandth of its effect: the residuals show something
        else that resembles the rest of it.
        """
        return self.departure > _CONTRADICTION and self.visible_share < _HARDLY_VISIBLE

    def cosine(self, other: "ScoreTest") -> float:
        """Return |cos| of the angle between the effects of both; 0 if one has no effect."""
        lengths = float(np.sqrt(self.chi2 * other.chi2))
        return abs(self.explained.product(other.explained)) / lengths if lengths > 0 else 0.0


@dataclass(frozen=True)
class ScoreTestSet:
    """All candidates of one estimate.

    Parameters
    ----------
    scores : tuple of ScoreTest
    span : int
        Dimension of the space that the candidates span.
    chi2, dof : float and int
        Of the whole whitened residual.
    noise_dof : float
        Degrees of freedom behind the noise.
    """

    scores: tuple[ScoreTest, ...] = ()
    span: int = 0
    chi2: float = 0.0
    dof: int = 0
    noise_dof: float = np.inf

    def with_shifts(self, change: Callable[[Array], Array]) -> "ScoreTestSet":
        """Return the same with shifts of other parameters, which a function computes from these."""
        scores = tuple(replace(one, shift=change(one.shift)) for one in self.scores)
        return replace(self, scores=scores)

    def adjusted(self, score: ScoreTest, p_value: float | None = None) -> float:
        """Return the p-value of a score adjusted for all candidates together.

        Parameters
        ----------
        score : ScoreTest
        p_value : float, optional
            Of the score alone by another distribution than `chi2_tail_probability`.
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
        """Whether the space of all candidates is the less strict for a single direction."""
        level = SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
        return bool(
            scipy.special.chdtri(self.span, level)
            < scipy.special.chdtri(1, level * _level_weight(1) / self._weights)
        )


@cache
def _level_weight(dof: int) -> float:
    """Return the p-value that a χ² of η = 6 exceeds but with the probability to miss it."""
    dof = min(dof, _MOST)
    return float(scipy.special.chdtrc(dof, scipy.special.chndtrix(_MISSED, dof, _ETA**2)))


NO_SCORE_TESTS = LazyValue(ScoreTestSet)
