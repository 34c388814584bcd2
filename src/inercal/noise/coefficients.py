"""Convert a fit to coefficients with uncertainties, and say what a recording cannot show.

The recording time needed for a required uncertainty follows from the information in the spectrum. A
recording of length T has the frequencies k/2T. The covariance of the variances θ is [½ Σ_k e
eᵀ/S²]⁻¹, with all k up to the Nyquist frequency, and u of a coefficient is u(θ)/2√θ. If the
uncertainty of a term exceeds its value, such a recording does not show the term. The term is then
not fitted, which reduces the uncertainty of the other terms.
"""

from dataclasses import replace
from math import hypot
from typing import Literal, get_args

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_duration
from inercal.noise.channel_noise import NoiseCoefficient, coefficient_unit
from inercal.noise.cross_checks import Estimates, gmwm, slopes, wls_log
from inercal.noise.deviations import Deviations
from inercal.noise.filter_search import ADDED_RELATIVE_U, settled_filter
from inercal.noise.likelihood import (
    PROFILE_ONE_SIDED,
    PROFILE_TWO_SIDED,
    NoiseFit,
    fit_terms,
    profile_limits,
)
from inercal.noise.numerics import pseudo_inverse
from inercal.noise.selection import Selection, Significance, is_time_limit, significance_limit
from inercal.noise.spectrum import Bins
from inercal.noise.terms import FLICKER_FLOOR, TERMS, model_psd
from inercal.physics.quantities import SensorKind

Method = Literal["likelihood", "gmwm", "wls_log"]
METHODS: tuple[str, ...] = get_args(Method)
_RUNNERS_UP = 4.0  # other models up to this AIC difference are named
_GMWM_LONGEST = 1 << 18  # block means; the covariance of all pairs of averaging times limits it
_BINS = 200
_SINGLE = 32
_LONGEST = 1e9  # s
_SEEN = 1.0  # largest relative uncertainty of a term that is fitted


def possible_method(
    method: Method, n: int, *, single: bool, bins: Bins
) -> tuple[Method, tuple[str, ...]]:
    """Return the method, or the likelihood if GMWM is not possible, and remarks about this.

    Parameters
    ----------
    method : "likelihood", "gmwm" or "wls_log"
    n : int
        Number of samples in the longest piece.
    single : bool
        Whether there is only one piece; GMWM cannot join pieces.
    bins : Bins
        Bins of the fit. GMWM cannot model a sensor's filter, and it needs all averaging times.
    """
    if method != "gmwm":
        return method, ()
    if bins.output is not None or bins.limit < np.inf:
        why = "the sensor has its own low-pass filter"
    elif not single:
        why = "the recording has gaps"
    elif n > _GMWM_LONGEST:
        why = f"{n} samples are more than its limit of {_GMWM_LONGEST}"
    else:
        return method, ()
    return "likelihood", (f"gmwm is not possible because {why}, so the likelihood is reported",)


def estimate_coefficients(
    selection: Selection,
    bins: Bins,
    oadev: Deviations,
    quantity: SensorKind,
    method: Method,
    n: int,
) -> tuple[tuple[NoiseCoefficient, ...], dict[str, Estimates]]:
    """Return the coefficients from one method, and the estimates of the other methods, SI.

    If B or K is not significant or not in the model, only its upper limit is returned.

    Parameters
    ----------
    selection : Selection
    bins : Bins
    oadev : Deviations
        Overlapping Allan deviation at octaves.
    quantity : "gyro" or "accelerometer"
    method : "likelihood", "gmwm" or "wls_log"
        Method to use; see `possible_method`.
    n : int
        Number of block means in the longest piece.
    """
    fit = selection.fit
    comparison: dict[str, Estimates] = {"likelihood": _likelihood_estimates(selection, bins)}
    long = _longer(oadev, 1 / bins.limit)
    if long.tau.size > len(fit.symbols):
        comparison["wls_log"] = wls_log(
            long, fit.symbols, bins.dt, fit.markov_time, settled_filter(bins, fit)
        )
        comparison["slopes"] = slopes(long)
    if method == "gmwm":
        comparison["gmwm"] = gmwm(oadev, fit.symbols, bins.dt, fit.markov_time, fit.variances, n)
    chosen = comparison.get(method, comparison["likelihood"])
    hidden = hidden_terms(selection, n * bins.dt)
    found: list[NoiseCoefficient] = []
    for symbol in fit.symbols:
        test = selection.significance.get(symbol)
        absent = test is not None and not test.is_present
        limited = symbol in hidden or (absent and not selection.is_asked)
        estimate = (0.0, np.inf) if limited else chosen[symbol]
        is_open = test is not None and (absent or test.is_replaced)
        found.append(_coefficient(symbol, estimate, fit, bins, quantity, test, is_open=is_open))
    if "N" in fit.symbols:
        found += [_absent(one, fit, bins, quantity) for one in "BK" if one not in fit.symbols]
    order = list(TERMS)
    found.sort(key=lambda one: order.index(one.symbol))
    if "G" in fit.symbols:
        found.append(_time_constant(fit, bins))
    return tuple(found), comparison


