"""Fit a sum of noise terms to binned squares of DCT-II coefficients by maximum likelihood.

The coefficients c_k are nearly independent with variances S_k = Σ_j θ_j e_jk, where θ_j ≥ 0 are the
squared noise coefficients. With the mean I of w squares in a bin, the negative log-likelihood is

    L = ½ Σ w [ln S + I/S]

L is minimised by Fisher scoring: each step is a non-negative least-squares fit with weights w/2S².
A step is halved as long as L increases. The covariance of θ is [½ Σ w e eᵀ/S²]⁻¹. Coefficient k = 0
is omitted, so the unknown bias has no effect (REML). A quasi-Newton search in ln θ would not
converge, because B goes to zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.whitened_problem import column_lengths
from inercal.noise.numerics import nonnegative_least_squares, pseudo_inverse, root_between
from inercal.noise.spectrum import Bins

PROFILE_TWO_SIDED = 4.0  # increase of 2 L at the ends of an interval of ±2u
PROFILE_ONE_SIDED = 2.706  # increase of 2 L at an upper limit of 95 %
_STEPS, _HALVINGS = 60, 20
_CONVERGED = 1e-7  # of L
_START_GROUPS = 25
_LOG_STEP = 0.02  # step of ln T for its derivative


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """A fitted sum of noise terms.

    Parameters
    ----------
    symbols : tuple of str
    variances : (p,) array
        Squared coefficients θ, SI².
    markov_time : float
        Time constant T, s; 1 if there is no Gauss–Markov term.
    loss : float
        L at the minimum.
    model : (b,) array
        S in each bin.
    covariance : (p, p) array
        Covariance of θ. If there is a Gauss–Markov term, the shape is (p + 1, p + 1), and ln T is
        last.
    nuisance, nuisance_u : (k,) array
        Coefficients of the columns for the sensor's own filter, and their standard uncertainties.
    """

    symbols: tuple[str, ...]
    variances: Array
    markov_time: float
    loss: float
    model: Array
    covariance: Array
    nuisance: Array = field(default_factory=lambda: np.zeros(0))
    nuisance_u: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def parameters(self) -> int:
        """Number of parameters; a Gauss–Markov process counts as three (σ, T, search over T)."""
        return len(self.symbols) + 2 * ("G" in self.symbols)

    @property
    def aic(self) -> float:
        """Akaike's information criterion."""
        return 2 * self.loss + 2 * self.parameters

    def variance(self, symbol: str) -> float:
        """Return θ of a term; 0 if the model does not contain this term."""
        if symbol not in self.symbols:
            return 0.0
        return float(self.variances[self.symbols.index(symbol)])

    @property
    def as_variances(self) -> dict[str, float]:
        """Squared coefficients θ by term."""
        return dict(zip(self.symbols, map(float, self.variances), strict=True))


def loss(power: Array, weight: Array, model: Array) -> float:
    """Return L for a model S, (b,)."""
    return 0.5 * float(weight @ (np.log(model) + power / model))


def scored_fit(
    power: Array,
    weight: Array,
    basis: Array,
    fixed: Array | None = None,
    start: Array | None = None,
) -> tuple[Array, float]:
    """Fit θ by Fisher scoring; return θ, (p,), and L at the minimum.

    Parameters
    ----------
    power, weight : (b,) array
    basis : (b, p) array
        Expected power in each bin for coefficients of 1.
    fixed : (b,) array, optional
        Part of S that is not fitted.
    start : (p,) array, optional
        Start value of θ.
    """
    fixed = np.zeros_like(power) if fixed is None else fixed
    size = np.maximum(
        np.linalg.norm(basis / (power + np.abs(fixed).max() + 1e-300)[:, None], axis=0), 1e-300
    )
    columns = basis / size
    theta = coarse_fit(power, weight, columns, fixed) if start is None else start * size
    model = columns @ theta + fixed
    if not (model > 0).all():
        theta = np.maximum(theta, 1e-6 * max(float(theta.max(initial=0)), 1e-12))
        model = columns @ theta + fixed
    value = loss(power, weight, model)
    for _ in range(_STEPS):
        step = _weighted_nnls(columns, power - fixed, np.sqrt(weight / 2) / model) - theta
        before = value
        for _ in range(_HALVINGS):
            trial = columns @ (theta + step) + fixed
            if (trial > 0).all() and (new := loss(power, weight, trial)) <= value:
                theta, model, value = theta + step, trial, new
                break
            step = step / 2
        if before - value <= _CONVERGED * (1 + abs(value) * 1e-6):
            break
    return theta / size, value


