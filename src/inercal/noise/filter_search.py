"""Find the sensor's own low-pass filter in the spectrum of a recording at rest.

Each filter shape in `inercal.noise.output_filter` is fitted together with the terms N, B and K.
Each fit is made with and without a floor, which is white noise that the read-out adds after the
filter. The fit uses Fisher scoring as in `inercal.noise.likelihood`, with dS/d ln f_c as an
additional column. The shape with the smallest Bayesian criterion is chosen. A penalty of 4 is added
for a shape other than one pole, and another 4 for the floor.

A filter is accepted if it improves the criterion by more than 10 and the floor is at most 10 % of
the white noise. If the floor is larger, the spectrum is attributed to white noise and a
Gauss–Markov process, which has the same spectrum. The caller must test whether the fit with the
filter describes the recording.

If no filter explains the high frequencies, white noise is estimated from low frequencies only. The
band starts at the lowest frequencies and grows by half octaves. In each step, N, B and K are
fitted to the band, and the next half octave is compared with the fit. The band ends when this half
octave differs from the fit by 3.3 times its standard uncertainty. At this point, the spectrum has
already departed a little, and N would be a few per cent too small. The band that is used therefore
ends two half octaves earlier, and 1 % is added to the uncertainty of N.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise import output_filter
from inercal.noise.likelihood import (
    NoiseFit,
    coarse_fit,
    fit_terms,
    information_inverse,
    loss,
    scored_fit,
)
from inercal.noise.numerics import nonnegative_least_squares
from inercal.noise.output_filter import FilterShape, OutputFilter
from inercal.noise.spectrum import Bins, FilterEffect

BEFORE_FILTER = "NBK"
"""Terms that are fitted during the search for a filter."""
ADDED_RELATIVE_U = 0.01  # of N
_DEPARTS = 3.3  # standard uncertainties of a significant difference
_BACK = 2  # half octaves
_FEWEST = 256  # least number of coefficients in the lowest band
_LARGEST_U = 0.2  # largest relative uncertainty of N
_PLATEAU = 3.0  # the band must reach this multiple of the white-noise/flicker crossing frequency


def band_below(bins: Bins) -> Bins | None:
    """Return the bins of the band that N, B and K describe; None if there is no such band.

    Parameters
    ----------
    bins : Bins
        Bins without a filter.
    """
    order = np.argsort(bins.frequency, kind="stable")
    enough = np.searchsorted(np.cumsum(bins.weight[order]), _FEWEST)
    if enough >= order.size:
        return None
    first = float(bins.frequency[order[enough]])
    top = float(bins.frequency.max())
    count = int(np.ceil(2 * np.log2(max(top / first, 1.0))))
    edges = first * 2 ** (np.arange(count + 1) / 2)
    for k, edge in enumerate(edges[:-1]):
        inner, outer = bins.below(edge), bins.below(edges[k + 1])
        fit = fit_terms(inner, BEFORE_FILTER)
        new = outer.frequency >= edge
        if not new.any():
            continue
        basis = np.stack([outer.basis(one)[new] for one in BEFORE_FILTER], axis=1)
        model = basis @ fit.variances
        weight = outer.weight[new]
        share = weight / model / weight.sum()
        ratio = float(share @ outer.power[new])
        slope = share @ basis
        variance = float((2 * weight).sum() / weight.sum() ** 2 + slope @ fit.covariance @ slope)
        if abs(ratio - 1) > _DEPARTS * np.sqrt(variance):
            return _kept(bins, edge / 2 ** (_BACK / 2))
    return None


def _kept(bins: Bins, edge: float) -> Bins | None:
    """Return the bins below a frequency; None if these bins do not determine N."""
    band = bins.below(edge)
    if band.power.size < 2 * len(BEFORE_FILTER):
        return None
    fit = fit_terms(band, BEFORE_FILTER)
    white = fit.variance("N")
    j = fit.symbols.index("N")
    if not white or np.sqrt(fit.covariance[j, j]) / (2 * white) > _LARGEST_U:
        return None
    crossing = fit.variance("B") / (2 * np.pi * white)
    return band if edge > _PLATEAU * crossing else None


NEEDED_GAIN = 10.0  # improvement of the criterion, compared with no filter
LARGEST_FLOOR = 0.1  # largest F² over the white noise before the filter
_PENALTY = 4.0  # penalty for a shape other than one pole, and for a floor
_STARTS = (0.02, 0.05, 0.12, 0.25, 0.42)  # f_c Δ
_LOW_STARTS = (0.0008, 0.004)  # additional f_c Δ for one pole
_START_ROUNDS, _ROUNDS, _HALVINGS = 3, 40, 12
_POLISHED = 5
_STEP = 0.7  # largest step of ln f_c
_SLOPE_STEP = 0.01  # step of ln f_c for its derivative
_LOWEST = 1e-5  # f_c Δ
_HOPELESS = 1.0  # gain in L at the start values, below which no fit is refined
_OFFSET = 0.2  # shift of ln f_c, because the coefficient of its column must be ≥ 0
_CONVERGED = 1e-4  # of L
_AT_LIMIT = 0.99


@dataclass(frozen=True, eq=False)
class FilterFit:
    """A filter shape fitted to bins.

    Parameters
    ----------
    shape : FilterShape
    log_cutoff : float
        Logarithm of the cut-off, ln (f_c Δ).
    theta : (p,) array
        Squared coefficients of the terms, followed by F².
    has_floor : bool
        Whether F² is fitted.
    known_floor : float
        Known part of F², SI².
    loss : float
    criterion : float
        Bayesian criterion, including the penalties.
    """

    shape: FilterShape
    log_cutoff: float
    theta: Array
    has_floor: bool
    known_floor: float
    loss: float
    criterion: float = np.inf

    @property
    def cutoff(self) -> float:
        """Cut-off as f_c Δ."""
        return float(np.exp(self.log_cutoff))

    @property
    def white(self) -> float:
        """N² in the pass band (plateau), SI²."""
        return float(self.theta[0])

    @property
    def floor(self) -> float:
        """Fitted part of F², SI²."""
        return float(self.theta[-1])

    @property
    def is_possible(self) -> bool:
        """Whether this can be a filter: small floor, and cut-off below half the sampling rate."""
        if self.floor > LARGEST_FLOOR * (self.white - self.floor - self.known_floor):
            return False
        return not self.shape.has_cutoff or self.cutoff < _AT_LIMIT * self.shape.highest


@dataclass(frozen=True, eq=False)
class FilterSearch:
    """The best filter, and how much the criterion improves compared with no filter.

    Parameters
    ----------
    best : FilterFit
    gain : float
    white_spread : float
        Relative standard deviation of N between all shapes, weighted by the criterion.
    """

    best: FilterFit
    gain: float
    white_spread: float

    @property
    def is_better(self) -> bool:
        """Whether a filter describes the recording sufficiently better than no filter."""
        return self.gain > NEEDED_GAIN


class _Problem:
    """Fits of filter shapes to bins."""

    def __init__(self, bins: Bins, known_floor: float):
        self.power, self.weight = bins.power, bins.weight
        self.base = np.stack([bins.basis(one) for one in BEFORE_FILTER], axis=1)
        self.white = self.base[:, 0]
        self.known_floor = known_floor
        self.low, self.high = (2 * np.pi * one * bins.dt for one in bins.ends)
        self.scale = float(np.log(max(bins.weight.sum(), 2.0)))

    def response(self, shape: FilterShape, x: float) -> Array:
        return output_filter.mean_power(shape, self.low, self.high, float(np.exp(x)))

    def columns(self, response: Array, *, floor: bool) -> Array:
        columns = self.base * response[:, None]
        return np.column_stack([columns, (1 - response) * self.white]) if floor else columns

    def slope(self, shape: FilterShape, x: float, theta: Array, floor: float) -> Array:
        """Return dS/d ln f_c."""
        change = self.response(shape, x + _SLOPE_STEP) - self.response(shape, x - _SLOPE_STEP)
        terms = self.base @ theta - (floor + self.known_floor) * self.white
        return change / (2 * _SLOPE_STEP) * terms

    def fit(self, shape: FilterShape, x: float, rounds: int, *, floor: bool) -> FilterFit:
        """Fit a shape with some rounds of scoring, starting from ln (f_c Δ) = x."""
        top, bottom = float(np.log(shape.highest)), float(np.log(_LOWEST))
        terms = self.base.shape[1]
        response = self.response(shape, x)
        columns = self.columns(response, floor=floor)
        known = self.known_floor * (1 - response) * self.white
        theta = coarse_fit(self.power, self.weight, columns, known)
        theta[0] = max(theta[0], 1e-9 * float(np.median(self.power / self.white)))
        model = columns @ theta + known
        value = loss(self.power, self.weight, model)
        for _ in range(rounds):
            scoring = np.sqrt(self.weight / 2) / model
            asked, target = columns, self.power - known
            if shape.has_cutoff:
                slope = self.slope(shape, x, theta[:terms], theta[-1] if floor else 0.0)
                asked = np.column_stack([columns, slope])
                target = target + _STEP * slope
            found = nonnegative_least_squares(asked * scoring[:, None], target * scoring)
            move = float(found[-1] - _STEP) if shape.has_cutoff else 0.0
            step = found[: theta.size] - theta
            if abs(move) > _STEP:
                step, move = step * (_STEP / abs(move)), float(np.clip(move, -_STEP, _STEP))
            before = value
            for _ in range(_HALVINGS):
                at = float(np.clip(x + move, bottom, top))
                if move:
                    response = self.response(shape, at)
                    columns = self.columns(response, floor=floor)
                    known = self.known_floor * (1 - response) * self.white
                trial = columns @ (theta + step) + known
                if (trial > 0).all() and (new := loss(self.power, self.weight, trial)) <= value:
                    x, theta, model, value = at, theta + step, trial, new
                    break
                step, move = step / 2, move / 2
            else:
                break
            if before - value <= _CONVERGED:
                break
        count = theta.size + shape.has_cutoff
        penalty = _PENALTY * ((shape is not output_filter.SHAPES[0]) + floor)
        criterion = 2 * value + count * self.scale + penalty
        theta = theta if floor else np.append(theta, 0.0)
        return FilterFit(shape, x, theta, floor, self.known_floor, value, criterion)


def _starts(shape: FilterShape) -> tuple[float, ...]:
    """Return the start values of f_c Δ; an average has no f_c and gets an arbitrary value."""
    if not shape.has_cutoff:
        return _STARTS[-1:]
    return (*_LOW_STARTS, *_STARTS) if shape is output_filter.SHAPES[0] else _STARTS


def find_filter(bins: Bins, known_floor: float) -> FilterSearch | None:
    """Return the best filter for a recording; None if no shape improves the fit noticeably.

    Parameters
    ----------
    bins : Bins
        Fine bins.
    known_floor : float
        F² due to rounding of the readings, in the SI unit of N²; 0 if no rounding step is known.
    """
    problem = _Problem(bins, known_floor)
    _, plain = scored_fit(bins.power, bins.weight, problem.base)
    starts = [
        problem.fit(shape, float(np.log(c)), _START_ROUNDS, floor=False)
        for shape in output_filter.SHAPES
        for c in _starts(shape)
    ]
    starts.sort(key=lambda one: one.criterion)
    if min(one.loss for one in starts) > plain - _HOPELESS:
        return None
    polished = [
        problem.fit(one.shape, one.log_cutoff, _ROUNDS, floor=floor)
        for one in starts[:_POLISHED]
        for floor in (False, True)
    ]
    polished.sort(key=lambda one: one.criterion)
    best = polished[0]
    without = 2 * plain + len(BEFORE_FILTER) * problem.scale
    weight = np.exp(-0.5 * np.array([one.criterion - best.criterion for one in polished]))
    # Fits of the same shape that converge to the same cut-off are one candidate.
    for k, one in enumerate(polished):
        alike = [other for other in polished[:k] if other.shape is one.shape]
        near = [other for other in alike if abs(one.log_cutoff - other.log_cutoff) < _SLOPE_STEP]
        if any(one.has_floor == other.has_floor for other in near):
            weight[k] = 0
    values = np.sqrt([max(one.white, 0.0) for one in polished]) / np.sqrt(max(best.white, 1e-300))
    mean = float(weight @ values / weight.sum())
    spread = float(np.sqrt(weight @ (values - mean) ** 2 / weight.sum()))
    return FilterSearch(best, without - best.criterion, spread)


def apply_filter(bins: Bins, search: FilterSearch) -> Bins:
    """Return bins with the best filter of a search; its cut-off and floor are still fitted.

    Parameters
    ----------
    bins : Bins
        Fine bins.
    search : FilterSearch
    """
    fit = search.best
    problem = _Problem(bins, fit.known_floor)
    response = problem.response(fit.shape, fit.log_cutoff)
    columns: list[Array] = []
    start: list[float] = []
    known = fit.known_floor * (1 - response) * problem.white
    relative = 0.0
    if fit.shape.has_cutoff:
        slope = problem.slope(fit.shape, fit.log_cutoff, fit.theta[:-1], fit.floor)
        free = problem.columns(response, floor=fit.has_floor)
        model = free @ fit.theta[: free.shape[1]] + known
        covariance = information_inverse(bins.weight, np.column_stack([free, slope]), model)
        relative = float(np.sqrt(covariance[-1, -1]))
        columns.append(slope)
        start.append(_OFFSET)
        known = known - _OFFSET * slope
    if fit.has_floor:
        columns.append((1 - response) * problem.white)
        start.append(fit.floor)
    cutoff = fit.cutoff / bins.dt if fit.shape.has_cutoff else float("nan")
    output = OutputFilter(
        fit.shape,
        cutoff,
        max(relative, output_filter.LEAST_RELATIVE_U) * cutoff,
        bins.dt,
        fit.floor + fit.known_floor,
        fit.known_floor,
        search.white_spread,
        search.gain,
    )
    nuisance = np.stack(columns, axis=1) if columns else np.zeros((bins.power.size, 0))
    return replace(bins, effect=FilterEffect(output, response, known, nuisance, np.array(start)))


def settled_filter(bins: Bins, fit: NoiseFit) -> OutputFilter | None:
    """Return the filter with the fitted cut-off and floor; None if the bins are not filtered."""
    if bins.effect is None:
        return None
    output, nuisance = bins.effect.output, fit.nuisance
    if output.shape.has_cutoff:
        relative = max(float(fit.nuisance_u[0]), output_filter.LEAST_RELATIVE_U)
        cutoff = output.cutoff * float(np.exp(nuisance[0] - _OFFSET))
        output = replace(output, cutoff=cutoff, u=relative * cutoff)
    if nuisance.size > output.shape.has_cutoff:
        output = replace(output, floor=float(nuisance[-1]) + output.known_floor)
    return output
