"""Builder for the sensor of a run file, in SI units."""

from collections.abc import Callable

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import Measured, parse_quantity, si_factor
from inercal.benches.stated_axes import StatedAxes
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error, non_negative_value, positive_value, si_value
from inercal.physics.sensors import Noise, Readout, Sensor, output_unit
from inercal.recordings.data import DataSection
from inercal.runfile.schema import ReadoutSection, SensorSection

READING_UNITS = {one.sensor: one.unit for one in QUANTITIES.values()}
SCALE_EXAMPLES = {
    "accelerometer": "2048 {}/g",
    "gyro": "16.4 {}/(°/s)",
    "magnetometer": "6.67 {}/µT",
}
Parts = Callable[..., Sensor]


def build_sensor(section: SensorSection, data: DataSection, parts: Parts) -> Sensor:
    """Return the sensor with its readouts and noise, but without coefficients.

    Parameters
    ----------
    section : SensorSection
    data : DataSection
        Section with the columns of the axes.
    parts : callable
        Function that builds the sensor for this kind of bench
        (`inercal.benches.kind_definition.Kind.sensor`).

    Raises
    ------
    InputError
        A unit is unknown, a scale is not possible, or this bench does not support the axes.
    """
    if not section.name.strip():
        raise key_error("[sensor] name", "is empty; give the sensor's name, or remove the key")
    _require_same_axes(section, data)
    stated = [
        StatedAxes(
            kind.symbol,
            getattr(data, kind.sensor),
            one.directions,
            *build_readout(kind.sensor, one),
        )
        for kind in QUANTITIES.values()
        if (one := getattr(section, kind.sensor)) is not None
    ]
    sensor = parts(section.name, *stated)
    form = section.form or sensor.form
    return Sensor(sensor.name, sensor.axes, (), form, frame=section.frame)


def _require_same_axes(section: SensorSection, data: DataSection) -> None:
    """Raise an error if only [sensor] or only [data] states accelerometers or magnetometers."""
    for kind in ("accelerometer", "magnetometer"):
        key, columns, stated = f"[sensor.{kind}]", getattr(data, kind), getattr(section, kind)
        named = columns and (kind == "accelerometer" or kind in data.model_fields_set)
        if named and stated is None:
            advice = f"if the sensor has no {kind}s, state {kind} = [] in [data]"
            raise key_error(key, f"is missing; {advice}")
        if stated is not None and not columns:
            raise InputError(
                f"[data] {kind} names no columns; name those of the {kind}s, or remove {key}",
                key=f"[data] {kind}",
            )


def build_readout(kind: str, section: ReadoutSection) -> tuple[Readout, Noise]:
    """Return the readout and the noise for one kind of axis.

    Parameters
    ----------
    kind : "accelerometer", "gyro" or "magnetometer"
    section : ReadoutSection

    Raises
    ------
    InputError
        A unit is unknown, a scale is not possible, or a noise is negative.
    """
    quantity = READING_UNITS[kind]
    key = f"[sensor.{kind}]"
    output = output_unit(section.unit)
    if output is None:
        try:
            scale = 1.0 / si_factor(section.unit, quantity)
        except InputError as error:
            raise key_error(
                f"{key} unit", f"{error}; 'LSB', 'V', 'A' and 'Hz' are possible too, with a scale"
            ) from None
        if section.scale is not None:
            raise key_error(
                f"{key} scale",
                f"only LSB, V, A and Hz need a scale, not {section.unit}; remove this key",
            )
    elif section.scale is None:
        raise key_error(
            f"{key} scale",
            f"is missing: unit {section.unit} needs the nominal scale factor, such as "
            f'scale = "{SCALE_EXAMPLES[kind].format(section.unit)}"',
        )
    else:
        own = section.scale.partition(" ")[2].partition("/")[0]
        if output_unit(own) not in (None, output):
            text = f"is in {own}, but unit is {section.unit}; state both in the same unit"
            raise key_error(f"{key} scale", f"{section.scale!r} {text}")
        scale = si_value(section.scale, f"{output}/({quantity})", f"{key} scale")
        scale /= si_factor(section.unit, output)
    if scale == 0:
        raise key_error(f"{key} scale", f"{section.scale!r} is zero; give another value")
    full = None
    if section.full_scale is not None:
        full = abs(scale) * positive_value(section.full_scale, quantity, f"{key} full_scale")
    likes = {
        "white": f"({quantity})/√Hz",
        "bias_instability": quantity,
        "random_walk": f"({quantity})/√s",
        "quantisation": quantity,
    }
    noise = {
        name: non_negative_value(text, like, f"{key} {name}")
        for name, like in likes.items()
        if (text := getattr(section, name)) is not None
    }
    return Readout(scale, section.offset, section.unit, full), Noise(**noise)


def coefficient_value(sensor: Sensor, name: str, text: str | float, key: str) -> Measured:
    """Convert a coefficient from text in any suitable unit to SI units.

    Raises
    ------
    InputError
        The coefficient is unknown or its unit is wrong; the message names `key`.
    """
    if name not in sensor.coefficients:
        raise key_error(
            f"{key} {name}",
            "the sensor has no such coefficient; its coefficients are "
            f"{', '.join(sensor.coefficients)}",
            names=(name,),
        )
    unit = sensor.coefficient(name).unit
    with error_location(f"{key} {name}", key=f"{key} {name}"):
        return parse_quantity(text, unit)
