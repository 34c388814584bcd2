"""From a fit to coefficients with their uncertainties, and what a recording cannot determine."""

from typing import Literal, get_args

import numpy as np

from inercal.noise.channel_noise import NoiseCoefficient, Quantity, coefficient_unit
from inercal.noise.cross_checks import Estimates, gmwm, slopes, wls_log
from inercal.noise.deviations import Deviations
from inercal.noise.likelihood import PROFILE_ONE_SIDED, PROFILE_TWO_SIDED, profile_limits
from inercal.noise.selection import Selection
from inercal.noise.spectrum import Bins
from inercal.noise.terms import FLICKER_FLOOR, TERMS

Method = Literal["likelihood", "gmwm", "wls_log"]
METHODS: tuple[str, ...] = get_args(Method)
_GMWM_LONGEST = 1 << 18  # block means, for the covariance of all pairs of averaging times


def possible_method(method: Method, n: int, *, single: bool) -> tuple[Method, tuple[str, ...]]:
    """Return the method, or the likelihood in place of GMWM that is not possible, and remarks.

    Parameters
    ----------
    method : "likelihood", "gmwm" or "wls_log"
    n : int
        Samples of the longest piece.
    single : bool
        Whether it is the only piece: GMWM joins none.
    """
    if method != "gmwm" or (single and n <= _GMWM_LONGEST):
        return method, ()
    why = f"{n} samples exceed its {_GMWM_LONGEST}" if single else "the recording has gaps"
    return "likelihood", (f"gmwm is not possible, {why}: the likelihood is reported",)


def estimate_coefficients(
    selection: Selection,
    bins: Bins,
    oadev: Deviations,
    quantity: Quantity,
    method: Method,
    n: int,
) -> tuple[tuple[NoiseCoefficient, ...], dict[str, Estimates]]:
    """Return the coefficients by a method, and the estimates of the other methods, SI.

    Parameters
    ----------
    selection : Selection
    bins : Bins
    oadev : Deviations
        At octaves.
    quantity : "gyro" or "accelerometer"
    method : "likelihood", "gmwm" or "wls_log"
        See `possible_method`.
    n : int
        Block means of the longest piece.
    """
    fit = selection.fit
    comparison: dict[str, Estimates] = {
        "likelihood": _likelihood_estimates(selection),
        "wls_log": wls_log(oadev, fit.symbols, bins.dt, fit.markov_time),
        "slopes": slopes(oadev),
    }
    if method == "gmwm":
        comparison["gmwm"] = gmwm(oadev, fit.symbols, bins.dt, fit.markov_time, fit.variances, n)
    chosen = comparison[method]
    hidden = hidden_terms(selection, n * bins.dt)
    found = [
        _coefficient(symbol, (0.0, np.inf), selection, bins, quantity)
        if symbol in hidden
        else _coefficient(symbol, chosen[symbol], selection, bins, quantity)
        for symbol in fit.symbols
    ]
    if "G" in fit.symbols:
        u = float(np.sqrt(fit.covariance[-1, -1])) * fit.markov_time
        spread = np.exp(2 * u / fit.markov_time)
        low, high = fit.markov_time / spread, fit.markov_time * spread
        found.append(NoiseCoefficient("T", "time constant", fit.markov_time, u, low, high, "s"))
    return tuple(found), comparison


def _likelihood_estimates(selection: Selection) -> Estimates:
    fit = selection.fit
    found: Estimates = {}
    for j, symbol in enumerate(fit.symbols):
        value = float(np.sqrt(fit.variances[j]))
        u = float(np.sqrt(fit.covariance[j, j])) / (2 * value) if value > 0 else np.inf
        found[symbol] = (value, u)
    return found


def _coefficient(
    symbol: str,
    estimate: tuple[float, float],
    selection: Selection,
    bins: Bins,
    quantity: Quantity,
) -> NoiseCoefficient:
    value, u = estimate
    unit, name = coefficient_unit(symbol, quantity), TERMS[symbol].name
    test = selection.significance.get(symbol)
    ratio, limit = (0.0, 0.0) if test is None else (test.ratio, test.limit)
    known = value > 0
    low, high = profile_limits(
        bins, selection.fit, symbol, PROFILE_TWO_SIDED if known else PROFILE_ONE_SIDED
    )
    if not known:
        return NoiseCoefficient(symbol, name, 0.0, np.inf, 0.0, high, unit, ratio, limit)
    return NoiseCoefficient(symbol, name, value, u, low, high, unit, ratio, limit)


def undetermined(selection: Selection, bins: Bins, seconds: float) -> list[str]:
    """Return remarks on models that fit alike, and on terms that white noise covers.

    Parameters
    ----------
    selection : Selection
    bins : Bins
    seconds : float
        Length of the longest piece, s.
    """
    fit = selection.fit
    found: list[str] = []
    rivals = [one for one in selection.runners_up if one.symbols != fit.symbols]
    if rivals:
        names = ", ".join(
            f"{' + '.join(one.symbols)} (AIC {one.aic - fit.aic:+.1f})" for one in rivals
        )
        found.append(f"the recording does not distinguish {' + '.join(fit.symbols)} from {names}")
    if hidden := hidden_terms(selection, seconds):
        found.append(
            f"white noise covers {' and '.join(hidden)} at all averaging times, of which the "
            f"longest is {seconds / 2:.3g} s: only an upper limit is stated; record longer"
        )
    return found


def hidden_terms(selection: Selection, seconds: float) -> tuple[str, ...]:
    """Return B and K where white noise exceeds the other terms at all averaging times.

    Parameters
    ----------
    selection : Selection
    seconds : float
        Length of the longest piece, s; its longest averaging time is half of it.
    """
    fit = selection.fit
    white, flicker, walk = (fit.variance(one) for one in "NBK")
    longest = seconds / 2
    if flicker > 0 and crossing_time(white, flicker) > longest:
        return tuple(one for one in fit.symbols if one in "BK")
    if flicker == 0 and walk > 0 and np.sqrt(3 * white / walk) > longest:
        return ("K",)
    return ()


def crossing_time(white: float, flicker: float) -> float:
    """Return τ_NB, s, at which the Allan variances of N², SI², and B² are equal."""
    return white / (FLICKER_FLOOR * flicker) if flicker > 0 else np.inf
