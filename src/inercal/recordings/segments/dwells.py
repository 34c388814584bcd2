"""Detect the dwells of a centrifuge arm by their steady rate, and average over whole turns.

In an arm run the arm spins up, dwells, and then changes its rate to the next dwell. A dwell is a
range in which the rate from the readback stays constant within one part in 500. It is cut to whole
turns, so that errors with a period of one turn (spindle lean) average out. The noise of a dwell is
estimated from the scatter between turns: the true mean over a turn is the same for all turns, so
the scatter of these means includes any correlation within a turn. Slower noise is drift, which is
taken from the sensor's stated noise. Dwells at the same rate share their noise, because vibration
depends on the rate.

On a platform that counter-rotates on the arm, the sensor measures the rotation of the arm, and the
output of a nonlinear sensor has harmonics. The mean and the harmonics up to order h in each turn
are 2h + 1 numbers. They are returned as the values of the fitted curve at 2h + 1 equally spaced
azimuths; each value is a row, like a separate dwell. The harmonics are orthogonal, so these values
are as independent as the samples. The first harmonic of the readings is also used to correct the
azimuth of the readback.
"""
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools, true_ranges
from inercal.basics.errors import InputError
from inercal.physics.plan import Attitude, Spin, arm_attitude
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Observations, Recording, add_rounding
from inercal.recordings.segments.attitudes import flaws_of_mark
from inercal.recordings.segments.reading_steps import reading_steps
from inercal.recordings.segments.section_means import drift_covariance

ARM_RATE, PSI, THETA = "arm_rate", "psi", "theta"  # readback, SI
_STEADY = 2e-3  # largest change, relative to the rate
_WINDOW = 0.5  # s
TURNING_SHARE = 0.02  # fraction of the largest rate; below it, the arm counts as at rest
SETTLING_TIME = 1.0  # s, waiting time after the rate is reached
LEAST_TURNS = 3
_ALIKE = 0.01  # rates with a smaller relative difference count as equal
_SAME = 5e-4  # rad; readback directions closer than this count as the same attitude


@dataclass(frozen=True)
class Dwell:
    """Samples of whole turns at a steady rate in rad/s, the signed RMS of the readback."""

    mark: Mark
    rate: float
    turns: int
    attitude: Attitude | None


def find_dwells(
    recording: Recording, turning_device: str = "arm"
) -> tuple[tuple[Dwell, ...], tuple[Finding, ...]]:
    """Return the dwells of an arm run, and findings about dwells that were not used.

    Parameters
    ----------
    recording : Recording
        Recording with readback "arm_rate", rad/s. Labels, if present, name positions. Readback
        "psi" and "theta", rad, if present, give the attitudes of a two-axis head.
    turning_device : str
        Name of the turning device for messages.

    Raises
    ------
    InputError
        There is no dwell of at least three turns.
    """
    smooth, steady = steady_rate(recording)
    cuts = [int(before) + 1 for before in recording.gaps[:, 0]]
    if recording.labels is not None:
        cuts += (np.flatnonzero(recording.labels[1:] != recording.labels[:-1]) + 1).tolist()
    dwells: list[Dwell] = []
    left_out: list[Finding] = []
    for first, last in true_ranges(steady).tolist():
        inner = sorted({first, last, *(cut for cut in cuts if first < cut < last)})
        for start, stop in pairwise(inner):
            dwell = _whole_turns(recording, start, stop, dwells)
            if dwell is None:
                continue
            inside = smooth[dwell.mark.start : dwell.mark.stop]
            flaw = flaw_text(recording, dwell.mark)
            if np.ptp(inside) > _STEADY * abs(dwell.rate):
                flaw = f"the rate changes by {1e6 * np.ptp(inside) / abs(dwell.rate):.0f} ppm"
            if flaw is None:
                dwells.append(dwell)
            else:
                text = f"dwell {dwell.mark.label} is not used: {flaw}"
                mark = dwell.mark
                left_out.append(Finding("warning", "dwell", text, None, mark.start, mark.stop))
    if not dwells:
        reasons = f" ({left_out[0].message})" if left_out else ""
        fastest = float(np.abs(smooth).max()) * 30 / pi
        span, advice = float(np.ptp(recording.time)), "check the column of the rate"
        if span < SETTLING_TIME + 60 * LEAST_TURNS / max(fastest, 1e-9):
            advice = f"the times span only {span:.3g} s: check time_unit or rate in [data]"
        raise InputError(
            f"{recording.source or 'recording'}: no dwell was detected: a dwell needs a steady "
            f"rate for {SETTLING_TIME:g} s and {LEAST_TURNS} more turns, but the "
            f"{turning_device} has none up to {fastest:.4g} rpm{reasons}; {advice}, or "
            "record again",
            file=recording.source or None,
            names=(ARM_RATE,),
        )
    return tuple(dwells), tuple(left_out)