def _longer(oadev: Deviations, shortest: float) -> Deviations:
    """Return the deviations at averaging times of at least `shortest`, s."""
    kept = oadev.tau >= shortest
    arrays = {
        name: getattr(oadev, name)[kept] for name in ("tau", "value", "low", "high", "edf", "count")
    }
    label = tuple(one for one, here in zip(oadev.label, kept, strict=True) if here)
    return replace(oadev, label=label, **arrays)


def _time_constant(fit: NoiseFit, bins: Bins) -> NoiseCoefficient:
    """Return T; at an end of the grid of tried values, T is only a limit without uncertainty."""
    time, name = fit.markov_time, "time constant"
    if is_time_limit(bins, fit):
        short = time < float(np.sqrt(bins.times[0] * bins.times[-1]))
        low, high = (0.0, time) if short else (time, np.inf)
        return NoiseCoefficient("T", name, time, np.inf, low, high, "s")
    u = float(np.sqrt(fit.covariance[-1, -1])) * time
    spread = np.exp(2 * u / time)
    return NoiseCoefficient("T", name, time, u, time / spread, time * spread, "s")


def _absent(symbol: str, fit: NoiseFit, bins: Bins, quantity: SensorKind) -> NoiseCoefficient:
    """Return the upper limit of a term that is not in the model."""
    time = fit.markov_time if "G" in fit.symbols else None
    wider = fit_terms(bins, (*fit.symbols, symbol), time)
    test = Significance(max(2 * (fit.loss - wider.loss), 0.0), significance_limit(symbol))
    return _coefficient(symbol, (0.0, np.inf), wider, bins, quantity, test)


def _likelihood_estimates(selection: Selection, bins: Bins) -> Estimates:
    fit = selection.fit
    found: Estimates = {}
    for j, symbol in enumerate(fit.symbols):
        value = float(np.sqrt(fit.variances[j]))
        u = float(np.sqrt(fit.covariance[j, j])) / (2 * value) if value > 0 else np.inf
        found[symbol] = (value, hypot(u, _white_spread(bins) * value) if symbol == "N" else u)
    return found


def _white_spread(bins: Bins) -> float:
    """Return the relative standard deviation of N due to the choice of filter or band."""
    if bins.limit < np.inf:
        return ADDED_RELATIVE_U
    return 0.0 if bins.output is None else bins.output.white_spread


def _coefficient(
    symbol: str,
    estimate: tuple[float, float],
    fit: NoiseFit,
    bins: Bins,
    quantity: SensorKind,
    test: Significance | None,
    *,
    is_open: bool = False,
) -> NoiseCoefficient:
    value, u = estimate
    unit, name = coefficient_unit(symbol, quantity), TERMS[symbol].name
    tested = (0.0, 0.0) if test is None else (test.ratio, test.limit)
    known = value > 0
    low, high = profile_limits(bins, fit, symbol, PROFILE_TWO_SIDED if known else PROFILE_ONE_SIDED)
    if not known:
        return NoiseCoefficient(symbol, name, 0.0, np.inf, 0.0, high, unit, *tested)
    if symbol == "N" and (spread := 2 * _white_spread(bins) * value):
        low = max(value - hypot(value - low, spread), 0.0)
        high = value + hypot(high - value, spread)
    return NoiseCoefficient(symbol, name, value, u, low, high, unit, *tested, is_open)


