"""Determine the noise of each channel from a recording at rest, as `inercal noise` does.

1. The recording is split at its gaps (`pieces`).
2. Lines are removed from the spectrum (`lines`), and the terms are chosen and fitted (`selection`).
3. A ramp and the temperature are added if the likelihood requires them (`drift_regression`).
4. The fit is tested (`goodness`), and disturbances are detected (`disturbances`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.process_settings import with_one_thread
from inercal.basics.units import format_duration, format_quantity, si_factor
from inercal.estimation.uncertainty import COVERAGE
from inercal.noise import channel_noise
from inercal.noise.channel_model import ChannelSummary, conclude, selection_with_filter
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis, SensorKind
from inercal.noise.coefficients import Method
from inercal.noise.deviations import Deviations, Spacing, deviations
from inercal.noise.disturbances import Disturbance, SpectralLine, find_disturbances, take_out_lines
from inercal.noise.drift_regression import LowFrequencies, LowPiece
from inercal.noise.likelihood import NoiseFit
from inercal.noise.pieces import (
    FEWEST,
    Part,
    Pieces,
    fits_grid,
    gap_oadev,
    join_deviations,
    split_at_gaps,
)
from inercal.noise.recording_checks import check_rest_units, check_rounding, movement, rounding_step
from inercal.noise.selection import CANDIDATES
from inercal.noise.spectrum import (
    Band,
    Bins,
    Spectrum,
    block_means,
    piece_spectra,
    remove_band,
    require_bands,
)
from inercal.noise.terms import TERMS
from inercal.physics.sensors import G0
from inercal.recordings import Recording
from inercal.recordings.samples import INVALID_SAMPLES, TIME_UNIT, merge_messages

_MARGIN = 1.0  # s, excluded on both sides of a disturbance


def quiet_parts(parts: Sequence[Part], found: Sequence[Disturbance], dt: float) -> list[Part]:
    """Return the pieces that are at least 1 s away from every disturbance.

    Raises
    ------
    InputError
        No piece has 64 samples.
    """
    kept: list[Part] = []
    for part in parts:
        good = np.ones(len(part) + 1, dtype=bool)
        good[-1] = False
        for one in found:
            seconds = one.seconds if np.isfinite(one.seconds) else 0.0
            first = int((one.time - part.start - _MARGIN) / dt)
            last = int(np.ceil((one.time + seconds - part.start + _MARGIN) / dt))
            good[max(first, 0) : max(last, 0)] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good])))
        spans = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        kept += [part.slice_samples(a, b, dt) for a, b in spans if b - a >= FEWEST]
    if not kept:
        raise InputError("the whole recording is disturbed; record again")
    return kept


def walk_remark(channel: ChannelNoise, other: NoiseFit | None, *, kept: bool) -> str:
    """Return a remark that states K both with and without the disturbed parts of the recording.

    Parameters
    ----------
    channel : ChannelNoise
    other : NoiseFit or None
        The fit without the disturbed times if `channel` includes them; otherwise the fit with them.
    kept : bool
        Whether `channel` includes the disturbed times.
    """
    if other is None:
        return "disturbances cover the whole recording, so K without them is unknown"
    if not any(fit.variance("K") for fit in (channel.fit, other)):
        return "K is not detected, with or without the disturbed times"
    one, two = (_walk(fit, channel.quantity) for fit in (channel.fit, other))
    with_them, without = (one, two) if kept else (two, one)
    how = "; --skip-disturbed excludes the disturbed times" if kept else ""
    return f"K is {with_them} with the disturbed times and {without} without them{how}"


def disturbed_text(channel: ChannelNoise, without: NoiseFit) -> str:
    """Describe the coefficients that the disturbed times change by more than U; empty if none.

    Parameters
    ----------
    channel : ChannelNoise
        The noise with the disturbed times.
    without : NoiseFit
        The fit of the same terms without them. A removed drift is not part of it, so that only N
        is compared if there is one.
    """
    texts: list[str] = []
    for one in channel.coefficients:
        if one.symbol not in ("N" if channel.drift else "NBK"):
            continue
        value = float(np.sqrt(without.variance(one.symbol)))
        changed = value > one.high if one.is_limit else abs(value - one.value) > COVERAGE * one.u
        if changed:
            first, second = (format_quantity(x, 0.0, one.unit, 3) for x in (one.value, value))
            first = (
                f"below {format_quantity(one.high, 0.0, one.unit, 3)}" if one.is_limit else first
            )
            texts.append(f"{one.symbol} is {first} with them and {second} without them")
    if not texts:
        return ""
    return (
        f"the disturbed times change the noise by more than U: {'; '.join(texts)}; exclude these "
        "times with --skip-disturbed, or record again"
    )


def invalid_text(recording: Recording, channel: str) -> str:
    """Describe where the audit found a channel saturated or stuck; empty if it did not."""
    found = [
        one.message
        for one in recording.findings
        if one.channel == channel and one.what in INVALID_SAMPLES
    ]
    if not found:
        return ""
    return (
        f"{'; '.join(merge_messages(found))}; such readings do not contain the sensor's noise: "
        "give the part of the recording before or after them, or record again"
    )


def _walk(fit: NoiseFit, quantity: SensorKind) -> str:
    unit = channel_noise.coefficient_unit("K", quantity)
    variance = fit.variance("K")
    return format_quantity(float(np.sqrt(variance)), 0.0, unit, 3) if variance > 0 else "none"


DEVIATIONS = ("oadev", "mdev", "ohdev", "totdev")


@dataclass(frozen=True)
class AnalysisOptions:
    """The options of `analyse_noise`, which explains them."""

    candidates: tuple[str, ...]
    method: Method
    spacing: Spacing
    kinds: tuple[str, ...]
    keep_disturbed: bool
    skipped_bands: tuple[Band, ...]


@with_one_thread
def analyse_noise(
    recording: Recording,
    *,
    terms: str | None = None,
    method: Method = "likelihood",
    spacing: Spacing = "octave",
    kinds: Sequence[str] = DEVIATIONS,
    keep_disturbed: bool = True,
    skipped_bands: Sequence[Band] = (),
    gravity: float | None = G0,
) -> NoiseAnalysis:
    """Determine the noise of every channel from a recording at rest.

    Parameters
    ----------
    recording : Recording
        Recording in units of rate (rad/s, °/s, …) or acceleration (m/s², g, …), (n, m). It is split
        at its gaps.
    terms : str, optional
        Symbols of the terms to fit, such as "NBK". By default, Akaike's criterion chooses the
        terms.
    method : "likelihood", "gmwm" or "wls_log"
        Method that estimates the reported coefficients. GMWM needs a single piece of at most 2¹⁸
        samples. For other recordings, the likelihood is used instead, and a remark says so.
    spacing : "octave", "decade" or "all"
        Averaging times of the reported deviations. The estimates always use octaves.
    kinds : sequence of str
        Deviations to report; "oadev" is always included.
    keep_disturbed : bool
        Whether the analysis includes the disturbed times. If not, the recording is split at these
        times.
    skipped_bands : sequence of (float, float)
        Lowest and highest frequency of each band that the fit excludes, Hz.
    gravity : float or None
        Local gravity, m/s², with which the readings of three accelerometers are compared. Use None
        if the readings do not contain gravity, for example simulated noise; their unit is then not
        checked.

    Returns
    -------
    NoiseAnalysis
        All values in SI.

    Raises
    ------
    InputError
        There are fewer than 64 samples, a unit is neither a rate nor an acceleration,
        accelerometers do not read gravity, readings are rounded to steps of more than 2.5 times
        their noise, or a term is unknown.
    """
    wanted = AnalysisOptions(
        candidate_models(terms), method, spacing, tuple(kinds), keep_disturbed, tuple(skipped_bands)
    )
    units = check_rest_units(recording, gravity)
    assumed = [one.message for one in recording.findings if one.what == TIME_UNIT]
    pieces = split_at_gaps(recording)
    require_bands(skipped_bands, pieces.dt)
    channels = [_channel(recording, pieces, k, wanted) for k in range(len(recording.channels))]
    return NoiseAnalysis(
        recording.source,
        recording.duration,
        tuple(channels),
        (*units, *assumed, *pieces.remarks),
        recording.sha256,
        movement(recording),
    )


def candidate_models(terms: str | None) -> tuple[str, ...]:
    """Return the models to choose from, as symbols of their terms.

    Parameters
    ----------
    terms : str, optional
        Symbols of the only model to use.

    Raises
    ------
    InputError
        A term is unknown.
    """
    if terms is None:
        return CANDIDATES
    chosen = terms.replace(",", "").replace(" ", "").upper()
    bad = sorted({one for one in chosen if one not in TERMS})
    if bad or not chosen or len(set(chosen)) != len(chosen):
        raise InputError(
            f"terms {terms!r} are not valid; write each of {', '.join(TERMS)} at most once, "
            "such as NBK",
            key="--terms",
        )
    return (chosen,)


def _channel(recording: Recording, pieces: Pieces, k: int, wanted: AnalysisOptions) -> ChannelNoise:
    name, unit = recording.channels[k], recording.units[k]
    quantity = channel_noise.quantity_of(unit, name)
    size = si_factor(unit)
    parts = [
        replace(one, values=np.ascontiguousarray(one.values[:, k]) * size) for one in pieces.parts
    ]
    remarks = list(check_rounding([one.values for one in parts], name, recording.source))
    every = parts
    invalid = invalid_text(recording, name)
    # A constant stretch changes the usual scatter, so that ordinary noise looks like disturbances.
    found = tuple(
        one.shifted(part.start)
        for part in parts
        if not invalid
        for one in find_disturbances(part.values, pieces.dt)
    )
    if found and not wanted.keep_disturbed:
        parts = quiet_parts(every, found, pieces.dt)
        left = (sum(map(len, every)) - sum(map(len, parts))) * pieces.dt
        remarks.append(
            f"{format_duration(left)} were excluded because of disturbances ({len(found)} found)"
        )
    spectra, lines, places = _spectra(parts, pieces.dt, wanted.skipped_bands)
    remarks += [f"{low:g}–{high:g} Hz were excluded from the fit" for low, high in
                wanted.skipped_bands]  # fmt: skip
    octaves = _deviations(parts, pieces.dt, "oadev", "octave")
    n = sum(map(len, parts))
    summary = ChannelSummary(
        channel=name,
        quantity=quantity,
        n=n,
        longest=max(map(len, parts)),
        dt=pieces.dt,
        mean=float(sum(one.values.sum() for one in parts) / n),
        spectra=spectra,
        lines=lines,
        octaves=octaves,
        deviations={
            kind: octaves
            if (kind, wanted.spacing) == ("oadev", "octave")
            else _deviations(parts, pieces.dt, kind, wanted.spacing)
            for kind in dict.fromkeys(("oadev", *wanted.kinds))
        },
        disturbances=found,
        remarks=tuple(remarks),
        low=_low_frequencies(parts, spectra, places, pieces.dt),
        step=rounding_step(max(every, key=len).values),
    )
    channel = replace(conclude(summary, wanted.candidates, wanted.method), disturbed=invalid)
    if not found or channel.refusal is not None:
        return channel
    other = _other_fit(every, found, pieces.dt, wanted, channel.bins, summary.step)
    text = walk_remark(channel, other, kept=wanted.keep_disturbed)
    if wanted.keep_disturbed and other is not None:
        same = replace(wanted, candidates=(channel.fit.symbols,))
        alike = _other_fit(every, found, pieces.dt, same, channel.bins, summary.step)
        assert alike is not None
        channel = replace(channel, disturbed=disturbed_text(channel, alike))
    return replace(channel, remarks=(*channel.remarks, text))


def _other_fit(
    every: Sequence[Part],
    found: Sequence[Disturbance],
    dt: float,
    wanted: AnalysisOptions,
    like: Bins,
    step: float,
) -> NoiseFit | None:
    """Return the other fit: without the disturbed times if they are kept, and otherwise with.

    Return None if no data would remain.
    """
    parts = every
    if wanted.keep_disturbed:
        try:
            parts = quiet_parts(every, found, dt)
        except InputError:
            return None
    spectra, _, _ = _spectra(parts, dt, wanted.skipped_bands)
    return selection_with_filter(spectra, dt, wanted.candidates, like, step).fit


def _low_frequencies(
    parts: Sequence[Part], spectra: Sequence[Spectrum], places: Sequence[int], dt: float
) -> LowFrequencies:
    """Return block means of all pieces; `places` are the indices of their low frequencies."""
    pieces: list[LowPiece] = []
    for part, place in zip(parts, places, strict=True):
        m = round(spectra[place].dt / dt)
        warmth = None if part.temperature is None else block_means(part.temperature, m)
        pieces.append(
            LowPiece(place, part.start, spectra[place].dt, block_means(part.values, m), warmth)
        )
    return LowFrequencies.of(pieces)


def _spectra(
    parts: Iterable[Part], dt: float, skipped_bands: Sequence[Band]
) -> tuple[tuple[Spectrum, ...], tuple[SpectralLine, ...], tuple[int, ...]]:
    """Return the spectra without lines and skipped bands, the lines, and where each piece starts.

    Each piece's low frequencies come first.
    """
    spectra: list[Spectrum] = []
    lines: list[SpectralLine] = []
    places: list[int] = []
    for part in parts:
        places.append(len(spectra))
        for one in piece_spectra(part.values, dt):
            clean, found = take_out_lines(remove_band(one, skipped_bands))
            spectra.append(clean)
            lines += found
    if skipped_bands and not any(one.kept.any() for one in spectra):
        raise InputError(
            f"--skip-band excludes all of 0 to {0.5 / dt:g} Hz; exclude less", key="--skip-band"
        )
    return tuple(spectra), tuple(lines), tuple(places)


def _deviations(parts: Sequence[Part], dt: float, kind: str, spacing: Spacing) -> Deviations:
    """Return a deviation of all pieces: OADEV across gaps, or else a mean over the pieces."""
    if len(parts) > 1 and kind == "oadev" and fits_grid(parts, dt):
        return gap_oadev(parts, dt, spacing)
    return join_deviations(
        [deviations(one.values, dt, kind, spacing) for one in parts if len(one) >= 16]
    )
