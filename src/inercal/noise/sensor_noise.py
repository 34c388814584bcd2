"""The noise of a sensor as other programs take it: one value of N, B and K for the axes of a kind.

It comes from an analysis (`sensor_noise`) or from a data sheet (`inercal.noise.data_sheet`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis, Quantity
from inercal.noise.terms import FLICKER_FLOOR

MARKOV_PEAK = 0.617  # of σ: the largest Allan deviation of a Gauss–Markov process
QUANTITIES: tuple[Quantity, ...] = ("accelerometer", "gyro")


@dataclass(frozen=True)
class TriadNoise:
    """Noise of the axes of one kind, SI.

    Parameters
    ----------
    quantity : "gyro" or "accelerometer"
    axes : tuple of mapping of symbol to value
        Coefficients of each axis; 0 or absent where none is known.
    values : dict of symbol to (value, u)
        N, B and K: root mean squares over the axes, without those that no axis has. A Gauss–Markov
        process counts as a bias instability of equal peak. u is None where none is stated.
    notes : tuple of str
        Origin of a value that is not a coefficient of an axis.
    rate_hz : float
        0 where it is not known.
    origins : mapping of symbol to str
        What a data sheet states, for comments.
    """

    quantity: Quantity
    axes: tuple[Mapping[str, float], ...]
    values: dict[str, tuple[float, float | None]]
    notes: tuple[str, ...]
    rate_hz: float
    origins: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class SensorNoise:
    """Noise of accelerometers, gyros or both.

    Parameters
    ----------
    source : str
        The recording's file or the data sheet, for the files that are written.
    duration : float
        s, of the recording; 0 of a data sheet.
    triads : dict of quantity to TriadNoise
    is_data_sheet : bool
    """

    source: str
    duration: float
    triads: dict[Quantity, TriadNoise]
    is_data_sheet: bool = False


def sensor_noise(analysis: NoiseAnalysis) -> SensorNoise:
    """Return the noise that an analysis found."""
    triads: dict[Quantity, TriadNoise] = {}
    for quantity in QUANTITIES:
        if axes := analysis.of(quantity):
            triads[quantity] = _triad(axes, quantity)
    return SensorNoise(analysis.source or "a recording", analysis.duration, triads)


def axis_coefficient(channel: ChannelNoise, symbol: str) -> tuple[float, float]:
    """Return N, B or K of a channel and its u, SI; 0 and 0 where it was not found.

    A Gauss–Markov process counts as a bias instability of equal peak, B = 0.617 σ/0.664.
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
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _triad(axes: Sequence[ChannelNoise], quantity: Quantity) -> TriadNoise:
    values: dict[str, tuple[float, float | None]] = {}
    for symbol in "NBK":
        pairs = [axis_coefficient(one, symbol) for one in axes]
        if not any(value for value, _ in pairs):
            continue
        mean = root_mean_of_squares([value for value, _ in pairs])
        sums = sum((value * u) ** 2 for value, u in pairs if value)
        values[symbol] = mean, float(np.sqrt(sums)) / (len(pairs) * mean)
    notes = [
        f"{one.channel}: Gauss–Markov process with a time constant of "
        f"{one.value('T'):.3g} s, stated as the bias instability of equal peak"
        for one in axes
        if one.value("G")
    ]
    coefficients = tuple({one: axis.value(one) for one in "NBKGT"} for axis in axes)
    return TriadNoise(quantity, coefficients, values, tuple(notes), 1 / axes[0].dt)
