"""The noise of a channel from the summary of its samples: filter, fit, drift, goodness."""

from dataclasses import replace

import numpy as np

from inercal.noise.channel_model import ChannelSummary, find_model
from inercal.noise.channel_noise import ChannelNoise, NoiseCoefficient
from inercal.noise.coefficients import (
    Method,
    estimate_coefficients,
    possible_method,
    undetermined,
)
from inercal.noise.cross_checks import Estimates
from inercal.noise.filter_search import settled_filter
from inercal.noise.goodness import judge_fit
from inercal.noise.likelihood import extended
from inercal.noise.spectrum import make_bins


def conclude(one: ChannelSummary, candidates: tuple[str, ...], method: Method) -> ChannelNoise:
    """Return the noise of a channel.

    Parameters
    ----------
    one : ChannelSummary
    candidates : tuple of str
        Models to choose from.
    method : "likelihood", "gmwm" or "wls_log"
    """
    model = find_model(one, candidates)
    selection, bins = model.selection, model.bins
    used, why = possible_method(method, one.longest, single=one.low_values is not None, bins=bins)
    coefficients: tuple[NoiseCoefficient, ...] = ()
    comparison: dict[str, Estimates] = {}
    remarks: list[str] = []
    if model.refusal is None:
        coefficients, comparison = estimate_coefficients(
            selection, bins, one.octaves, one.quantity, used, one.longest
        )
        remarks = undetermined(selection, bins, one.longest * one.dt)
    output, band = settled_filter(bins, selection.fit), bins.limit
    if band < np.inf:
        # The whole spectrum is judged by what its lower part says.
        bins = make_bins(one.spectra, one.dt, fine=bins.fine)
        selection = replace(selection, fit=extended(selection.fit, bins))
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
        () if model.drift is None else model.drift.terms,
        (*one.remarks, *why, *remarks),
        comparison,
        used,
        output,
        band,
        model.refusal,
    )
