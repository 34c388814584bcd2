"""From the sections of a run file to objects in SI."""

from math import pi

from inercal.benches import Hand
from inercal.earth import normal_gravity
from inercal.errors import InputError
from inercal.runfile.schema import BenchSection, ReadoutSection, SensorSection
from inercal.sensors import Noise, Readout, Sensor, imu, triad
from inercal.units import Measured, factor, parse

_QUANTITY = {"accelerometer": "m/s²", "gyro": "rad/s"}
_EXAMPLE = {"accelerometer": "2048 {}/g", "gyro": "16.4 {}/(°/s)"}
_COUNTS = ("LSB", "V")  # an output that is no acceleration or rate: it needs a scale


def build_sensor(section: SensorSection) -> Sensor:
    """Return the sensor with readouts and noise; without coefficients."""
    accelerometer = _readout("accelerometer", section.accelerometer)
    if section.gyro is None:
        sensor = triad(section.name, "f", "a", *accelerometer)
    else:
        sensor = imu(section.name, accelerometer, _readout("gyro", section.gyro))
    return Sensor(sensor.name, sensor.axes, (), section.form)


def _readout(kind: str, section: ReadoutSection) -> tuple[Readout, Noise]:
    quantity = _QUANTITY[kind]
    key = f"[sensor.{kind}]"
    output = next((u for u in _COUNTS if _is(section.unit, u)), None)
    if output is None:
        try:
            scale = 1.0 / factor(section.unit, quantity)
        except InputError as error:
            raise InputError(f"{key} unit: {error}; or 'LSB' or 'V' with a scale") from None
        if section.scale is not None:
            raise InputError(f"{key} scale: {section.unit} needs none; it is for LSB or V")
    elif section.scale is None:
        raise InputError(
            f"{key}: {section.unit} without a scale: give the nominal one, such as "
            f'scale = "{_EXAMPLE[kind].format(section.unit)}"'
        )
    else:
        scale = si_value(section.scale, f"{output}/({quantity})", f"{key} scale")
    if scale == 0:
        raise InputError(f"{key} scale: must not be zero")
    full = None
    if section.full_scale is not None:
        full = abs(scale) * si_value(section.full_scale, quantity, f"{key} full_scale")
    likes = {
        "white": f"({quantity})/√Hz",
        "bias_instability": quantity,
        "random_walk": f"({quantity})/√s",
        "quantisation": quantity,
    }
    noise = {
        name: si_value(text, like, f"{key} {name}")
        for name, like in likes.items()
        if (text := getattr(section, name)) is not None
    }
    return Readout(scale, section.offset, section.unit, full), Noise(**noise)


def _is(unit: str, like: str) -> bool:
    try:
        factor(unit, like)
    except InputError:
        return False
    return True


def si_value(text: str, like: str, key: str) -> float:
    """Return a quantity given as text, SI; a complaint names `key`."""
    try:
        return parse(text, like).value
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def build_bench(section: BenchSection) -> Hand:
    """Return the bench."""

    def value(name: str, like: str, lowest: float = 0.0) -> float:
        number = si_value(getattr(section, name), like, f"[bench] {name}")
        if number < lowest:
            raise InputError(f"[bench] {name}: {getattr(section, name)!r} must not be negative")
        return number

    latitude = None
    if section.latitude is not None:
        latitude = value("latitude", "°", -pi)
    if section.gravity is not None:
        try:
            gravity = parse(section.gravity, "m/s²")
        except InputError as error:
            raise InputError(f"[bench] gravity: {error}") from None
        if not 9.5 < gravity.value < 10.0:
            raise InputError(
                f"[bench] gravity: {section.gravity!r} is not gravity on earth, 9.76 to 9.84 m/s²"
            )
    else:
        assert latitude is not None  # the schema requires one of the two
        gravity = normal_gravity(latitude, value("height", "m", -1e4))
    return Hand(
        gravity=gravity,
        latitude=latitude,
        tilt=value("tilt", "°"),
        turn_angle=value("turn_angle", "°"),
        turn_tilt=value("turn_tilt", "°"),
        timebase=value("timebase", "1"),
    )


def coefficient_value(sensor: Sensor, name: str, text: str | float, key: str) -> Measured:
    """Return a coefficient given as text in any unit of its dimension, SI.

    Raises
    ------
    InputError
        An unknown coefficient or a wrong unit; the message names `key`.
    """
    if name not in sensor.coefficients:
        raise InputError(f"{key} {name}: no such coefficient; {', '.join(sensor.coefficients)}")
    unit = sensor.coefficient(name).unit
    try:
        return parse(text, unit)
    except InputError as error:
        raise InputError(f"{key} {name}: {error}") from None
