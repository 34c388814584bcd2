"""Check that the sections of a run file agree with each other and with external values.

Gravity is compared with normal gravity at the site, and the check standard shows whether the bench
was in control.

The magnetometers of a run file are only accepted if its method can use them.
"""

from collections.abc import Sequence
from math import degrees, isclose, sin
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.methods import METHODS, Method
from inercal.physics.earth import COMPUTED_GRAVITY_SD, UNKNOWN_HEIGHT, normal_gravity
from inercal.physics.plan import Step, Turn
from inercal.physics.quantities import QUANTITIES, SensorKind
from inercal.physics.section_settings import (
    MISSING_GRAVITY,
    BenchSection,
    BenchUsage,
    key_error,
    measured_constant,
    positive_value,
    section_gravity,
    si_value,
)
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.samples import STANDARD_GRAVITY
from inercal.recordings.temperature import COUNTS
from inercal.runfile.job import JobSection
from inercal.runfile.schema import (
    DataSection,
    MethodSection,
    ReadoutSection,
    RunSchema,
    SensorSection,
)

_ANOMALY = 1e-3  # m/s², 100 mGal: 2.5 standard deviations of free-air anomalies
_HIGHEST = 3000.0  # m, largest height if a laboratory states none
_BY_LATITUDE = 0.0517  # m/s² per radian at 45°; multiply by the sine of twice the latitude
_COVERAGE = 3.0
_LOCAL_GRAVITY = 1e-4  # largest relative uncertainty with which a value is stated as local gravity


def require_used_keys(
    schema: RunSchema,
    chosen: Method[Any, Any],
    steps: Sequence[Step],
    qualified: Sequence[str],
    folder: Path,
) -> None:
    """Raise an error for keys of [bench], [data] and [sensor] that have no effect.

    Parameters
    ----------
    schema : RunSchema
    chosen : Method
    steps : sequence of Step
        Steps of the method's plan, if the plan is known before the data are read.
    qualified : sequence of str
        Keys of [bench] that come from a qualification. They are not checked, because a
        qualification is used with several methods.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        A key has no effect; the message names the key and the reason.
    """
    use = BenchUsage(
        method=chosen.name,
        turns=any(isinstance(step, Turn) for step in steps),
        attitudes=not chosen.unknown_attitudes,
        gyros="w" in chosen.default_coefficients and schema.sensor.gyro is not None,
        magnetometers=schema.sensor.magnetometer is not None,
        means=schema.data.kind == "means",
        rest=chosen.follows_rest,
        angles=not chosen.without_angles,
        one_file=schema.data.kind == "recording" and not is_pattern(folder / schema.data.file),
        qualified=tuple(qualified),
    )
    stated = schema.bench.gravity is not None or schema.bench.latitude is not None
    if not (stated or chosen.follows_rest):
        raise key_error("[bench]", MISSING_GRAVITY)
    sections: dict[str, BenchSection | DataSection | ReadoutSection | None] = {
        "bench": schema.bench,
        "data": schema.data,
        **{f"sensor.{kind}": section for kind, section in _readouts(schema.sensor).items()},
    }
    for name, section in sections.items():
        if section is None:
            continue
        for key, reason in section.unused_keys(use).items():
            if key in section.model_fields_set and not (name == "bench" and key in qualified):
                place = f"[{name}] {key}"
                raise InputError(f"{place}: {reason}; remove {key}", key=place)


def assumed_units(sensor: SensorSection) -> tuple[Finding, ...]:
    """Return a warning for each unit that neither the user nor the data confirm."""
    return tuple(
        Finding(
            "warning",
            "units",
            f"the unit of the {kind}s was assumed to be {section.unit}"
            f"{f' with {section.scale}' if section.scale else ''}; check it in the data sheet, "
            f"and then remove unit_assumed from [sensor.{kind}]",
        )
        for kind, section in _readouts(sensor).items()
        if section.unit_assumed
    )


