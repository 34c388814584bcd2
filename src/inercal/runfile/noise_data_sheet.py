"""Read a file that states the noise from a data sheet and the meaning of each number.

A data sheet may state "0.008 °/s/√Hz" or "0.34 °/√h" for the same sensor, because a one-sided noise
density is √2 times the random walk N. The file therefore states whether a number is a density or a
random walk. It also states how the bias instability is defined.
"""

from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import TypeVar, get_args

from pydantic import Field, ValidationError

from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import read_toml
from inercal.noise.channel_noise import QUANTITIES, SI_UNIT
from inercal.noise.data_sheet import (
    BandwidthKind,
    BiasKind,
    DataSheetNoise,
    SheetCoefficient,
    WhiteKind,
    bias_instability,
    minimum_without_flicker,
    noise_bandwidth,
    shown,
    white_noise,
    white_noise_of_rms,
)
from inercal.physics.quantities import SensorKind
from inercal.physics.section_settings import Section, key_error, positive_value
from inercal.runfile.validation_errors import schema_error

_Kind = TypeVar("_Kind")
_Axes = str | tuple[str, str, str]


class SheetNoiseSection(Section):
    """Keys of [datasheet.accelerometer] and its like: one value per axis or one for all."""

    white: _Axes | None = Field(None, examples=["0.008 °/s/√Hz", "60 µg/√Hz"])
    white_kind: WhiteKind | None = Field(None, examples=["density"])
    rms: _Axes | None = Field(None, examples=["0.06 °/s", "2 mg"])
    bandwidth: str | None = Field(None, examples=["50 Hz"])
    bandwidth_kind: BandwidthKind | None = Field(None, examples=["noise"])
    bias_instability: _Axes | None = Field(None, examples=["8 °/h", "13 µg"])
    bias_instability_kind: BiasKind | None = Field(None, examples=["minimum"])
    random_walk: _Axes | None = Field(None, examples=["1 °/h/√s", "1 µg/√s"])


class DataSheetSection(Section):
    """Keys of [datasheet]."""

    name: str = Field("", examples=["IMU 5"])
    rate: str | None = Field(None, description="of the samples", examples=["200 Hz"])
    accelerometer: SheetNoiseSection | None = None
    gyro: SheetNoiseSection | None = None
    magnetometer: SheetNoiseSection | None = None


class DataSheetFile(Section):
    """All sections of a data-sheet file."""

    datasheet: DataSheetSection


def read_noise_data_sheet(path: Path) -> DataSheetNoise:
    """Read the noise that a data sheet states.

    Raises
    ------
    InputError
        The file cannot be read, has an unknown key or a value that is not possible, or does not
        state the meaning of a number.
    """
    content = read_toml(path, "file of a data sheet")
    try:
        sheet = DataSheetFile.model_validate(content).datasheet
    except ValidationError as error:
        raise schema_error(error, content, DataSheetFile).located(path) from None
    with error_location(path):
        return _noise(sheet, path.stem)


def _noise(sheet: DataSheetSection, stem: str) -> DataSheetNoise:
    rate = 0.0
    if sheet.rate is not None:
        rate = positive_value(sheet.rate, "Hz", "[datasheet] rate")
    coefficients: dict[SensorKind, tuple[SheetCoefficient, ...]] = {}
    remarks: list[str] = []
    for quantity in QUANTITIES:
        section = getattr(sheet, quantity)
        if section is not None:
            coefficients[quantity] = _Reader(quantity, section, rate, remarks).coefficients()
    if not coefficients:
        raise InputError(
            "no noise: write [datasheet.gyro], [datasheet.accelerometer] or both", key="[datasheet]"
        )
    return DataSheetNoise(sheet.name or stem, rate, coefficients, tuple(remarks))


