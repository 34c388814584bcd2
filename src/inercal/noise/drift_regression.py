"""Include a deterministic drift in the likelihood: a ramp and a dependence on temperature.

    c = X β + e,   E e² = S        L = ½ Σ [ln S + (c − Xβ)²/S] + ½ ln|Xᵀ S⁻¹ X|   (REML)

The regressors X are transformed like the data. If a straight line were fitted and removed first,
part of the random walk would also be removed. The median of K would then be 0.91 of the true value;
with REML, it is 0.994.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.noise.likelihood import NoiseFit, fit_again
from inercal.noise.numerics import dct2, pseudo_inverse
from inercal.noise.selection import CANDIDATES, Selection, select_terms
from inercal.noise.spectrum import Bins, Spectrum, expected_periodogram

DRIFT_RATIO = 10.83  # required drop of 2 L to include a ramp (0.1 %)
_MEASURED_RATIO = 6.63  # required drop of the AIC for a measured cause, the temperature (1 %)
_WARM_UPS = (1.0, 3.0, 8.0)  # length of the recording, in time constants
_ROUNDS = 4


@dataclass(frozen=True)
class DriftTerm:
    """One regressor of the drift.

    Parameters
    ----------
    name : "ramp", "temperature" or "temperature rate"
    value, u : float
        Coefficient and its standard uncertainty in SI, per s, per K or per K/s.
    """

    name: str
    value: float
    u: float


@dataclass(frozen=True, eq=False)
class DriftFit:
    """The noise terms, fitted together with a drift.

    Parameters
    ----------
    selection : Selection
    bins : Bins
        Bins of the data after removal of the drift, with the REML correction.
    terms : tuple of DriftTerm
    loss : float
        L at the minimum, without the REML correction.
    """

    selection: Selection
    bins: Bins
    terms: tuple[DriftTerm, ...]
    loss: float


class LowPiece(NamedTuple):
    """Block means of a piece without gaps, whose transform is a spectrum of low frequencies.

    Parameters
    ----------
    place : int
        Index of the spectrum.
    start, dt : float
        Start after the first sample of the recording, and time between block means, s.
    values : (k,) array
    temperature : (k,) array or None
        Block means of the temperature, K; ignored if their number differs.
    """

    place: int
    start: float
    dt: float
    values: Array
    temperature: Array | None


@dataclass(frozen=True, eq=False)
class LowFrequencies:
    """Block means of all pieces, one after another, and regressors for their drift.

    Parameters
    ----------
    values : (k,) array
    places : tuple of int
        Index of each piece's spectrum.
    regressors : dict of name to (k,) array
        A ramp, the temperature and its rate.
    """

    values: Array
    places: tuple[int, ...]
    regressors: dict[str, Array]

    @classmethod
    def of(cls, pieces: Sequence[LowPiece]) -> "LowFrequencies":
        """Return the block means of these pieces; a constant temperature is no regressor."""
        time = [one.start + np.arange(float(one.values.size)) * one.dt for one in pieces]
        regressors: dict[str, Array] = {"ramp": np.concatenate(time)}
        warmth = [
            one.temperature
            for one in pieces
            if one.temperature is not None and one.temperature.size == one.values.size
        ]
        if len(warmth) == len(pieces) and np.ptp(temperature := np.concatenate(warmth)) > 0:
            rates = [np.gradient(own, one.dt) for own, one in zip(warmth, pieces, strict=True)]
            regressors["temperature"] = temperature
            regressors["temperature rate"] = np.concatenate(rates)
        values = np.concatenate([one.values for one in pieces])
        return cls(values, tuple(one.place for one in pieces), regressors)

    def transform(self, values: Array, spectra: Sequence[Spectrum]) -> Array:
        """Return the transform of each piece without its mean, (k − pieces, …)."""
        ends = np.cumsum([spectra[place].n for place in self.places])[:-1]
        return np.concatenate([_transform(one) for one in np.split(values, ends)])


def _transform(values: Array) -> Array:
    return dct2(values - values.mean(axis=0), axis=0)[1:]


def _model(fit: NoiseFit, low: Spectrum, bins: Bins) -> Array:
    """Return S for each low-frequency coefficient, (n−1,)."""
    total = np.zeros(low.n - 1)
    for symbol, variance in fit.as_variances.items():
        time = fit.markov_time if symbol == "G" else 1.0
        total += variance * expected_periodogram(symbol, low.n, low.dt, time)
    if (output := bins.output) is not None:
        power = output.power(np.arange(1, low.n) / (2 * low.n * low.dt))
        white = expected_periodogram("N", low.n, low.dt)
        total = power * total + output.floor * (1 - power) * white
    return total


def _generalised(c: Array, x: Array, model: Array, kept: Bools) -> tuple[Array, Array, Array]:
    """Return β, its covariance, and the share of each coefficient that β explains."""
    weight = kept / model
    size = np.sqrt((x**2).sum(axis=0))
    scaled = x / size
    covariance = pseudo_inverse(scaled.T @ (scaled * weight[:, None]))
    beta = covariance @ (scaled.T @ (weight * c))
    leverage = np.einsum("ki,ij,kj->k", scaled, covariance, scaled)
    return beta / size, covariance / np.outer(size, size), leverage


def fit_drift(
    low: LowFrequencies,
    spectra: tuple[Spectrum, ...],
    regressors: dict[str, Array],
    bins: Bins,
    candidates: tuple[str, ...] = CANDIDATES,
) -> DriftFit:
    """Fit the noise terms together with these regressors.

    Parameters
    ----------
    low : LowFrequencies
    spectra : tuple of Spectrum
    regressors : mapping of name to (k,) array
    bins : Bins
        Bins of the spectra, without a drift.
    candidates : tuple of str
        Models to choose from; see `inercal.noise.selection.select_terms`.
    """
    names = tuple(regressors)
    x = low.transform(np.column_stack([regressors[name] for name in names]), spectra)
    c = low.transform(low.values, spectra)
    own = [spectra[place] for place in low.places]
    kept = np.concatenate([one.kept for one in own])
    beta = _generalised(c, x, np.ones_like(c), kept)[0]
    bins = _residual_bins(c, x, beta, low.places, spectra, bins)
    selection = select_terms(bins, candidates)
    covariance = np.zeros((len(names), len(names)))
    for _ in range(_ROUNDS):
        model = np.concatenate([_model(selection.fit, one, bins) for one in own])
        beta, covariance, leverage = _generalised(c, x, model, kept)
        bins = _residual_bins(c, x, beta, low.places, spectra, bins, leverage)
        selection = replace(selection, fit=fit_again(bins, selection.fit))
    final = select_terms(bins, candidates)
    plain = _residual_bins(c, x, beta, low.places, spectra, bins)
    sd = np.sqrt(np.diag(covariance))
    terms = tuple(
        DriftTerm(*one) for one in zip(names, map(float, beta), map(float, sd), strict=True)
    )
    return DriftFit(final, bins, terms, fit_again(plain, final.fit).loss)


def _residual_bins(
    c: Array,
    x: Array,
    beta: Array,
    places: Sequence[int],
    spectra: tuple[Spectrum, ...],
    bins: Bins,
    leverage: Array | None = None,
) -> Bins:
    power = (c - x @ beta) ** 2
    if leverage is not None:
        power = power + leverage
    ends = np.cumsum([spectra[place].n - 1 for place in places])[:-1]
    every = list(spectra)
    for place, own in zip(places, np.split(power, ends), strict=True):
        every[place] = replace(spectra[place], power=own)
    return bins.bins_of(tuple(every))


def find_drift(
    low: LowFrequencies,
    spectra: tuple[Spectrum, ...],
    bins: Bins,
    selection: Selection,
    candidates: tuple[str, ...] = CANDIDATES,
) -> DriftFit | None:
    """Return the drift in the data; None if no term improves the fit enough.

    A ramp looks like a random walk and must reduce 2 L by 10.83. The temperature is a measured
    cause and must reduce Akaike's criterion by 6.63, because it often makes the walk unnecessary.

    Parameters
    ----------
    low, spectra, bins, candidates
        See `fit_drift`.
    selection : Selection
        Selection without a drift.
    """
    found: DriftFit | None = None
    taken: dict[str, Array] = {}
    least, loss = _criterion(selection, selection.fit.loss), selection.fit.loss
    while len(taken) < len(low.regressors):
        trials = {
            name: fit_drift(low, spectra, {**taken, name: values}, bins, candidates)
            for name, values in low.regressors.items()
            if name not in taken
        }
        gains = {
            name: 2 * (loss - one.loss)
            if name == "ramp"
            else least - _criterion(one.selection, one.loss)
            for name, one in trials.items()
        }
        name = max(gains, key=gains.__getitem__)
        if gains[name] < (DRIFT_RATIO if name == "ramp" else _MEASURED_RATIO):
            break
        found, loss = trials[name], trials[name].loss
        least = _criterion(found.selection, loss)
        taken[name] = low.regressors[name]
    return found


def _criterion(selection: Selection, loss: float) -> float:
    """Return Akaike's criterion for the likelihood without the REML correction."""
    return 2 * loss + selection.fit.aic - 2 * selection.fit.loss


def warm_up_size(
    low: LowFrequencies,
    spectra: tuple[Spectrum, ...],
    drift: Sequence[DriftTerm],
    bins: Bins,
    fit: NoiseFit,
    loss: float,
) -> float:
    """Return by how much a warm-up, e^{−t/τ}, changes a bias that seems to walk; 0 if it walks.

    Parameters
    ----------
    low, spectra, bins
        See `fit_drift`.
    drift : sequence of DriftTerm
        The drift that the fit contains.
    fit : NoiseFit
        The fit with a random walk and without a warm-up.
    loss : float
        Its L at the minimum, without the REML correction.
    """
    taken = {one.name: low.regressors[one.name] for one in drift}
    time = low.regressors["ramp"]
    shapes = (np.exp(-one * (time - time[0]) / np.ptp(time)) for one in _WARM_UPS)
    terms = ("".join(fit.symbols),)
    found = [fit_drift(low, spectra, {**taken, "warm-up": one}, bins, terms) for one in shapes]
    best = min(found, key=lambda one: one.loss)
    return best.terms[-1].value * (2 * (loss - best.loss) > DRIFT_RATIO)