def _readouts(sensor: SensorSection) -> dict[SensorKind, ReadoutSection]:
    """Return the stated sections of the axes, by the word for their kind."""
    every: dict[SensorKind, ReadoutSection | None] = {
        one.sensor: getattr(sensor, one.sensor) for one in QUANTITIES.values()
    }
    return {kind: section for kind, section in every.items() if section is not None}


def check_stated_gravity(section: BenchSection) -> tuple[Finding, ...]:
    """Compare the stated gravity with normal gravity at the stated latitude and height.

    Return a note if gravity is computed without a height. Return a warning if the difference
    exceeds an anomaly of 100 mGal plus three standard uncertainties. If no height is stated, any
    height from 0 to 3000 m is considered possible. Another note says if gravity is stated as
    exactly standard gravity, as only a laboratory high above the sea measures it at this latitude.

    Parameters
    ----------
    section : section of [bench]
        The section; its values have already been checked.
    """
    if section.latitude is None:
        return ()
    if section.gravity is None:
        return () if section.height is not None else (_without_height(section),)
    stated = measured_constant(section.gravity, "m/s²", "[bench] gravity")
    place = measured_constant(section.latitude, "°", "[bench] latitude")
    height = None if section.height is None else si_value(section.height, "m", "[bench] height")
    normal = normal_gravity(place.value, height or 0.0).value
    lowest = normal if height is not None else normal_gravity(place.value, _HIGHEST).value
    slope = _BY_LATITUDE * abs(sin(2 * place.value))
    margin = _ANOMALY + _COVERAGE * (stated.sd + slope * place.sd)
    at = f"{degrees(place.value):.6g}° of latitude and " + (
        "0 to 3000 m (no height is stated)" if height is None else f"{height:g} m"
    )
    of_place = f"{normal:.5f} m/s²" if height is not None else f"{lowest:.4f} to {normal:.4f} m/s²"
    both = f"gravity is stated as {stated.value:.5f} m/s²; normal gravity at {at} is {of_place}"
    if (
        height is None
        and isclose(stated.value, G0, rel_tol=1e-9)
        and stated.sd < _LOCAL_GRAVITY * stated.value
        and margin < normal - stated.value <= normal - lowest
    ):
        rise = _HIGHEST * (normal - stated.value) / (normal - lowest)
        text = (
            f"gravity {G0} m/s² is standard gravity, not the local value; at "
            f"{degrees(place.value):.6g}° of latitude, gravity is {normal:.4f} m/s² at sea level, "
            f"and {G0} m/s² at a height of about {rise:.0f} m; state the local gravity, or "
            "[bench] height if this is the height"
        )
        return (Finding("note", STANDARD_GRAVITY, text),)
    if lowest - margin <= stated.value <= normal + margin:
        difference = f"{1e5 * (stated.value - normal):+.0f} mGal"
        off = f"; the difference is {difference}" if height is not None else ""
        return (Finding("note", "gravity", both + off),)
    text = (
        f"gravity {stated.value:.5f} does not fit latitude {degrees(place.value):.6g}° ("
        f"{lowest - margin:.4f} to {normal + margin:.4f} m/s²): {both}; no gravity anomaly is that "
        "large, and the error affects the scale factors; check [bench] gravity, latitude and height"
    )
    return (Finding("warning", "gravity", text),)


def _without_height(section: BenchSection) -> Finding:
    """Return a note that gravity was computed without a height, with its uncertainty."""
    gravity = section_gravity(section)
    low, high = UNKNOWN_HEIGHT
    text = (
        f"no height is stated, so gravity is taken as {gravity.value:.4f} m/s² with u = "
        f"{1e3 * gravity.sd:.1f} mm/s², which covers {low:.0f} to {high:.0f} m; if you state "
        f"[bench] height, u is only {1e3 * COMPUTED_GRAVITY_SD:.1f} mm/s²"
    )
    return Finding("note", "height", text)


def sampling_rate(data: DataSection) -> float | None:
    """Return the sampling rate stated in [data], Hz, and check the units of time and temperature.

    Raises
    ------
    InputError
        A unit has the wrong dimension, or the rate is not positive.
    """
    if data.time_unit != "sample":
        si_value(f"1 {data.time_unit}", "s", "[data] time_unit")
    if data.temperature is not None:
        if data.temperature_unit not in COUNTS:
            si_value(f"1 {data.temperature_unit}", "K", "[data] temperature_unit")
        _ = data.thermometer
    if data.rate is None:
        return None
    return positive_value(data.rate, "Hz", "[data] rate")