class _Reader:
    """Converter from one section to coefficients and remarks."""

    def __init__(
        self, quantity: SensorKind, section: SheetNoiseSection, rate: float, remarks: list[str]
    ):
        self._quantity: SensorKind = quantity
        self._section = section
        self._rate, self._remarks = rate, remarks
        self._unit = SI_UNIT[quantity]
        self._name = f"[datasheet.{quantity}]"

    def coefficients(self) -> tuple[SheetCoefficient, ...]:
        """Return the coefficients N, B and K that the data sheet states."""
        section = self._section
        self._require_partners()
        found: list[SheetCoefficient] = []
        if section.white is not None:
            found.append(self._white())
        if section.rms is not None:
            found.append(self._white_of_rms())
        if section.random_walk is not None:
            values, text = self._values("random_walk", f"({self._unit})/√s")
            found.append(SheetCoefficient("K", values, text))
        if section.bias_instability is not None:
            found.append(self._bias_instability(found))
        if not found:
            raise key_error(
                self._name, "states no noise: add white, rms, bias_instability or random_walk"
            )
        return tuple(sorted(found, key=lambda one: "NBK".index(one.symbol)))

    def _require_partners(self) -> None:
        """Raise an error if a kind or a bandwidth has no value, or white noise is stated twice."""
        section = self._section
        for key, of in (
            ("white_kind", "white"),
            ("bandwidth", "rms"),
            ("bandwidth_kind", "bandwidth"),
            ("bias_instability_kind", "bias_instability"),
        ):
            if getattr(section, key) is not None and getattr(section, of) is None:
                raise key_error(
                    f"{self._name} {key}", f"this key needs {of}, which is missing: add it"
                )
        if section.white is not None and section.rms is not None:
            raise key_error(
                f"{self._name} rms",
                "white and rms both state the white noise: keep only one, preferably white",
            )

    def _values(self, key: str, like: str) -> tuple[tuple[float, ...], str]:
        """Return the values of a key in SI units, and their text."""
        stated = getattr(self._section, key)
        texts: Sequence[str] = (stated,) if isinstance(stated, str) else stated
        return tuple(positive_value(one, like, f"{self._name} {key}") for one in texts), ", ".join(
            texts
        )

    def _white(self) -> SheetCoefficient:
        values, text = self._values("white", f"({self._unit})/√Hz")
        kind = self._section.white_kind
        if kind is None:
            meanings = self._meanings("N", get_args(WhiteKind), lambda k: white_noise(values[0], k))
            raise key_error(
                f"{self._name} white_kind",
                f"missing: {text} is {meanings}. A density, rms/√bandwidth, is one-sided and √2 "
                "times N; a random walk, usually in °/√h or m/s/√h, is N (1 °/√h = 1/60 °/s/√Hz)",
            )
        if kind == "density" and "√h" in text.replace(" ", ""):
            self._remarks.append(
                f"{self._name} white: {text} is stated as a density, but its unit is usually "
                "that of a random walk; check white_kind"
            )
        return SheetCoefficient(
            "N", tuple(white_noise(one, kind) for one in values), f"{text} ({kind})"
        )

    def _white_of_rms(self) -> SheetCoefficient:
        values, text = self._values("rms", self._unit)
        section = self._section
        if section.bandwidth is None:
            raise key_error(
                f"{self._name} bandwidth",
                f"missing: {text} rms states a density only together with its bandwidth, such as "
                'bandwidth = "50 Hz"',
            )
        band = positive_value(section.bandwidth, "Hz", f"{self._name} bandwidth")
        kind = section.bandwidth_kind
        if kind is None:
            meanings = self._meanings(
                "N", get_args(BandwidthKind), lambda k: white_noise_of_rms(values[0], band, k)
            )
            raise key_error(
                f"{self._name} bandwidth_kind",
                f"missing: with {section.bandwidth}, {text} rms is {meanings}. noise: the "
                "equivalent noise bandwidth; the orders: the −3 dB frequency of a Butterworth "
                "filter",
            )
        if self._rate and 2 * noise_bandwidth(band, kind) > self._rate:
            sampled = values[0] / self._rate**0.5
            self._remarks.append(
                f"{self._name} rms: its noise extends beyond half the sampling rate of "
                f"{self._rate:g} Hz and is aliased unless another filter removes it: the "
                f"samples then have N = {shown(sampled, 'N', self._quantity)}"
            )
        return SheetCoefficient(
            "N",
            tuple(white_noise_of_rms(one, band, kind) for one in values),
            f"{text} rms within {section.bandwidth} ({kind})",
        )

    def _bias_instability(self, others: Sequence[SheetCoefficient]) -> SheetCoefficient:
        """Return B; if the sheet states a minimum, subtract white noise and random walk from it."""
        values, text = self._values("bias_instability", self._unit)
        kind = self._section.bias_instability_kind
        if kind is None:
            meanings = self._meanings(
                "B", get_args(BiasKind), lambda k: bias_instability(values[0], k)
            )
            raise key_error(
                f"{self._name} bias_instability_kind",
                f"missing: {text} is {meanings}. Data sheets usually state the minimum of the "
                "Allan deviation, 0.664 B",
            )
        both = {one.symbol: one for one in others}
        if kind == "coefficient" or set(both) != {"N", "K"}:
            if kind == "minimum":
                self._remarks.append(
                    f"{self._name} bias_instability: white noise and random walk raise the "
                    "minimum, so B is too large; state them to subtract them"
                )
            found = tuple(bias_instability(one, kind) for one in values)
            return SheetCoefficient("B", found, f"{text} ({kind})")
        count = max(len(values), *(len(one.values) for one in others))
        own = SheetCoefficient("B", values, text)
        least = [
            minimum_without_flicker(both["N"].of_axis(k), both["K"].of_axis(k))
            for k in range(count)
        ]
        found = tuple(bias_instability(own.of_axis(k), kind, least[k]) for k in range(count))
        if not all(isfinite(one) for one in found):
            raise key_error(
                f"{self._name} bias_instability",
                f"{text} is below {shown(max(least), 'B', self._quantity)}, the minimum Allan "
                "deviation that white and random_walk would already give: check all three",
            )
        return SheetCoefficient("B", found, f"{text} ({kind}, after subtracting N and K)")

    def _meanings(
        self, symbol: str, kinds: Sequence[_Kind], value: Callable[[_Kind], float]
    ) -> str:
        """Describe what a number would mean for each kind: '"density": N = 0.34 °/√h, …'."""
        return ", ".join(
            f'{symbol} = {shown(value(one), symbol, self._quantity)} as "{one}"' for one in kinds
        )
