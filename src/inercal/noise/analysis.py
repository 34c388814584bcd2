"""From a recording at rest to its noise: the steps of `inercal noise` for each channel.

1. The recording is parted at its gaps (`pieces`).
2. Lines are taken out of the spectrum (`lines`); the terms are fitted and chosen (`selection`).
3. A ramp and the temperature enter where the likelihood asks for them (`drift`).
4. The fit is judged (`goodness`), and disturbances are looked for (`disturbances`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.noise.coefficients import Method, estimate_coefficients, undetermined
from inercal.noise.deviations import (
    Deviations,
    Spacing,
    deviations,
)
from inercal.noise.disturbances import Disturbance, find_disturbances
from inercal.noise.drift import DriftFit, find_drift
from inercal.noise.goodness import judge_fit
from inercal.noise.lines import Line, take_out_lines
from inercal.noise.pieces import Pieces, split_at_gaps
from inercal.noise.results import SI_UNIT, ChannelNoise, NoiseAnalysis, Quantity
from inercal.noise.rounding import check_rounding
from inercal.noise.selection import CANDIDATES, Selection, select_terms
from inercal.noise.spectrum import Spectrum, block_means, make_bins, piece_spectra
from inercal.noise.terms import TERMS
from inercal.recording import Recording
from inercal.units import si_factor

DEVIATIONS = ("oadev", "mdev", "ohdev", "totdev")
METHODS: tuple[str, ...] = get_args(Method)


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
        Which estimate of the coefficients is reported; all stand in `comparison`.
    spacing : "octave", "decade" or "all"
        Averaging times of the deviations.
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
    found = _disturbances(parts, pieces)
    starts = list(pieces.starts)
    if found and not keep_disturbed:
        parts, starts, remark = _without(parts, starts, found, pieces.dt)
        remarks.append(remark)
    spectra, lines = _spectra(parts, pieces.dt)
    bins = make_bins(spectra, pieces.dt)
    selection = select_terms(bins, candidates)
    drift = _drift(parts, spectra, pieces, selection, candidates)
    if drift is not None:
        selection, bins = drift.selection, drift.bins
    tables = {kind: _deviations(parts, pieces.dt, kind, spacing) for kind in ("oadev", *kinds)}
    oadev = tables["oadev"]
    remarks += undetermined(selection, bins, max(map(len, parts)) * pieces.dt)
    coefficients, comparison = estimate_coefficients(
        selection, bins, oadev, quantity, method, max(map(len, parts)), whole=len(parts) == 1
    )
    n = sum(map(len, parts))
    return ChannelNoise(
        name,
        quantity,
        n,
        pieces.dt,
        float(sum(one.sum() for one in parts) / n),
        coefficients,
        tables,
        selection,
        bins,
        judge_fit(bins, selection.fit, oadev),
        lines,
        found,
        () if drift is None else drift.terms,
        tuple(remarks),
        comparison,
        method,
    )


def _spectra(parts: Iterable[Array], dt: float) -> tuple[tuple[Spectrum, ...], tuple[Line, ...]]:
    """Return the spectra of all pieces without their lines, and the lines."""
    spectra: list[Spectrum] = []
    lines: list[Line] = []
    for part in parts:
        for one in piece_spectra(part, dt):
            clean, found = take_out_lines(one)
            spectra.append(clean)
            lines += found
    return tuple(spectra), tuple(lines)


def _drift(
    parts: Sequence[Array],
    spectra: tuple[Spectrum, ...],
    pieces: Pieces,
    selection: Selection,
    candidates: tuple[str, ...],
) -> DriftFit | None:
    """Return the drift of a recording in one piece; of several the pieces' means hide it."""
    if len(parts) > 1 or len(pieces.values) > 1:
        return None
    low = spectra[0]
    m = round(low.dt / pieces.dt)
    y = block_means(parts[0], m)
    regressors: dict[str, Array] = {"ramp": np.arange(y.size, dtype=np.float64) * low.dt}
    if pieces.temperature is not None:
        temperature = block_means(pieces.temperature[0], m)
        if np.ptp(temperature) > 0:
            regressors["temperature"] = temperature
            regressors["temperature rate"] = np.asarray(np.gradient(temperature, low.dt))
    return find_drift(y, spectra, regressors, pieces.dt, selection, candidates)


def _disturbances(parts: Sequence[Array], pieces: Pieces) -> tuple[Disturbance, ...]:
    return tuple(
        replace(one, time=one.time + start)
        for part, start in zip(parts, pieces.starts, strict=True)
        for one in find_disturbances(part, pieces.dt)
    )


def _without(
    parts: Sequence[Array], starts: Sequence[float], found: Sequence[Disturbance], dt: float
) -> tuple[list[Array], list[float], str]:
    """Return the pieces parted at disturbances, which are left out with 1 s about them."""
    kept: list[Array] = []
    begins: list[float] = []
    for part, start in zip(parts, starts, strict=True):
        good = np.ones(part.size + 1, dtype=bool)
        good[-1] = False
        for one in found:
            seconds = one.seconds if np.isfinite(one.seconds) else 0.0
            first = int((one.time - start - 1.0) / dt)
            last = int(np.ceil((one.time + seconds - start + 1.0) / dt))
            good[max(first, 0) : max(last, 0)] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good])))
        for a, b in edges.reshape(-1, 2):
            if b - a >= 64:
                kept.append(part[a:b])
                begins.append(start + a * dt)
    if not kept:
        raise InputError("nothing of the recording is undisturbed: record again")
    left = sum(map(len, parts)) - sum(map(len, kept))
    return kept, begins, f"{left * dt:.4g} s at {len(found)} disturbances were left out"


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
    from inercal.noise.confidence import interval

    low, high = interval(value, edf)
    return replace(longest, value=value, low=low, high=high, edf=edf, count=count)
