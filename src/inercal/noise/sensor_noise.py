"""Sensor noise in the form that other programs use: one N, B and K for all axes of a kind.

The values come from an analysis (`sensor_noise`) or a data sheet (`inercal.noise.data_sheet`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from inercal.basics.errors import InputError
from inercal.noise.channel_noise import QUANTITIES, ChannelNoise, NoiseAnalysis
from inercal.noise.terms import FLICKER_FLOOR
from inercal.noise.texts import filter_notes
from inercal.physics.quantities import SensorKind

MARKOV_PEAK = 0.617  # largest Allan deviation of a Gauss–Markov process, over σ


@dataclass(frozen=True)
class TriadNoise:
    """Noise of the axes of one kind, SI.

    Parameters
    ----------
    quantity : "gyro" or "accelerometer"
    axes : tuple of mapping of symbol to value
        Coefficients of each axis, or their upper limits; 0 or absent if neither value nor limit is
        known.
    values : dict of symbol to (value, u)
        N, B and K as root mean squares over the axes; B is omitted if no axis has B. If an axis has
        only an upper limit, the limit is used. A Gauss–Markov process is stated as the bias
        instability with the same peak of the Allan deviation. u is None if it is not stated.
    limits : tuple of str
        Symbols for which all axes have only an upper limit.
    notes : tuple of str
        Notes that explain values that are not the coefficient of an axis.
    rate_hz : float
        Sampling rate, Hz; 0 if unknown.
    origins : mapping of symbol to str
        The values as written on a data sheet, used in comments.
    """

    quantity: SensorKind
    axes: tuple[Mapping[str, float], ...]
    values: dict[str, tuple[float, float | None]]
    notes: tuple[str, ...]
    rate_hz: float
    origins: Mapping[str, str] = field(default_factory=dict[str, str])
    limits: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorNoise:
    """Noise of accelerometers, gyros or both.

    Parameters
    ----------
    source : str
        Name of the recording or of the data sheet, which written files state.
    duration : float
        Duration of the recording, s; 0 for a data sheet.
    triads : dict of quantity to TriadNoise
    is_data_sheet : bool
    """

    source: str
    duration: float
    triads: dict[SensorKind, TriadNoise]
    is_data_sheet: bool = False


def sensor_noise(analysis: NoiseAnalysis) -> SensorNoise:
    """Convert the noise found by an analysis to a `SensorNoise`.

    Raises
    ------
    InputError
        A channel has no coefficients.
    """
    require_stated(analysis)
    triads: dict[SensorKind, TriadNoise] = {
        quantity: _triad(axes, quantity)
        for quantity in QUANTITIES
        if (axes := analysis.of(quantity))
    }
    return SensorNoise(analysis.source or "a recording", analysis.duration, triads)


def require_stated(analysis: NoiseAnalysis) -> None:
    """Raise an error if a channel in an analysis has no coefficients.

    Raises
    ------
    InputError
        A channel has no coefficients; the message names it, the coefficients and the reason.
    """
    for one in analysis.channels:
        if one.disturbed:
            raise InputError(
                f"{analysis.source or 'recording'}: nothing is written, because the noise of "
                f"{one.channel} is not to be relied on: {one.disturbed}",
                file=analysis.source or None,
                names=(one.channel,),
            )
        if one.refusal is not None:
            raise InputError(
                f"{analysis.source or 'recording'}: {one.channel}: {one.refusal.text}; nothing "
                "is written for this recording",
                file=analysis.source or None,
                names=(one.channel,),
            )


def require_rate(noise: TriadNoise) -> float:
    """Return the sampling rate, Hz.

    Raises
    ------
    InputError
        The data sheet does not state the sampling rate.
    """
    if not noise.rate_hz:
        raise InputError(
            'the data sheet has no sampling rate, but --to needs it; add rate = "200 Hz" to '
            "[datasheet]",
            key="[datasheet] rate",
        )
    return noise.rate_hz


def axis_coefficient(channel: ChannelNoise, symbol: str) -> tuple[float, float]:
    """Return N, B or K of a channel and its u, SI; both are 0 if the term was not found.

    A Gauss–Markov process is stated as the bias instability whose Allan deviation has the same
    peak, B = 0.617 σ/0.664.
    """
    found = channel.coefficient(symbol)
    if symbol == "B" and (markov := channel.coefficient("G")) is not None and markov.value:
        factor = MARKOV_PEAK / float(np.sqrt(FLICKER_FLOOR))
        value = 0.0 if found is None else found.value
        total = float(np.hypot(value, factor * markov.value))
        return total, factor * markov.u
    if found is None or not found.value:
        return 0.0, 0.0
    return found.value, found.u


def root_mean_of_squares(values: Sequence[float]) -> float:
    """Return the root mean square of some values."""
    return float(np.sqrt(np.mean(np.square(values))))


def _triad(axes: Sequence[ChannelNoise], quantity: SensorKind) -> TriadNoise:
    values: dict[str, tuple[float, float | None]] = {}
    limits: list[str] = []
    for symbol in "NBK":
        pairs = [axis_coefficient(one, symbol) for one in axes]
        known = any(value for value, _ in pairs)
        if not known and symbol == "B":
            continue  # the limit of K also includes any drift that was not detected
        pairs = [
            pair if pair[0] else (one.value_or_limit(symbol), 0.0)
            for one, pair in zip(axes, pairs, strict=True)
        ]
        mean = root_mean_of_squares([value for value, _ in pairs])
        if not mean:
            continue
        if not known:
            values[symbol] = mean, None
            limits.append(symbol)
            continue
        sums = sum((value * u) ** 2 for value, u in pairs if u)
        values[symbol] = mean, float(np.sqrt(sums)) / (len(pairs) * mean)
    notes = [
        f"{one.channel}: a Gauss–Markov process with a time constant of {one.value('T'):.3g} s "
        "is stated as the bias instability with the same peak"
        for one in axes
        if one.value("G")
    ]
    notes += [f"{one.channel}: {text}" for one in axes for text in filter_notes(one)]
    for symbol in values:
        few = [one.channel for one in axes if not axis_coefficient(one, symbol)[0]]
        if few and symbol not in limits:
            notes.append(f"{symbol} of {', '.join(few)} is the upper limit (95 %)")
    limited = "NBK" if any(one.value("B") for one in axes) else "NK"
    coefficients = tuple(
        {one: axis.value_or_limit(one) if one in limited else axis.value(one) for one in "NBKGT"}
        for axis in axes
    )
    return TriadNoise(
        quantity, coefficients, values, tuple(notes), 1 / axes[0].dt, limits=tuple(limits)
    )