def require_time_offset(section: MethodSection, chosen: Method[Any, Any], sensor: Sensor) -> None:
    """Raise an error if time_offset is set but the method cannot estimate a gyro delay."""
    has_gyros = bool(sensor.select_axes("w").axes)
    estimates_delay = chosen.unknown_attitudes and not chosen.follows_rest and has_gyros
    if section.time_offset and not estimates_delay:
        raise key_error(
            "[method] time_offset",
            "only method multi_position with gyros can estimate it; remove time_offset",
        )


_KEY, _AGE = "[bench] check_standard", "[bench] check_standard_age"


def stated_check_standard(
    section: BenchSection, job: JobSection | None, folder: Path
) -> tuple[str, tuple[Finding, ...]]:
    """Return the state of the check standard in words, and warnings if the run is doubtful.

    Parameters
    ----------
    section : section of [bench]
    job : JobSection or None
        The job, which contains the date of the run.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        The file was not written by `inercal control`, the age is not positive, or an age is stated
        but no check standard or no date of the run.
    """
    if section.check_standard is None:
        if section.check_standard_age is not None:
            raise key_error(_AGE, "needs check_standard; state the file that inercal control wrote")
        return "", ()
    # Imported here because few run files name a check standard.
    from inercal.calibration.check_standard import CHECK_STANDARD, load_check_standard

    longest = None
    if section.check_standard_age is not None:
        longest = si_value(section.check_standard_age, "s", _AGE)
        if longest < 0:
            raise key_error(_AGE, f"{section.check_standard_age!r} is negative")
    with error_location(_KEY, key=_KEY):
        found = load_check_standard(folder / section.check_standard)
    with error_location(_AGE, key=_AGE):
        state = found.state(None if job is None else job.last_day, longest)
    findings = tuple(Finding("warning", CHECK_STANDARD, one) for one in state.warnings)
    return state.text, findings


_SECTION = "[sensor.magnetometer]"


def require_magnetometer_method(section: SensorSection, chosen: Method[Any, Any]) -> None:
    """Raise an error if a run file states magnetometers that its method cannot use.

    Raises
    ------
    InputError
        The message names the methods that can use them.
    """
    if section.magnetometer is None or "m" in chosen.default_coefficients:
        return
    able = [name for name, each in METHODS.items() if "m" in each.default_coefficients]
    raise key_error(
        _SECTION,
        f"method {chosen.name} cannot calibrate magnetometers, but {', '.join(able)} can; remove "
        "the section, or change [method] name",
        names=(chosen.name,),
    )


def split_magnetometer(sensor: Sensor) -> tuple[Sensor, Sensor | None]:
    """Return the accelerometers and gyros, and the magnetometers; None if there are none.

    Raises
    ------
    InputError
        The magnetometers are not three along independent directions.
    """
    field = sensor.select_axes("m")
    if not field.axes:
        return sensor, None
    if len(field.axes) != len("xyz") or field.rank("m") < len("xyz"):
        raise key_error(
            f"{_SECTION} axis",
            f"{', '.join(field.channels)} do not measure the whole field; name three columns along "
            "independent directions",
            names=field.channels,
        )
    return sensor.select_axes("f", "w"), field


def require_no_field_priors(section: MethodSection, magnetometer: Sensor | None) -> None:
    """Raise an error for a prior for a magnetometer, which no estimator uses.

    Raises
    ------
    InputError
    """
    channels = () if magnetometer is None else magnetometer.channels
    for name in (*section.prior, *(n for one in section.prior_from.values() for n in one)):
        if CoefficientName(name).axis in channels:
            raise key_error(
                f"[method.prior{'_from' * (name not in section.prior)}] {name}",
                "hard and soft iron change with the mounting, so magnetometers are estimated "
                "without priors; remove the key",
                names=(name,),
            )
