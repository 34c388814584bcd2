"""Convert the noise stated on a data sheet to N, B and K, and compare measured noise with it.

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
from math import isfinite, nan, pi, sin, sqrt
from typing import Any, Literal

from inercal.basics.errors import InputError
from inercal.basics.units import (
    format_number,
    format_quantity,
    format_value_and_uncertainty,
    si_factor,
)
from inercal.estimation.uncertainty import COVERAGE
from inercal.noise.channel_noise import QUANTITIES, ChannelNoise, NoiseAnalysis, coefficient_unit
from inercal.noise.sensor_noise import (
    SensorNoise,
    TriadNoise,
    axis_coefficient,
    root_mean_of_squares,
)
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


_NEAR = 0.1  # relative distance from √2 within which a ratio suggests the other kind
_AXES = 3

HEADS = ("channel", "term", "measured", "U (k = 2)", "data sheet", "unit", "measured / data sheet",
         "data sheet holds")  # fmt: skip
_ONE_SIDED = 1.645  # standard deviations, 95 %


@dataclass(frozen=True)
class SheetComparison:
    """A measured coefficient compared with the value on a data sheet, SI.

    Parameters
    ----------
    channel : str
    quantity : "gyro" or "accelerometer"
    symbol : "N", "B" or "K"
    value, u : float
        Measured value and its standard uncertainty. If at most a limit is known, the value is 0 and
        the uncertainty is infinite.
    limit : float or None
        Upper limit (95 %), if only a limit is known.
    sheet : float
    """

    channel: str
    quantity: SensorKind
    symbol: str
    value: float
    u: float
    limit: float | None
    sheet: float

    @property
    def ratio(self) -> float | None:
        """Measured value divided by stated value; None if there is no measured value."""
        return self.value / self.sheet if self.value else None

    @property
    def ratio_u(self) -> float | None:
        """Standard uncertainty of the ratio, due to the measurement only."""
        return self.u / self.sheet if self.value else None

    @property
    def holds(self) -> str:
        """Whether the sensor is at most at the stated value: "yes", "no" or "open" (95 %)."""
        if not self.value:
            return "yes" if self.limit is not None and self.limit <= self.sheet else "open"
        if self.value + _ONE_SIDED * self.u <= self.sheet:
            return "yes"
        return "no" if self.value - _ONE_SIDED * self.u > self.sheet else "open"

    @property
    def unit(self) -> str:
        """Unit for display."""
        return coefficient_unit(self.symbol, self.quantity)

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of a table row with the columns `HEADS`."""
        size = si_factor(self.unit)
        sheet = format_number(self.sheet / size, 3)
        if not self.value:
            measured, ratio = "not found", ""
            if self.limit is not None:
                measured = f"< {format_number(self.limit / size, 3)}"
                ratio = f"< {format_number(self.limit / self.sheet, 3)}"
            return self.channel, self.symbol, measured, "", sheet, self.unit, ratio, self.holds
        value, spread = format_value_and_uncertainty(self.value / size, COVERAGE * self.u / size)
        share, its = format_value_and_uncertainty(
            self.value / self.sheet, COVERAGE * self.u / self.sheet
        )
        ratio = f"{share} ± {its}"
        return self.channel, self.symbol, value, spread, sheet, self.unit, ratio, self.holds


def compare_with_sheet(
    analysis: NoiseAnalysis, sheet: DataSheetNoise
) -> tuple[SheetComparison, ...]:
    """Compare the coefficients of each channel with the values that the data sheet states.

    Raises
    ------
    InputError
        The data sheet states noise for a kind of sensor that is not in the recording. The error is
        also raised if the data sheet has values for three axes, but the recording has a different
        number of axes.
    """
    found: list[SheetComparison] = []
    for quantity in QUANTITIES:
        channels = analysis.of(quantity)
        for k, channel in enumerate(channels):
            for one in sheet.coefficients.get(quantity, ()):
                if len(one.values) > 1 and len(channels) != _AXES:
                    raise InputError(
                        f"[datasheet.{quantity}] has a value for each of {_AXES} axes, but "
                        f"{analysis.source or 'the recording'} has {len(channels)}; state one "
                        "value for all",
                        key=f"[datasheet.{quantity}]",
                    )
                found.append(_comparison(channel, one, k))
    if not found:
        raise InputError(
            f"data sheet {sheet.name} states values of {' and '.join(sheet.coefficients)}s, of "
            f"which {analysis.source or 'the recording'} has no channel; remove --datasheet",
            key="--datasheet",
        )
    return tuple(found)


def _comparison(channel: ChannelNoise, sheet: SheetCoefficient, k: int) -> SheetComparison:
    value, u = axis_coefficient(channel, sheet.symbol)
    own = channel.coefficient(sheet.symbol)
    limit = own.high if not value and own is not None else None
    return SheetComparison(
        channel.channel, channel.quantity, sheet.symbol, value, u, limit, sheet.of_axis(k)
    )


def kind_remarks(rows: Sequence[SheetComparison], sheet: DataSheetNoise) -> tuple[str, ...]:
    """Return a summary, and remarks on ratios near √2 or 1/√2: perhaps a confused white_kind."""
    found = [
        f"the data sheet {words}: " + ", ".join(f"{one.symbol} of {one.channel}" for one in some)
        for holds, words in (
            ("no", "does not hold for"),
            ("open", "cannot be judged for"),
        )
        if (some := [one for one in rows if one.holds == holds])
    ]
    if rows and not found:
        found.append("the data sheet holds for all values")
    for quantity in QUANTITIES:
        ratios = [
            one.ratio
            for one in rows
            if one.quantity == quantity and one.symbol == "N" and one.ratio
        ]
        stated = sheet.coefficient(quantity, "N")
        if not ratios or stated is None or " rms " in stated.stated:
            continue
        is_density = stated.stated.endswith("(density)")
        # A density was divided by √2 to obtain N.
        factor = sqrt(2) if is_density else 1 / sqrt(2)
        mean = root_mean_of_squares(ratios)
        if abs(mean / factor - 1) < _NEAR:
            other = "random walk" if is_density else "density"
            value = shown(stated.mean * factor, "N", quantity)
            found.append(
                f"the measured N of the {quantity}s is {mean:.2f} times the data sheet's. If "
                f"{stated.stated.rpartition(' (')[0]} were a {other}, N would be {value}, "
                "which is close to the measured value; check white_kind"
            )
    return tuple(found)


def comparison_object(one: SheetComparison) -> dict[str, Any]:
    """Return a comparison as an object for JSON, SI."""
    return {
        "channel": one.channel,
        "symbol": one.symbol,
        "measured": one.value or None,
        "u": one.u if one.value and isfinite(one.u) else None,
        "upper_limit": one.limit,
        "data_sheet": one.sheet,
        "ratio": one.ratio,
        "ratio_u": one.ratio_u,
        "holds": one.holds,
    }
