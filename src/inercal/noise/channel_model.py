"""Model the noise of a channel: its terms, the sensor's own filter, and the drift.

1. A filter is searched for (`filter_search`). It is accepted if the fit with this filter passes the
   test.
2. If there is no filter, the terms are fitted to the whole spectrum.
3. If this fit fails the test, only the band that the terms describe is used (`filter_search`).
4. N, B and K are not reported in two cases: if white noise behind a filter cannot be distinguished
   from bias instability, or if neither a known filter shape nor a band describes the spectrum.

White noise behind one pole at f_c has the same spectrum as a Gauss–Markov process with
T = 1/(2π f_c). White noise of the read-out distinguishes the two, because only a filter can
suppress all white noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.units import format_quantity
from inercal.noise import filter_search
from inercal.noise.channel_noise import ChannelNoise, NoiseCoefficient, NoiseRefusal
from inercal.noise.coefficients import Method, estimate_coefficients, possible_method, undetermined
from inercal.noise.cross_checks import Estimates
from inercal.noise.deviations import Deviations
from inercal.noise.disturbances import Disturbance, SpectralLine
from inercal.noise.drift_regression import DriftFit, LowFrequencies, find_drift, warm_up_size
from inercal.noise.filter_search import BEFORE_FILTER, FilterSearch
from inercal.noise.goodness import judge_fit
from inercal.noise.likelihood import extended, fit_terms
from inercal.noise.selection import Selection, select_terms
from inercal.noise.spectrum import Bins, Spectrum, make_bins
from inercal.noise.texts import SHOWN_UNIT
from inercal.physics.quantities import SensorKind

REFUSED = ("N", "B", "K")
_LEAST_CUTOFF = 2e-3  # f_c Δ; below it, a spectrum is attributed to a Gauss–Markov process
_LEAST_FLOOR = 1e-3  # F²/N², for white noise next to a Gauss–Markov process
_ROUNDING = 1.5  # largest N² of rounding noise (not quite white) over step² Δ/12
_LONGEST = 10.0  # s, largest 1/(2π f_c) of a filter
_LOW_CUTOFF, _WHITE_BESIDE_MARKOV = 2e-2, 0.1  # f_c Δ; N² over 2σ²T of a process behind it
_JUDGED = 0.1  # fraction of the cut-off above which the fit of a filter is tested
_AVERAGE_CUTOFF = 0.2  # f_c Δ used for averages in this test
_ABOVE_CROSSING = 5.0  # times the frequency at which flicker and white noise are equal
_FALLEN = 0.8  # largest ratio of power, upper to lower frequencies, behind a filter
_UPPER, _BELOW = (0.5, 1.0), (0.25, 0.5)  # of the highest frequency
_FLAT, _SURE = 0.03, 3.3  # tolerance for a flat spectrum: fraction, and standard deviations
_LEAST_WHITE = 0.1  # smallest N over the noise density of all samples


@dataclass(frozen=True, eq=False)
class ChannelSummary:
    """The spectra, deviations and disturbances from which the noise of a channel is determined.

    Parameters
    ----------
    channel : str
    quantity : "gyro" or "accelerometer"
    n, longest : int
        Number of samples in all pieces, and number in the longest piece.
    dt : float
        Sampling interval Δ, s.
    mean : float
    spectra : tuple of Spectrum
        Spectra without lines; low frequencies come first.
    lines : tuple of SpectralLine
    octaves : Deviations
        Overlapping Allan deviation at octaves, used for the estimates.
    deviations : dict of kind to Deviations
        Deviations to report.
    disturbances : tuple of Disturbance
    remarks : tuple of str
    low : LowFrequencies
        Block means of the pieces, with regressors of their drift.
    step : float
        Step to which the readings are rounded; 0 if none is detected.
    """

    channel: str
    quantity: SensorKind
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
    low: LowFrequencies
    step: float = 0.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """The noise model that was fitted to a channel.

    Parameters
    ----------
    selection : Selection
    bins : Bins
        The bins that the fit used; they include the filter or are limited to the band.
    drift : DriftFit or None
    refusal : NoiseRefusal or None
    """

    selection: Selection
    bins: Bins
    drift: DriftFit | None = None
    refusal: NoiseRefusal | None = None


def find_model(one: ChannelSummary, candidates: tuple[str, ...]) -> NoiseModel:
    """Find the model of a channel.

    Parameters
    ----------
    one : ChannelSummary
    candidates : tuple of str
        Models to choose from; each must contain N, because the filter search requires it.
    """
    if not all("N" in symbols for symbols in candidates):
        return _solve(one, make_bins(one.spectra, one.dt), candidates)
    rounding = rounding_noise(one.step, one.dt)
    fine = make_bins(one.spectra, one.dt, fine=True).strong_bins()
    search = filter_search.find_filter(fine, rounding)
    suspected = search is not None and search.is_better
    if search is not None and suspected and search.best.is_possible:
        found = _solve(one, filter_search.apply_filter(fine, search), candidates)
        if _describes(one, found):
            place = _placed(found, search)
            if place is not None:
                return place
            suspected = False
    plain = _solve(one, make_bins(one.spectra, one.dt), candidates)
    if _describes(one, plain):
        return _refused_without_white(plain, rounding)
    contradictory = _is_contradictory(plain)
    suspected = contradictory or (suspected and not one.disturbances)
    if not suspected or not (contradictory or _falls(fine, rounding)):
        return plain  # due to a vibration or disturbance; the test of fit names its band
    band = filter_search.band_below(fine)
    if band is not None and _describes(one, found := _solve(one, band, candidates)):
        white = found.selection.fit.variance("N")
        if _white(fine, _UPPER) < _FALLEN * white:
            return found
        if not contradictory:
            return plain
    return _refused(
        plain, "no known low-pass filter describes the spectrum, and no band below it determines N"
    )


def _describes(one: ChannelSummary, model: NoiseModel) -> bool:
    """Return whether a model passes the test of fit at the relevant frequencies.

    With a filter, the relevant frequencies are above a tenth of its cut-off, because lower
    frequencies only show whether the drift has the fitted terms. With a band, the averaging times
    are not tested, because they include higher frequencies. If the user requested specific terms,
    these may be too few, so N, B and K are tested instead.
    """
    bins, fit = model.bins, model.selection.fit
    if model.selection.is_asked:
        fit = fit_terms(bins, BEFORE_FILTER)
    judged = judge_fit(bins, fit, one.octaves)
    output = bins.output
    if output is not None:
        cutoff = output.cutoff if output.shape.has_cutoff else _AVERAGE_CUTOFF / output.dt
        return all(decade.fits for decade in judged.decades if decade.high > _JUDGED * cutoff)
    if bins.limit < np.inf:
        return all(decade.fits for decade in judged.decades)
    return judged.fits


def rounding_noise(step: float, dt: float) -> float:
    """Return F² due to rounding to a step, which adds white noise with variance step²/12."""
    return step**2 * dt / 12


def selection_with_filter(
    spectra: tuple[Spectrum, ...], dt: float, candidates: tuple[str, ...], like: Bins, step: float
) -> Selection:
    """Select the terms for part of a recording, with the filter or band of the whole recording.

    Parameters
    ----------
    spectra : tuple of Spectrum
    dt : float
        Sampling interval, s.
    candidates : tuple of str
    like : Bins
        Bins of the whole recording.
    step : float
        Rounding step, SI.
    """
    bins = make_bins(spectra, dt, fine=like.fine)
    if like.output is not None:
        bins = bins.strong_bins()
        search = filter_search.find_filter(bins, rounding_noise(step, dt))
        if search is not None and search.is_better:
            bins = filter_search.apply_filter(bins, search)
    elif like.limit < np.inf:
        bins = bins.below(like.limit)
    return select_terms(bins, candidates)


def _solve(one: ChannelSummary, bins: Bins, candidates: tuple[str, ...]) -> NoiseModel:
    """Return the terms that fit the bins best, and the drift found at low frequencies."""
    selection = select_terms(bins, candidates)
    drift = find_drift(one.low, one.spectra, bins, selection, candidates)
    if drift is None:
        return NoiseModel(selection, bins)
    return NoiseModel(drift.selection, drift.bins, drift)


def _placed(found: NoiseModel, search: FilterSearch) -> NoiseModel | None:
    """Return a model with a filter, or its refusal; None if this is a Gauss–Markov process."""
    fit = found.selection.fit
    output = filter_search.settled_filter(found.bins, fit)
    assert output is not None
    if not output.shape.has_cutoff:
        return found
    crossing = fit.variance("B") / (2 * np.pi * max(fit.variance("N"), 1e-300))
    time = 1 / (2 * np.pi * output.cutoff)
    low = output.cutoff * output.dt < _LEAST_CUTOFF
    if low and (search.best.floor > _LEAST_FLOOR * search.best.white or time > _LONGEST):
        return None
    hidden = (
        output.cutoff * output.dt < _LOW_CUTOFF
        and fit.variance("N") < _WHITE_BESIDE_MARKOV * 2 * fit.variance("G") * fit.markov_time
    )
    if low or hidden or output.cutoff < _ABOVE_CROSSING * crossing:
        return _refused(found, _same_spectrum(time))
    return found


def _same_spectrum(time: float) -> str:
    """Explain that a filter and a Gauss–Markov process (T, s) have the same spectrum."""
    return (
        f"white noise behind a low-pass filter at {1 / (2 * np.pi * time):.2g} Hz has the same "
        f"spectrum as a Gauss–Markov process with a time constant of {time:.2g} s"
    )


def _refused_without_white(model: NoiseModel, rounding: float) -> NoiseModel:
    """Return the model, or its refusal if a low-pass filter could also explain the spectrum.

    White noise behind a filter looks like a short Gauss–Markov process or, above the cut-off, like
    a random walk. Only additional white noise shows which of these is present.

    Parameters
    ----------
    model : NoiseModel
        Model without a filter.
    rounding : float
        White noise caused by rounding of the readings, N² in SI.
    """
    fit = model.selection.fit
    white = max(fit.variance("N") - _ROUNDING * rounding, 0.0)
    if "G" in fit.symbols and fit.markov_time <= _LONGEST:
        if white <= _LEAST_FLOOR * 2 * fit.variance("G") * fit.markov_time:
            return _refused(model, _same_spectrum(fit.markov_time))
    elif (
        (walk := model.selection.significance.get("K")) is not None
        and walk.is_present
        and white <= fit.variance("K") / (2 * np.pi * model.bins.frequency.max()) ** 2
    ):
        return _refused(
            model,
            "white noise behind a low-pass filter with a low cut-off has the same spectrum as a "
            "random walk, and there is no other white noise that could distinguish the two",
        )
    return model


def _is_contradictory(model: NoiseModel) -> bool:
    """Return whether N is far below the density of all samples, although B, K or G is present."""
    bins, found = model.bins, model.selection
    density = float(bins.weight @ bins.power / bins.weight.sum()) * bins.dt
    sure = any(one in found.significance and found.significance[one].is_present for one in "BKG")
    return sure and found.fit.variance("N") < _LEAST_WHITE**2 * density


def _falls(bins: Bins, rounding: float) -> bool:
    """Return whether the spectrum falls up to half the rate, or to a floor of rounding noise."""
    upper, below = _white(bins, _UPPER), _white(bins, _BELOW)
    top = bins.frequency.max()
    count = bins.weight[bins.frequency > _UPPER[0] * top].sum()
    spread = max(_FLAT, _SURE * float(np.sqrt(6 / count)))
    return upper < (1 - spread) * below or upper < _ROUNDING * rounding


def _white(bins: Bins, octave: tuple[float, float]) -> float:
    """Return N², SI², in a band given as fractions of the highest frequency."""
    share = bins.frequency / bins.frequency.max()
    chosen = (share > octave[0]) & (share <= octave[1])
    weight = bins.weight[chosen]
    return float(weight @ (bins.power[chosen] / bins.basis("N")[chosen]) / weight.sum())


def _refused(model: NoiseModel, cause: str) -> NoiseModel:
    return NoiseModel(model.selection, model.bins, model.drift, NoiseRefusal(REFUSED, cause))


def _warm_up(one: ChannelSummary, model: NoiseModel) -> float:
    """Return by how much a warm-up, not a random walk, changes the bias; 0 if there is none."""
    fit = model.selection.fit
    if "K" not in fit.symbols:
        return 0.0
    drift = () if model.drift is None else model.drift.terms
    loss = fit.loss if model.drift is None else model.drift.loss
    return warm_up_size(one.low, one.spectra, drift, model.bins, fit, loss)


def conclude(one: ChannelSummary, candidates: tuple[str, ...], method: Method) -> ChannelNoise:
    """Determine the noise of a channel from its summary.

    Parameters
    ----------
    one : ChannelSummary
    candidates : tuple of str
        Models to choose from.
    method : "likelihood", "gmwm" or "wls_log"
    """
    model = find_model(one, candidates)
    selection, bins = model.selection, model.bins
    used, why = possible_method(method, one.longest, single=len(one.low.places) == 1, bins=bins)
    coefficients: tuple[NoiseCoefficient, ...] = ()
    comparison: dict[str, Estimates] = {}
    remarks: list[str] = []
    if model.refusal is None:
        coefficients, comparison = estimate_coefficients(
            selection, bins, one.octaves, one.quantity, used, one.longest
        )
        remarks = undetermined(selection, one.longest * one.dt)
        if size := _warm_up(one, model):
            text = format_quantity(abs(size), 0.0, SHOWN_UNIT[one.quantity], 2)
            recorded = "temperature" in one.low.regressors
            advice = (
                "The recorded temperature does not explain it: start the recording later"
                if recorded
                else "Record its temperature, or start the recording later"
            )
            remarks.append(
                f"the bias moves one way by {text}, which explains K better than a random walk: "
                f"did the sensor warm up? {advice}"
            )
    output, band = filter_search.settled_filter(bins, selection.fit), bins.limit
    if band < np.inf:
        # Compare the whole spectrum with the model that was fitted to its lower part.
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
