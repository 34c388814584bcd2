"""Convert the noise stated on a data sheet to the coefficients N, B and K.

A noise density stated as rms/√bandwidth is one-sided, whereas N is the root of the two-sided
density::

    D² B_n = rms²,  D² = 2 N²          D one-sided density, B_n equivalent noise bandwidth
    N = D/√2 = rms/√(2 B_n)            N is also the angle or velocity random walk, σ_θ = N √t
    B_n = f₃ (π/2n)/sin(π/2n)          f₃ −3 dB frequency of a Butterworth filter of order n
    min² = (2 ln2/π) B² + 2 N K/√3     min is the minimum of the Allan deviation, at τ = √3 N/K

If K is unknown, B is calculated as min/√(2 ln2/π), which is slightly too large.
Sources: IEEE Std 952, annex B; IEEE Std 1293.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan, pi, sin, sqrt
from typing import Literal

from inercal.basics.units import format_quantity
from inercal.noise.channel_noise import QUANTITIES, coefficient_unit
from inercal.noise.sensor_noise import SensorNoise, TriadNoise, root_mean_of_squares
from inercal.noise.terms import FLICKER_FLOOR
from inercal.physics.quantities import SensorKind

WhiteKind = Literal["density", "random walk"]
BiasKind = Literal["minimum", "coefficient"]
BandwidthKind = Literal["noise", "first order", "second order"]
_ORDERS: dict[BandwidthKind, int] = {"first order": 1, "second order": 2}
_NO_UNCERTAINTY = (
    "a data sheet states typical values without uncertainty, and a single device may differ from "
    "them"
)


@dataclass(frozen=True)
class SheetCoefficient:
    """A coefficient calculated from a data sheet, SI.

    Parameters
    ----------
    symbol : "N", "B" or "K"
    values : tuple of float
        One value for all axes, or one value for each axis.
    stated : str
        The value on the data sheet, with its kind, such as "0.008 °/s/√Hz (density)".
    """

    symbol: str
    values: tuple[float, ...]
    stated: str

    def of_axis(self, k: int) -> float:
        """Return the value for axis k, which is 0, 1 or 2."""
        return self.values[0] if len(self.values) == 1 else self.values[k]

    @property
    def mean(self) -> float:
        """Root mean square over the axes."""
        return root_mean_of_squares(self.values)


@dataclass(frozen=True)
class DataSheetNoise:
    """Noise as stated on a data sheet.

    Parameters
    ----------
    name : str
        Name of the data sheet.
    rate_hz : float
        Sampling rate, Hz; 0 if none is stated.
    coefficients : dict of quantity to tuple of SheetCoefficient
    remarks : tuple of str
        Remarks on doubtful values.
    """

    name: str
    rate_hz: float
    coefficients: Mapping[SensorKind, tuple[SheetCoefficient, ...]]
    remarks: tuple[str, ...] = ()

    @property
    def sensor_noise(self) -> SensorNoise:
        """The noise in the form that files for other programs need."""
        triads: dict[SensorKind, TriadNoise] = {
            quantity: _triad(quantity, self.coefficients[quantity], self.rate_hz)
            for quantity in QUANTITIES
            if quantity in self.coefficients
        }
        return SensorNoise(f"data sheet {self.name}", 0.0, triads, is_data_sheet=True)

    @property
    def all_remarks(self) -> tuple[str, ...]:
        """All remarks, including the remark that a data sheet states no uncertainty."""
        return (_NO_UNCERTAINTY, *self.remarks)

    def coefficient(self, quantity: SensorKind, symbol: str) -> SheetCoefficient | None:
        """Return a coefficient, or None if it is not stated."""
        found = self.coefficients.get(quantity, ())
        return next((one for one in found if one.symbol == symbol), None)


def _triad(quantity: SensorKind, found: Sequence[SheetCoefficient], rate_hz: float) -> TriadNoise:
    axes = tuple({one.symbol: one.of_axis(k) for one in found} for k in range(3))
    values: dict[str, tuple[float, float | None]] = {one.symbol: (one.mean, None) for one in found}
    origins = {one.symbol: one.stated for one in found}
    return TriadNoise(quantity, axes, values, (), rate_hz, origins)


def white_noise(value: float, kind: WhiteKind) -> float:
    """Convert a one-sided noise density, or a random walk (which equals N), to N in SI.

    >>> round(white_noise(0.008, "density"), 6), white_noise(0.008, "random walk")
    (0.005657, 0.008)
    """
    return value / sqrt(2) if kind == "density" else value


def white_noise_of_rms(rms: float, bandwidth: float, kind: BandwidthKind) -> float:
    """Convert an rms value in a bandwidth, Hz, to N in SI.

    The noise is assumed to be white within this bandwidth.

    >>> round(white_noise_of_rms(1.0, 50.0, "noise"), 4)
    0.1
    """
    return rms / sqrt(2 * noise_bandwidth(bandwidth, kind))


def noise_bandwidth(bandwidth: float, kind: BandwidthKind) -> float:
    """Convert a filter's −3 dB frequency to its noise bandwidth, Hz, unless it already is one.

    >>> [round(noise_bandwidth(1.0, kind), 4) for kind in ("first order", "second order")]
    [1.5708, 1.1107]
    """
    if kind == "noise":
        return bandwidth
    angle = pi / (2 * _ORDERS[kind])
    return bandwidth * angle / sin(angle)


def bias_instability(value: float, kind: BiasKind, others: float = 0.0) -> float:
    """Convert the minimum of an Allan deviation, or the coefficient itself, to B in SI.

    The result is NaN if the other terms would already give a larger minimum.

    Parameters
    ----------
    value : float
    kind : "minimum" or "coefficient"
    others : float
        Minimum of the Allan deviation due to white noise and random walk only.

    >>> round(bias_instability(0.6643, "minimum"), 4)
    1.0
    """
    if kind == "coefficient":
        return value
    square = value**2 - others**2
    return sqrt(square / FLICKER_FLOOR) if square >= 0 else nan


def minimum_without_flicker(white: float, walk: float) -> float:
    """Return the minimum of the Allan deviation with only white noise N and random walk K, SI.

    >>> round(minimum_without_flicker(1.0, 3**0.5 / 2), 4)
    1.0
    """
    return sqrt(2 * white * walk / sqrt(3))


def shown(value: float, symbol: str, quantity: SensorKind) -> str:
    """Return a coefficient as text in its display unit: "0.339 °/√h"."""
    return format_quantity(value, 0.0, coefficient_unit(symbol, quantity), 3)
