"""Compare measured noise with the noise stated on a data sheet, channel by channel."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.units import format_number, format_value_and_uncertainty, si_factor
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.noise.channel_noise import (
    QUANTITIES,
    ChannelNoise,
    NoiseAnalysis,
    coefficient_unit,
)
from inercal.physics.quantities import SensorKind
from inercal.noise.data_sheet import DataSheetNoise, SheetCoefficient, shown
from inercal.noise.sensor_noise import axis_coefficient, root_mean_of_squares

_NEAR = 0.1  # relative distance from √2 within which a ratio suggests the other kind
_AXES = 3

HEADS = ("channel", "term", "measured", "U (k = 2)", "data sheet", "unit", "measured / data sheet")


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
            return self.channel, self.symbol, measured, "", sheet, self.unit, ratio
        value, spread = format_value_and_uncertainty(self.value / size, COVERAGE * self.u / size)
        share, its = format_value_and_uncertainty(
            self.value / self.sheet, COVERAGE * self.u / self.sheet
        )
        ratio = f"{share} ± {its}"
        return self.channel, self.symbol, value, spread, sheet, self.unit, ratio


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
    """Return remarks on ratios near √2 or 1/√2; they suggest a confused kind of white noise."""
    found: list[str] = []
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
    }