def _weighted_nnls(columns: Array, target: Array, weight: Array) -> Array:
    return nonnegative_least_squares(columns * weight[:, None], target * weight)


def coarse_fit(power: Array, weight: Array, columns: Array, fixed: Array) -> Array:
    """Estimate θ from about 25 groups of bins, weighted by their numbers of coefficients."""
    count = min(_START_GROUPS, power.size)
    size, longer = divmod(power.size, count)  # the first groups have one bin more
    group = np.arange(count)
    starts = group * size + np.minimum(group, longer)
    total = np.add.reduceat(weight, starts)

    def mean(values: Array) -> Array:
        return np.add.reduceat(values * weight, starts) / total

    level = mean(power)
    grouped = np.stack([mean(column) for column in columns.T], axis=1)
    return _weighted_nnls(grouped, level - mean(fixed), np.sqrt(total / 2) / level)


def information_inverse(weight: Array, columns: Array, model: Array) -> Array:
    """Return the covariance of the coefficients of columns of S, [½ Σ w e eᵀ/S²]⁻¹."""
    scaled = columns * (np.sqrt(weight / 2) / model)[:, None]
    size = column_lengths(scaled)  # 1 for ln T if the term is zero
    scaled = scaled / size
    return pseudo_inverse(scaled.T @ scaled) / np.outer(size, size)


def basis_matrix(bins: Bins, symbols: Sequence[str], markov_time: float) -> Array:
    """Return the expected power in each bin for each term, (b, p)."""
    columns = [bins.markov_basis(markov_time) if one == "G" else bins.basis(one) for one in symbols]
    return np.stack(columns, axis=1)


def _fit_columns(bins: Bins, basis: Array, start: Array | None = None) -> tuple[Array, float]:
    """Return θ for the terms and for the filter's columns, (p + k,), and L."""
    effect = bins.effect
    if effect is None:
        return scored_fit(bins.power, bins.weight, basis, start=start)
    if start is None:
        # The first fit omits the filter's columns, because dS/d ln f_c may make S negative.
        held = effect.known + effect.nuisance @ effect.start
        terms, _ = scored_fit(bins.power, bins.weight, basis, held)
        start = np.concatenate([terms, effect.start])
    columns = np.column_stack([basis, effect.nuisance])
    return scored_fit(bins.power, bins.weight, columns, effect.known, start)


def _model(bins: Bins, basis: Array, theta: Array) -> Array:
    effect = bins.effect
    if effect is None:
        return basis @ theta
    return np.column_stack([basis, effect.nuisance]) @ theta + effect.known


def fit_terms(bins: Bins, symbols: Sequence[str], markov_time: float | None = None) -> NoiseFit:
    """Fit some noise terms; T of a Gauss–Markov term is also fitted unless it is given.

    Parameters
    ----------
    bins : Bins
    symbols : sequence of str
        Symbols from `inercal.noise.terms.TERMS`.
    markov_time : float, optional
        Time constant T, s.
    """
    symbols = tuple(symbols)
    if "G" in symbols and markov_time is None:
        markov_time = _best_time(bins, symbols)
    time = markov_time or 1.0
    basis = basis_matrix(bins, symbols, time)
    theta, value = _fit_columns(bins, basis)
    model = _model(bins, basis, theta)
    columns = basis
    if "G" in symbols:
        ahead, behind = (
            bins.markov_basis(time * float(np.exp(s))) for s in (_LOG_STEP, -_LOG_STEP)
        )
        slope = theta[symbols.index("G")] * (ahead - behind) / (2 * _LOG_STEP)
        columns = np.column_stack([basis, slope])
    own = columns.shape[1]
    if bins.effect is not None:
        columns = np.column_stack([columns, bins.effect.nuisance])
    covariance = information_inverse(bins.weight, columns, model)
    p = len(symbols)
    spread = np.sqrt(np.diag(covariance)[own:])
    return NoiseFit(
        symbols, theta[:p], time, value, model, covariance[:own, :own], theta[p:], spread
    )