def _whole_turns(
    recording: Recording, start: int, stop: int, before: Sequence[Dwell]
) -> Dwell | None:
    """Return the whole turns within steady samples as a dwell, after the arm has settled."""
    start += round(SETTLING_TIME * recording.rate_hz)
    if stop - start < 2:
        return None
    rate = recording.readback[ARM_RATE][start:stop]
    angle = np.abs(swept_angle(rate, recording.time[start:stop]))
    # The last sample completes its turn one step later.
    turns = int((angle[-1] + angle[1]) / (2 * pi))
    if turns < LEAST_TURNS:
        return None
    stop = start + _turn_boundaries(angle, [turns])[0]
    rate = rate[: stop - start]
    mean = float(np.copysign(np.sqrt(np.mean(rate**2)), rate.mean()))
    name = "" if recording.labels is None else str(recording.labels[start]).strip()
    label = once = f"{name or 'dwell'} at {abs(mean) * 30 / pi:.4g} rpm"
    k = 1
    while label in {dwell.mark.label for dwell in before}:
        k += 1
        label = f"{once} ({k})"
    attitude = None
    if PSI in recording.readback:
        psi, theta = (float(recording.readback[angle][start:stop].mean()) for angle in (PSI, THETA))
        attitude = _earlier_attitude(arm_attitude(psi, theta), before)
    return Dwell(Mark(label, start, stop), mean, turns, attitude)


def _earlier_attitude(attitude: Attitude, before: Sequence[Dwell]) -> Attitude:
    """Return the same attitude of an earlier dwell if there is one; ignore last-digit differences.

    Dwells at the same attitude share the errors of its angles.
    """
    for dwell in before:
        if dwell.attitude is not None and np.allclose(
            (dwell.attitude.out, dwell.attitude.up), (attitude.out, attitude.up), atol=_SAME, rtol=0
        ):
            return dwell.attitude
    return attitude


def steady_rate(recording: Recording) -> tuple[Array, Bools]:
    """Return the mean rate over half a second, (n,) rad/s, and a mask of steady rotation."""
    width = max(round(_WINDOW * recording.rate_hz), 3)
    smooth: Array = scipy.ndimage.uniform_filter1d(recording.readback[ARM_RATE], width)
    spread: Array = scipy.ndimage.maximum_filter1d(smooth, width) - scipy.ndimage.minimum_filter1d(
        smooth, width
    )
    size = np.abs(smooth)
    return smooth, (spread <= _STEADY * size) & (size > TURNING_SHARE * size.max())


def flaw_text(recording: Recording, mark: Mark) -> str | None:
    """Return the audit's message about saturated or stuck samples in a mark, if any."""
    return next((flaw.message for flaw in flaws_of_mark(recording, mark)), None)


def average_dwells(
    recording: Recording,
    sensor: Sensor,
    dwells: Sequence[Dwell],
    harmonics: int = 0,
    sense: int = 1,
) -> tuple[Observations, tuple[Spin, ...]]:
    """Return one row per dwell, or one per azimuth with harmonics, and the plan steps of the rows.

    Parameters
    ----------
    recording : Recording
    sensor : Sensor
    dwells : sequence of Dwell
    harmonics : int
        0 for a platform locked to the arm; otherwise the highest harmonic of the fit.
    sense : 1 or -1
        Direction of a positive rate: 1 is counter-clockwise, -1 clockwise. Azimuths are counted
        from the start of the recording.

    Raises
    ------
    InputError
        There are too few turns to estimate a covariance of the sensor's axes.
    """
    k = 2 * harmonics + 1
    columns = [recording.channels.index(name) for name in sensor.channels]
    angle = swept_angle(recording.readback[ARM_RATE], recording.time)
    means: list[Array] = []
    scatters: list[Array] = []
    for dwell in dwells:
        inside = slice(dwell.mark.start, dwell.mark.stop)
        y = sensor.to_si(recording.data[inside, columns])
        by_turn = _turn_readings(y, sense * angle[inside], dwell.turns, harmonics)
        means.append(by_turn.mean(axis=0))
        off = (by_turn - means[-1]).reshape(-1, y.shape[-1])
        scatters.append(off.T @ off)
    ranges = [(d.mark.start, d.mark.stop) for d in dwells]
    seconds = np.array([recording.span(*limits) for limits in ranges])
    covariance, dof = _pooled_covariance(recording, dwells, seconds, scatters, k)
    coarse = reading_steps(recording.data, columns, sensor, ranges)
    mean, covariance = np.concatenate(means), np.repeat(covariance, k, axis=0)
    errors = coarse.errors_of_means(mean)
    rounding, covariance, notes = add_rounding(sensor, errors, covariance, coarse.variance)
    samples = np.array([d.mark.stop - d.mark.start for d in dwells])
    starts = np.array([recording.time[d.mark.start] for d in dwells])
    noises, elapsed = [axis.noise for axis in sensor.axes], starts + seconds / 2 - recording.time[0]
    drift = drift_covariance(noises, elapsed, seconds, recording.duration)
    if drift is not None:
        drift = drift.repeat(k, axis=0).repeat(k, axis=1)
    steps = tuple(
        Spin(d.mark.label, d.rate, 0.0, d.attitude)
        if not harmonics
        else Spin(f"{d.mark.label}, {360 * j / k:.0f}°", d.rate, 0.0, d.attitude, 2 * pi * j / k)
        for d in dwells
        for j in range(k)
    )
    kelvin = recording.temperature
    if kelvin is not None:
        kelvin = np.repeat([float(kelvin[d.mark.start : d.mark.stop].mean()) for d in dwells], k)
    observations = Observations(
        labels=tuple(step.label for step in steps),
        mean=mean,
        covariance=covariance,
        duration=np.repeat(seconds, k),
        samples=np.repeat(samples, k),
        time=np.repeat(starts + seconds / 2, k),
        channels=sensor.channels,
        dof=dof,
        drift=drift,
        rounding=rounding,
        notes=notes,
        temperature=kelvin,
    )
    return observations, steps


