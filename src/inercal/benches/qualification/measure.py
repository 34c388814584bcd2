"""Compute the parameters of a bench from the section [measurement] of an input file."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import error_location
from inercal.basics.units import Measured
from inercal.benches.qualification.linear_fit import MeasuredParameters
from inercal.benches.qualification.measurements import angles, arms, earth
from inercal.benches.qualification.result import ANY_BENCH, Qualification
from inercal.physics.earth import normal_gravity
from inercal.physics.section_settings import Section, key_error, measured_constant, si_value
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.read import read_table

_RATE_NAMES = {
    "centrifuge": ("rate",),
    "rate_table": ("rate",),
    "rate_platform": ("rate_scale", "rate_asymmetry"),
}
_STABILITY_NAMES = {
    "centrifuge": "dwell_rate",
    "rate_platform": "rate_stability",
    "rate_table": "speed",
}


@dataclass(frozen=True)
class MeasurementInput:
    """The section [measurement] of an input file, with everything that it refers to.

    Parameters
    ----------
    section : Section
        Section for this kind of measurement.
    folder : Path
        Folder of the input file.
    bench : str
        Kind of the bench.
    uses : sequence of Qualification
        Earlier qualifications that this one uses.
    """

    section: Any
    folder: Path
    bench: str
    uses: Sequence[Qualification]

    @cached_property
    def table(self) -> Table:
        """The table of readings."""
        with error_location("[measurement] file", key="[measurement] file"):
            return read_table(self.folder / self.section.file)

    def column(self, key: str, like: str = "") -> Array:
        """Return the column that a key names, in SI if it has a unit, which KEY_unit states."""
        name = getattr(self.section, key)
        if name not in self.table.columns:
            raise key_error(
                f"[measurement] {key}",
                f"{self.section.file} has no column {name!r}; its columns are "
                f"{', '.join(self.table.columns)}",
                names=(name,),
            )
        values = np.asarray(self.table.numbers(name), dtype=float)
        if not values.size or not np.isfinite(values).all():
            raise key_error(f"[measurement] {key}", f"column {name!r} is empty or not finite")
        if like:
            unit_key = f"{key}_unit"
            unit = getattr(self.section, unit_key)
            values = values * si_value(f"1 {unit}", like, f"[measurement] {unit_key}")
        return values

    def numbers(self, key: str) -> NDArray[np.intp] | None:
        """Return the column of whole numbers that a key names, or None if it names none."""
        if getattr(self.section, key) is None:
            return None
        values = self.column(key)
        if (values != np.round(values)).any():
            raise key_error(f"[measurement] {key}", "the column must contain whole numbers")
        return values.astype(np.intp)

    def deviation(self, key: str, like: str) -> float:
        """Return the standard deviation that a key states, SI; the key must not be missing."""
        value = si_value(self.text(key), like, f"[measurement] {key}")
        if value < 0:
            raise key_error(f"[measurement] {key}", "is negative; give 0 or more")
        return value

    def noise(self, key: str, like: str) -> float:
        """Return the standard deviation that a key states, SI; it must be positive."""
        value = self.deviation(key, like)
        if value == 0:
            raise key_error(f"[measurement] {key}", "must be positive: no reading is exact")
        return value

    def constant(self, key: str, like: str) -> Measured:
        """Return the measured constant that a key states, SI; the key must not be missing."""
        return measured_constant(self.text(key), like, f"[measurement] {key}", last_digit=False)

    def text(self, key: str) -> str:
        """Return the text of a key.

        Raises
        ------
        InputError
            The key is missing.
        """
        text = getattr(self.section, key)
        if text is None:
            stated: Section = self.section
            example = (type(stated).model_fields[key].examples or [""])[0]
            raise key_error(f"[measurement] {key}", f"is missing; state it, such as {example!r}")
        return text

    def require_bench(self, *kinds: str) -> None:
        """Refuse a bench that is not of one of these kinds.

        Raises
        ------
        InputError
            The bench is of another kind.
        """
        if self.bench not in kinds:
            text = f"{self.bench!r} has no such parameter; give {' or '.join(kinds)}"
            raise key_error("[qualification] bench", text, names=kinds)

    def used(self, name: str) -> Measured | None:
        """Return a parameter from the earlier qualifications, or None if they do not contain it."""
        for one in self.uses:
            if name in one.names:
                k = one.names.index(name)
                return Measured(one.parameters[k].value, float(one.std[k]))
        return None


def measure_head_map(given: MeasurementInput) -> MeasuredParameters:
    """Measure the harmonics of a dividing head or of one axis of a turntable."""
    section = given.section
    given.require_bench("dividing_head", "turntable")
    face = given.numbers("face")
    result = angles.head_map(
        given.column("angle", "°"),
        given.column("reading", "°"),
        given.noise("autocollimator", "°"),
        section.harmonics,
        deviation=_certified_deviations(given),
        certificate_sd=given.deviation("polygon_sd", "°"),
        division_sd=given.deviation("division", "°"),
        face=None if face is None else face - 1,
        series=given.numbers("series"),
    )
    if given.bench == "dividing_head":
        return result
    axis = given.text("axis")
    # The signs differ: a table's readback leads its axis by the error, but a head's spindle leads
    # its angle.
    return replace(
        result, names=tuple(f"{name}[{axis}]" for name in result.names), value=-result.value
    )


def _certified_deviations(given: MeasurementInput) -> Array | None:
    if given.section.polygon is None:
        return None
    key = "[measurement] polygon"
    with error_location(key, key=key):
        table = read_table(given.folder / given.section.polygon)
        deviation = np.asarray(table.numbers("deviation"), dtype=float)
    unit = given.section.polygon_unit
    return deviation * si_value(f"1 {unit}", "°", "[measurement] polygon_unit")


def measure_table_tilt(given: MeasurementInput) -> MeasuredParameters:
    """Measure the lean of a turntable, or the standard deviation of a rate table's lean at rest."""
    given.require_bench("turntable", "rate_table")
    if given.section.level_at == "base":
        angles.refuse_base_level()
    absolute = given.bench == "turntable"
    level = si_value(given.text("azimuth"), "°", "[measurement] azimuth") if absolute else 0.0
    result = angles.table_tilt(
        given.column("angle", "°"),
        given.column("reading", "°"),
        given.noise("level", "°"),
        level,
        given.deviation("level_scale", "1"),
        given.section.wobble,
    )
    if absolute:
        return result
    # At random azimuths, the mean square of each component is half the square of the lean.
    variance = (float(result.value @ result.value) + float(np.trace(result.covariance))) / 2
    return replace(
        result, names=("lean_1", "lean_2"), value=np.zeros(2), covariance=variance * np.eye(2)
    )


