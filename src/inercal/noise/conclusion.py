"""The noise of a channel from the summary of its samples: fit, drift, goodness."""

from dataclasses import dataclass

from inercal.arrays import Array
from inercal.noise.channel_noise import ChannelNoise, Quantity
from inercal.noise.coefficients import (
    Method,
    estimate_coefficients,
    possible_method,
    undetermined,
)
from inercal.noise.deviations import Deviations
from inercal.noise.disturbances import Disturbance
from inercal.noise.drift_regression import find_drift
from inercal.noise.goodness import judge_fit
from inercal.noise.lines import SpectralLine
from inercal.noise.selection import select_terms
from inercal.noise.spectrum import Spectrum, make_bins


@dataclass(frozen=True, eq=False)
class ChannelSummary:
    """Spectra, deviations and disturbances of a channel, from which its noise follows, SI.

    Parameters
    ----------
    channel : str
    quantity : "gyro" or "accelerometer"
    n, longest : int
        Samples in all pieces, and in the longest.
    dt : float
        Δ, s.
    mean : float
    spectra : tuple of Spectrum
        Without lines; those of low frequencies first.
    lines : tuple of SpectralLine
    octaves : Deviations
        Overlapping Allan deviation at octaves, for the estimates.
    deviations : dict of kind to Deviations
        To report.
    disturbances : tuple of Disturbance
    remarks : tuple of str
    low_values : (k,) array or None
        Means whose transform is spectra[0]; None of several pieces.
    regressors : dict of name to (k,) array
        Of the drift.
    """

    channel: str
    quantity: Quantity
    n: int
    longest: int
    dt: float
    mean: float
    spectra: tuple[Spectrum, ...]
    lines: tuple[SpectralLine, ...]
    octaves: Deviations
    deviations: dict[str, Deviations]
    disturbances: tuple[Disturbance, ...]
    remarks: tuple[str, ...]
    low_values: Array | None
    regressors: dict[str, Array]


def conclude(one: ChannelSummary, candidates: tuple[str, ...], method: Method) -> ChannelNoise:
    """Return the noise of a channel.

    Parameters
    ----------
    one : ChannelSummary
    candidates : tuple of str
        Models to choose from.
    method : "likelihood", "gmwm" or "wls_log"
    """
    bins = make_bins(one.spectra, one.dt)
    selection = select_terms(bins, candidates)
    drift = None
    if one.low_values is not None and one.regressors:
        drift = find_drift(
            one.low_values, one.spectra, one.regressors, one.dt, selection, candidates
        )
    if drift is not None:
        selection, bins = drift.selection, drift.bins
    used, why = possible_method(method, one.longest, single=one.low_values is not None)
    coefficients, comparison = estimate_coefficients(
        selection, bins, one.octaves, one.quantity, used, one.longest
    )
    return ChannelNoise(
        one.channel,
        one.quantity,
        one.n,
        one.dt,
        one.mean,
        coefficients,
        one.deviations,
        selection,
        bins,
        judge_fit(bins, selection.fit, one.octaves),
        one.lines,
        one.disturbances,
        () if drift is None else drift.terms,
        (*one.remarks, *why, *undetermined(selection, bins, one.longest * one.dt)),
        comparison,
        used,
    )