def _turn_boundaries(angle: Array, turns: Sequence[int]) -> list[int]:
    """Return the sample indices at which an angle, (n,) rad from 0, completes the given turns."""
    limits = 2 * pi * np.array(turns) - 0.5 * angle[1]
    return [int(np.count_nonzero(angle < limit)) for limit in limits.tolist()]


def swept_angle(rate: Array, time: Array) -> Array:
    """Return the angle, rad, swept since the first sample by a rate, (n,) rad/s."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _turn_readings(y: Array, azimuth: Array, turns: int, harmonics: int) -> Array:
    """Return the values for each turn, (turns, 2h + 1, m): its mean, or its harmonic curve."""
    along = np.abs(azimuth - azimuth[0])
    edges = [0, *_turn_boundaries(along, range(1, turns)), len(y)]
    if harmonics == 0:
        return np.add.reduceat(y, edges[:-1])[:, None] / np.diff(edges)[:, None, None]
    # An error of 1e-6 in the readback rate shifts the phase of readings of tens of g from turn to
    # turn. The first harmonic of the dwell measures the arm's azimuth far better.
    first = _harmonics(y, azimuth, edges, 1)
    wave = first[:, 1] - 1j * first[:, 2]
    phase = np.unwrap(np.angle((wave * wave[:1].conj()).sum(axis=-1)))
    middle = np.array([azimuth[a:b].mean() for a, b in pairwise(edges)])
    off = middle - middle.mean()
    slope = float(off @ phase / (off @ off))
    azimuth = azimuth + slope * (azimuth - middle.mean())
    at = _harmonic_basis(2 * pi * np.arange(2 * harmonics + 1) / (2 * harmonics + 1), harmonics)
    return at @ _harmonics(y, azimuth, edges, harmonics)


def _harmonics(y: Array, azimuth: Array, edges: Sequence[int], highest: int) -> Array:
    """Return the mean, cosines and sines for each turn, (turns, 2h + 1, m)."""
    fits = [
        np.linalg.lstsq(_harmonic_basis(azimuth[a:b], highest), y[a:b])[0]
        for a, b in pairwise(edges)
    ]
    return np.stack(fits).astype(np.float64, copy=False)


def _harmonic_basis(azimuth: Array, harmonics: int) -> Array:
    """Return the columns 1, cos α, …, cos hα, sin α, …, sin hα."""
    angles = azimuth[:, None] * np.arange(1, harmonics + 1)
    return np.concatenate([np.ones((len(azimuth), 1)), np.cos(angles), np.sin(angles)], axis=1)


def _pooled_covariance(
    recording: Recording,
    dwells: Sequence[Dwell],
    seconds: Array,
    scatters: Sequence[Array],
    rows: int,
) -> tuple[Array, float]:
    """Return the covariance of each dwell's rows, (d, m, m), and the smallest dof of any dwell.

    Dwells at the same rate share their noise density, which is the scatter of turns times their
    length. If a rate has too few turns, all dwells share one density.
    """
    m = scatters[0].shape[0]
    rates = np.array([abs(dwell.rate) for dwell in dwells])
    turns = np.array([dwell.turns for dwell in dwells])
    alike = np.abs(rates[:, None] / rates - 1) < _ALIKE
    freedom = alike @ (rows * (turns - 1))
    if freedom.min() < 10 * m:
        alike = np.ones_like(alike)
        freedom = alike @ (rows * (turns - 1))
    if freedom.min() < 10 * m:
        raise InputError(
            f"{recording.source or 'recording'}: {int(turns.sum())} turns in {len(dwells)} dwells "
            f"are too few to estimate the noise of {m} channels; record longer dwells"
        )
    densities = np.stack(scatters) * (seconds / turns)[:, None, None]
    total = np.einsum("de,eij->dij", alike, densities)
    return total / (freedom * seconds)[:, None, None], float(freedom.min())