def undetermined(selection: Selection, seconds: float) -> list[str]:
    """Return remarks on models that fit equally well, and on terms hidden by white noise.

    Parameters
    ----------
    selection : Selection
    seconds : float
        Length of the longest piece, s.
    """
    fit = selection.fit
    found: list[str] = []
    rivals = [
        one
        for one in selection.rivals
        if one.aic - fit.aic <= _RUNNERS_UP and one.symbols != fit.symbols
    ]
    if rivals:
        names = " or ".join(" + ".join(one.symbols) for one in rivals)
        more = ", ".join(f"{one.aic - fit.aic:+.1f}" for one in rivals)
        why = ", but G is not significant" if rivals[0].aic < fit.aic else ""
        found.append(
            f"{names} would also describe the recording (difference of AIC from "
            f"{' + '.join(fit.symbols)}: {more}; a smaller AIC is better{why})"
        )
    if hidden := hidden_terms(selection, seconds):
        found.append(
            f"white noise hides {' and '.join(hidden)} at all averaging times up to the longest, "
            f"{format_duration(seconds / 2)}, so only an upper limit is stated; record longer"
        )
    return found


def hidden_terms(selection: Selection, seconds: float) -> tuple[str, ...]:
    """Return which of B and K cannot be seen, because white noise always exceeds their effect.

    Parameters
    ----------
    selection : Selection
    seconds : float
        Length of the longest piece, s. The longest averaging time is half of this length.
    """
    fit = selection.fit
    white, flicker, walk = (fit.variance(one) for one in "NBK")
    longest = seconds / 2
    # A term is hidden if its Allan variance only reaches the Allan variance of white noise beyond
    # the longest averaging time.
    if flicker > 0 and white / (FLICKER_FLOOR * flicker) > longest:
        return tuple(one for one in fit.symbols if one in "BK")
    if flicker == 0 and walk > 0 and np.sqrt(3 * white / walk) > longest:
        return ("K",)
    return ()


def relative_uncertainties(
    variances: dict[str, float], dt: float, length: float, markov_time: float = 1.0
) -> dict[str, float]:
    """Return u/value of each nonzero coefficient for a recording with a given length.

    Parameters
    ----------
    variances : mapping of symbol to float
        Squared coefficients, SI².
    dt : float
        Sampling interval, s.
    length : float
        Length of the recording, s.
    markov_time : float
        Time constant T of the Gauss–Markov process, s, assumed to be known.
    """
    symbols = [symbol for symbol, value in variances.items() if value > 0]
    n = max(int(length / dt), 4)
    edges = np.unique(
        np.concatenate(
            [np.arange(1, min(_SINGLE, n)), np.geomspace(min(_SINGLE, n), n, _BINS).round()]
        )
    )
    middle: Array = np.sqrt(edges[:-1] * np.maximum(edges[1:] - 1.0, 1.0))
    frequency, count = middle / (2 * n * dt), np.diff(edges)
    columns = np.stack(
        [variances[one] * model_psd({one: 1.0}, frequency, dt, markov_time) for one in symbols], 1
    )
    scaled = columns / columns.sum(axis=1, keepdims=True) * np.sqrt(count / 2)[:, None]
    found = dict.fromkeys(symbols, np.inf)
    seen = list(range(len(symbols)))
    while seen:
        part = scaled[:, seen]
        covariance = pseudo_inverse(part.T @ part)
        relative = np.sqrt(np.diag(covariance)) / 2
        worst = int(np.argmax(relative))
        if relative[worst] <= _SEEN:
            found |= {symbols[j]: float(u) for j, u in zip(seen, relative, strict=True)}
            break
        del seen[worst]
    return found


def length_for(
    variances: dict[str, float], dt: float, symbol: str, relative: float, markov_time: float = 1.0
) -> float:
    """Return the recording length, s, needed for a relative u; infinite above 30 years."""
    low, high = 16 * dt, _LONGEST
    if relative_uncertainties(variances, dt, high, markov_time).get(symbol, np.inf) > relative:
        return np.inf
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        if relative_uncertainties(variances, dt, middle, markov_time)[symbol] > relative:
            low = middle
        else:
            high = middle
    return high