def measure_right_angle(given: MeasurementInput) -> MeasuredParameters:
    """Measure the deviation of two axes of a turntable from a right angle."""
    given.require_bench("turntable")
    number = given.section.right_angle
    return angles.right_angle(
        given.column("angle", "°"),
        given.column("sense"),
        given.column("reading", "°"),
        given.noise("level", "°"),
        f"square_{number}",
        angles.right_angle_sign(given.section.axes, number),
        given.deviation("level_scale", "1"),
    )


def measure_radius(given: MeasurementInput) -> MeasuredParameters:
    """Measure the radius of an arm and, if requested, its stretch."""
    given.require_bench("centrifuge", "rate_table")
    section = given.section
    if section.by == "machine":
        return arms.radius_by_machine(
            given.column("reading", "m"),
            given.noise("reading_sd", "m"),
            given.deviation("machine", "m"),
        )
    if section.stretch:
        given.require_bench("centrifuge")
    rate = given.used("rate")
    if rate is not None and section.rate_error is not None:
        raise key_error(
            "[measurement] rate_error",
            "the rate is already qualified in a file that uses names; remove rate_error",
        )
    known = arms.RadiusSensor(
        given.noise("reading_sd", "m/s²"),
        given.deviation("scale", "1"),
        None if section.k2 is None else given.constant("k2", "1/(m/s²)"),
        given.deviation("rate_error", "1") if rate is None else rate.sd,
        given.used("g"),
    )
    return arms.radius_by_sensor(
        given.column("rate", "rad/s"),
        given.column("reading", "m/s²"),
        known,
        stretch=section.stretch,
        rate_value=0.0 if rate is None else rate.value,
        keep_rate=rate is not None,
    )


def measure_rate(given: MeasurementInput) -> MeasuredParameters:
    """Measure the relative error of the rates of a table or an arm."""
    given.require_bench(*_RATE_NAMES)
    return arms.rate_error(
        *_counts(given), given.deviation("timebase", "1"), _RATE_NAMES[given.bench]
    )


def measure_rate_stability(given: MeasurementInput) -> MeasuredParameters:
    """Measure how much the rate varies between counts, as a standard deviation."""
    given.require_bench(*_STABILITY_NAMES)
    return arms.rate_stability(*_counts(given), _STABILITY_NAMES[given.bench])


def _counts(given: MeasurementInput) -> tuple[Array, Array, Array, float]:
    return (
        given.column("rate", "rad/s"),
        given.column("turns"),
        given.column("seconds"),
        given.noise("timer", "s"),
    )


def measure_gravity(given: MeasurementInput) -> MeasuredParameters:
    """Measure gravity at the sensor."""
    given.require_bench(ANY_BENCH)
    section, done = given.section, earth.NO_FIT
    if section.by == "computed":
        latitude = si_value(given.text("latitude"), "°", "[measurement] latitude")
        height = si_value(given.text("height"), "m", "[measurement] height")
        point = normal_gravity(latitude, height)
    else:
        point = given.constant("gravity", "m/s²")
        if point.sd == 0:
            raise key_error("[measurement] gravity", "has no uncertainty; write '± 0.1 µm/s²'")
    if section.by == "network":
        given.text("file")
        point, done = earth.tied_gravity(
            point,
            given.column("site"),
            given.column("hours"),
            given.column("reading", "m/s²"),
            given.noise("reading_sd", "m/s²"),
            given.deviation("scale", "1"),
        )
    return earth.local_gravity(
        point,
        si_value(section.above, "m", "[measurement] above"),
        gradient=None if section.gradient is None else given.constant("gradient", "1/s²"),
        tide=section.tide == "corrected",
        fit=done,
    )


def measure_azimuth(given: MeasurementInput) -> MeasuredParameters:
    """Measure the azimuth of a turntable at its zero angles."""
    given.require_bench("turntable")
    offset = given.constant("offset", "°")
    return earth.earth_rate_azimuth(
        given.column("angle", "°"),
        given.column("reading", "°/s"),
        given.noise("reading_sd", "°/s"),
        si_value(given.text("latitude"), "°", "[measurement] latitude"),
        (offset.value, offset.sd),
        given.deviation("scale", "1"),
    )


MEASUREMENTS: Mapping[str, Callable[[MeasurementInput], MeasuredParameters]] = {
    "head_map": measure_head_map,
    "table_tilt": measure_table_tilt,
    "right_angle": measure_right_angle,
    "radius": measure_radius,
    "rate": measure_rate,
    "rate_stability": measure_rate_stability,
    "gravity": measure_gravity,
    "azimuth": measure_azimuth,
}
