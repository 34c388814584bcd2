"""From a recording at rest to its noise: the steps of `inercal noise` for each channel.

1. The recording is parted at its gaps (`pieces`).
2. Lines are taken out of the spectrum (`lines`); the terms are fitted and chosen (`selection`).
3. A ramp and the temperature enter where the likelihood asks for them (`drift_regression`).
4. The fit is judged (`goodness`), and disturbances are looked for (`disturbances`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.noise.channel_noise import SI_UNIT, ChannelNoise, NoiseAnalysis, Quantity
from inercal.noise.coefficients import Method
from inercal.noise.conclusion import ChannelSummary, conclude
from inercal.noise.confidence import interval
from inercal.noise.deviations import Deviations, Spacing, deviations
from inercal.noise.disturbances import Disturbance, find_disturbances
from inercal.noise.lines import SpectralLine, take_out_lines
from inercal.noise.pieces import FEWEST, Pieces, split_at_gaps
from inercal.noise.rounding import check_rounding
from inercal.noise.selection import CANDIDATES
from inercal.noise.spectrum import Spectrum, block_means, piece_spectra
from inercal.noise.terms import TERMS
from inercal.recording import Recording
from inercal.units import si_factor

DEVIATIONS = ("oadev", "mdev", "ohdev", "totdev")


def analyse_noise(
    recording: Recording,
    *,
    terms: str | None = None,
    method: Method = "likelihood",
    spacing: Spacing = "octave",
    kinds: Sequence[str] = DEVIATIONS,
    keep_disturbed: bool = True,
) -> NoiseAnalysis:
    """Return the noise of every channel of a recording at rest.

    Parameters
    ----------
    recording : Recording
        Units of rate (rad/s, °/s, …) or acceleration (m/s², g, …), (n, m). Its gaps part it.
    terms : str, optional
        Symbols of the terms to fit, such as "NBK"; by default Akaike's criterion chooses.
    method : "likelihood", "gmwm" or "wls_log"
        Which estimate of the coefficients is reported. GMWM needs one piece of at most 2¹⁸
        samples; for others the likelihood is reported, and a remark says so.
    spacing : "octave", "decade" or "all"
        Averaging times of the reported deviations. The estimates use octaves.
    kinds : sequence of str
        Deviations; "oadev" is always among them.
    keep_disturbed : bool
        False leaves the disturbed times out, which parts the recording there.

    Returns
    -------
    NoiseAnalysis
        All values in SI.

    Raises
    ------
    InputError
        Fewer than 64 samples, a unit of neither quantity, a reading that is rounded to steps of
        more than 2.5 times its noise, or unknown terms.
    """
    pieces = split_at_gaps(recording)
    candidates = _candidates(terms)
    channels = [
        _channel(recording, pieces, k, candidates, method, spacing, kinds, keep_disturbed)
        for k in range(len(recording.channels))
    ]
    return NoiseAnalysis(
        recording.source, recording.duration, tuple(channels), pieces.remarks, recording.sha256
    )


def analyse_noise_stream(
    pieces: Iterable[Array],
    dt: float,
    channels: Sequence[str],
    units: Sequence[str],
    *,
    terms: str | None = None,
    source: str = "",
) -> NoiseAnalysis:
    """Return the noise of a recording that comes in pieces, in bounded memory.

    Each channel keeps some 30 MB of 10⁸ samples (`inercal.noise.streaming`). There is no
    temperature, and no gap: the samples are taken as evenly spaced.

    Parameters
    ----------
    pieces : iterable of (k, m) array
        One after the other; k may differ.
    dt : float
        Δ, s.
    channels, units : sequence of m str
    terms : str, optional
        As in `analyse_noise`.
    source : str
        For messages.

    Raises
    ------
    InputError
        As `analyse_noise` raises it.
    """
    from inercal.noise.streaming import StreamedChannel

    candidates = _candidates(terms)
    quantities: list[Quantity] = [quantity_of(*one) for one in zip(units, channels, strict=True)]
    sizes = [si_factor(unit) for unit in units]
    streamed = [StreamedChannel(dt) for _ in channels]
    for piece in pieces:
        for k, one in enumerate(streamed):
            if len(piece):
                one.add(np.ascontiguousarray(piece[:, k], dtype=np.float64) * sizes[k])
    if not streamed or streamed[0].count < FEWEST:
        raise InputError(f"{source or 'recording'}: fewer than {FEWEST} samples")
    found = [
        conclude(one.summary(name, quantity, source), candidates, "likelihood")
        for one, name, quantity in zip(streamed, channels, quantities, strict=True)
    ]
    return NoiseAnalysis(source, (streamed[0].count - 1) * dt, tuple(found), ())


def _candidates(terms: str | None) -> tuple[str, ...]:
    if terms is None:
        return CANDIDATES
    chosen = terms.replace(",", "").replace(" ", "").upper()
    bad = sorted({one for one in chosen if one not in TERMS})
    if bad or not chosen or len(set(chosen)) != len(chosen):
        raise InputError(
            f"terms {terms!r}: write each of {', '.join(TERMS)} at most once, as in NBK",
            key="--terms",
        )
    return (chosen,)


def quantity_of(unit: str, channel: str) -> Quantity:
    """Return whether a unit is of angular rate or of acceleration.

    Raises
    ------
    InputError
        It is of neither.
    """
    for quantity, like in SI_UNIT.items():
        try:
            si_factor(unit, like)
        except InputError:
            continue
        return quantity
    raise InputError(
        f"channel {channel} is in {unit!r}: noise is stated of rates (rad/s, °/s) and "
        "accelerations (m/s², g); convert the readings, or state the scale factor",
        names=(channel,),
    )


def _channel(
    recording: Recording,
    pieces: Pieces,
    k: int,
    candidates: tuple[str, ...],
    method: Method,
    spacing: Spacing,
    kinds: Sequence[str],
    keep_disturbed: bool,
) -> ChannelNoise:
    name, unit = recording.channels[k], recording.units[k]
    quantity = quantity_of(unit, name)
    size = si_factor(unit)
    parts = [np.ascontiguousarray(one[:, k]) * size for one in pieces.values]
    remarks = list(check_rounding(parts, name, recording.source))
    found, temperature = _disturbances(parts, pieces), pieces.temperature
    if found and not keep_disturbed:
        spans = _undisturbed_spans(parts, pieces.starts, found, pieces.dt)
        before = sum(map(len, parts))
        parts = [parts[i][span] for i, span in spans]
        if temperature is not None:
            temperature = tuple(temperature[i][span] for i, span in spans)
        left = (before - sum(map(len, parts))) * pieces.dt
        remarks.append(f"{left:.4g} s were left out (disturbances: {len(found)})")
    spectra, lines = _spectra(parts, pieces.dt)
    octaves = _deviations(parts, pieces.dt, "oadev", "octave")
    n = sum(map(len, parts))
    summary = ChannelSummary(
        channel=name,
        quantity=quantity,
        n=n,
        longest=max(map(len, parts)),
        dt=pieces.dt,
        mean=float(sum(one.sum() for one in parts) / n),
        spectra=spectra,
        lines=lines,
        octaves=octaves,
        deviations={
            kind: octaves
            if (kind, spacing) == ("oadev", "octave")
            else _deviations(parts, pieces.dt, kind, spacing)
            for kind in dict.fromkeys(("oadev", *kinds))
        },
        disturbances=found,
        remarks=tuple(remarks),
        low_values=_low_values(parts, spectra, pieces.dt),
        regressors=_regressors(temperature, spectra, pieces.dt) if len(parts) == 1 else {},
    )
    return conclude(summary, candidates, method)


def _low_values(parts: Sequence[Array], spectra: tuple[Spectrum, ...], dt: float) -> Array | None:
    """Return the values of the low frequencies of a recording in one piece; None of others."""
    return block_means(parts[0], round(spectra[0].dt / dt)) if len(parts) == 1 else None


def _spectra(
    parts: Iterable[Array], dt: float
) -> tuple[tuple[Spectrum, ...], tuple[SpectralLine, ...]]:
    """Return the spectra of all pieces without their lines, and the lines."""
    spectra: list[Spectrum] = []
    lines: list[SpectralLine] = []
    for part in parts:
        for one in piece_spectra(part, dt):
            clean, found = take_out_lines(one)
            spectra.append(clean)
            lines += found
    return tuple(spectra), tuple(lines)


def _regressors(
    temperature: tuple[Array, ...] | None, spectra: tuple[Spectrum, ...], dt: float
) -> dict[str, Array]:
    """Return the regressors of the drift of one piece: a ramp, the temperature and its rate."""
    low = spectra[0]
    found: dict[str, Array] = {"ramp": np.arange(low.n, dtype=np.float64) * low.dt}
    if temperature is not None:
        means = block_means(temperature[0], round(low.dt / dt))
        if np.ptp(means) > 0:
            found["temperature"] = means
            found["temperature rate"] = np.asarray(np.gradient(means, low.dt))
    return found


def _disturbances(parts: Sequence[Array], pieces: Pieces) -> tuple[Disturbance, ...]:
    return tuple(
        replace(one, time=one.time + start)
        for part, start in zip(parts, pieces.starts, strict=True)
        for one in find_disturbances(part, pieces.dt)
    )


def _undisturbed_spans(
    parts: Sequence[Array], starts: Sequence[float], found: Sequence[Disturbance], dt: float
) -> list[tuple[int, slice]]:
    """Return the samples of each piece that no disturbance, nor 1 s about it, covers."""
    kept: list[tuple[int, slice]] = []
    for i, (part, start) in enumerate(zip(parts, starts, strict=True)):
        good = np.ones(part.size + 1, dtype=bool)
        good[-1] = False
        for one in found:
            seconds = one.seconds if np.isfinite(one.seconds) else 0.0
            first = int((one.time - start - 1.0) / dt)
            last = int(np.ceil((one.time + seconds - start + 1.0) / dt))
            good[max(first, 0) : max(last, 0)] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good])))
        spans = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        kept += [(i, span) for span in spans if span.stop - span.start >= FEWEST]
    if not kept:
        raise InputError("nothing of the recording is undisturbed: record again")
    return kept


def _deviations(parts: Sequence[Array], dt: float, kind: str, spacing: Spacing) -> Deviations:
    """Return a deviation of the pieces, weighted by the differences of each."""
    tables = [deviations(one, dt, kind, spacing) for one in parts if one.size >= 16]
    if len(tables) == 1:
        return tables[0]
    longest = max(tables, key=lambda one: one.tau.size)
    square = np.zeros(longest.tau.size)
    edf, count = np.zeros(longest.tau.size), np.zeros(longest.tau.size)
    for one in tables:
        k = one.tau.size
        square[:k] += one.count * one.value**2
        count[:k] += one.count
        edf[:k] += one.edf
    value = np.sqrt(square / count)
    low, high = interval(value, edf)
    return replace(longest, value=value, low=low, high=high, edf=edf, count=count)