def extended(fit: NoiseFit, bins: Bins) -> NoiseFit:
    """Return a fit with its spectrum evaluated at other bins."""
    return replace(fit, model=basis_matrix(bins, fit.symbols, fit.markov_time) @ fit.variances)


def fit_again(bins: Bins, fit: NoiseFit) -> NoiseFit:
    """Fit the same terms with the same T to other bins; the covariance is not recomputed."""
    basis = basis_matrix(bins, fit.symbols, fit.markov_time)
    tail = np.zeros(0) if bins.effect is None else bins.effect.start
    start = np.concatenate([fit.variances, tail])
    theta, value = _fit_columns(bins, basis, start)
    p = len(fit.symbols)
    return replace(
        fit, variances=theta[:p], loss=value, model=_model(bins, basis, theta), nuisance=theta[p:]
    )


def _best_time(bins: Bins, symbols: tuple[str, ...]) -> float:
    """Return the T with the smallest L: the best of a grid, refined by parabolas in ln T."""

    def at(log_time: float) -> float:
        return _fit_columns(bins, basis_matrix(bins, symbols, float(np.exp(log_time))))[1]

    grid = np.log(bins.times)
    values = np.array([at(one) for one in grid])
    k = int(np.clip(np.argmin(values), 1, grid.size - 2))
    return float(np.exp(_parabola(at, grid[k], values[k - 1 : k + 2], grid[1] - grid[0])))


def _parabola(at: Callable[[float], float], centre: float, values: Array, step: float) -> float:
    """Return the position of a minimum, found by parabolas from three values around a centre."""
    low, mid, high = map(float, values)
    for _ in range(3):
        curvature = low - 2 * mid + high
        if curvature <= 0:
            return centre + step * (int(np.argmin([low, mid, high])) - 1)
        centre += float(np.clip(0.5 * step * (low - high) / curvature, -step, step))
        step /= 4
        low, mid, high = at(centre - step), at(centre), at(centre + step)
    curvature = low - 2 * mid + high
    shift = 0.5 * step * (low - high) / curvature if curvature > 0 else 0.0
    return centre + float(np.clip(shift, -step, step))


def profile_limits(
    bins: Bins, fit: NoiseFit, symbol: str, rise: float = PROFILE_TWO_SIDED
) -> tuple[float, float]:
    """Return the values of a coefficient at which 2 L has increased by `rise`.

    The other terms are fitted again at each value, but T is kept constant. The lower end is 0 if L
    does not increase enough.
    """
    j = fit.symbols.index(symbol)
    basis = basis_matrix(bins, fit.symbols, fit.markov_time)
    others = np.delete(basis, j, axis=1)
    known, tail = np.zeros_like(bins.power), np.zeros(0)
    if bins.effect is not None:
        others = np.column_stack([others, bins.effect.nuisance])
        known = bins.effect.known
        tail = bins.effect.start  # with this start value, S is positive for any terms
    start = np.concatenate([np.delete(fit.variances, j), tail])

    def risen(variance: float) -> float:
        fixed = variance * basis[:, j] + known
        if not others.shape[1]:
            return 2 * (loss(bins.power, bins.weight, fixed) - fit.loss) - rise
        _, value = scored_fit(bins.power, bins.weight, others, fixed, start)
        return 2 * (value - fit.loss) - rise

    best = float(fit.variances[j])
    spread = float(np.sqrt(fit.covariance[j, j]))
    top = best + 2 * spread
    for _ in range(40):
        if risen(top) > 0:
            break
        top = best + 2 * (top - best)
    tolerance = 1e-3 * spread
    high = root_between(risen, best, top, tolerance)
    floor = 1e-9 * max(best, spread)
    if best <= floor or (len(fit.symbols) > 1 and risen(floor) <= 0):
        return 0.0, float(np.sqrt(high))
    if len(fit.symbols) == 1:
        floor = 1e-3 * best
    low = root_between(risen, floor, best, tolerance)
    return float(np.sqrt(low)), float(np.sqrt(high))
