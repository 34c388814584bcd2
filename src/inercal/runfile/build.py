"""From the sections of a run file to objects in SI."""

from pathlib import Path

import numpy as np

from inercal.benches import Bench, Centrifuge, DividingHead, Hand, RateTable, Turntable
from inercal.benches.dividing_head.bench import mounted
from inercal.benches.turntable.moves import Limits
from inercal.earth import earth_rate_up_north, normal_gravity
from inercal.errors import InputError
from inercal.io.read import read_table
from inercal.runfile.schema import (
    BenchSection,
    CentrifugeSection,
    DividingHeadSection,
    RateTableSection,
    ReadoutSection,
    SensorSection,
    TurntableSection,
)
from inercal.sensors import Noise, Readout, Sensor, imu, triad
from inercal.units import Measured, factor, parse

_QUANTITY = {"accelerometer": "m/s²", "gyro": "rad/s"}
_EXAMPLE = {"accelerometer": "2048 {}/g", "gyro": "16.4 {}/(°/s)"}
_LARGEST_TILT = 0.0175  # rad
_WIDEST_AZIMUTH = 0.0873  # rad
_LONGEST_LEVER = 1.0  # m
_LARGEST_DRIFT = 0.1  # m/s²
_FEWEST_FACES = 3  # of a polygon
_COUNTS = ("LSB", "V")  # an output that is no acceleration or rate: it needs a scale


def build_sensor(section: SensorSection, axes: int | None = None) -> Sensor:
    """Return the sensor with readouts and noise; without coefficients.

    Parameters
    ----------
    section : SensorSection
    axes : int, optional
        Accelerometers on a dividing head, one or two.

    Raises
    ------
    InputError
        A unit or a scale that is none, or gyros on a dividing head.
    """
    accelerometer = _readout("accelerometer", section.accelerometer)
    form = section.form or "reference"
    if axes is not None:
        if section.gyro is not None:
            raise InputError("[sensor.gyro]: a dividing head stands still; leave it out")
        sensor = mounted(section.name, "ab"[:axes], *accelerometer)
        form = section.form or sensor.form
    elif section.gyro is None:
        sensor = triad(section.name, "f", "a", *accelerometer)
    else:
        sensor = imu(section.name, accelerometer, _readout("gyro", section.gyro))
    return Sensor(sensor.name, sensor.axes, (), form, frame=section.frame)


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
        reach = si_value(section.full_scale, quantity, f"{key} full_scale")
        if reach <= 0:
            raise InputError(f"{key} full_scale: {section.full_scale!r} must be positive")
        full = abs(scale) * reach
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
    for name, value in noise.items():
        if value < 0:
            raise InputError(f"{key} {name}: {getattr(section, name)!r} must not be negative")
    return Readout(scale, section.offset, section.unit, full), Noise(**noise)


def _is(unit: str, like: str) -> bool:
    try:
        factor(unit, like)
    except InputError:
        return False
    return True


def si_value(text: str, like: str, key: str) -> float:
    """Return a quantity given as text, SI; a complaint names `key`.

    Raises
    ------
    InputError
        What `parse` refuses, or an uncertainty, which would count for nothing.
    """
    try:
        found = parse(text, like)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None
    if found.sd:
        raise InputError(f"{key}: {text!r}: no uncertainty of it enters the result; leave ± out")
    return found.value


def measured(text: str, like: str, key: str, *, last_digit: bool = True) -> Measured:
    """Return a measured constant given as text, SI; a complaint names `key`.

    Without "±" it has the uncertainty of its last digit, if `last_digit`.
    """
    try:
        return parse(text, like, last_digit=last_digit)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def build_bench(section: BenchSection, folder: Path) -> Bench | Turntable:
    """Return the bench; files that it names lie in `folder`."""
    if isinstance(section, CentrifugeSection):
        return _centrifuge(section)
    if isinstance(section, DividingHeadSection):
        return _dividing_head(section, folder)
    if isinstance(section, RateTableSection):
        return _rate_table(section)
    if isinstance(section, TurntableSection):
        return _turntable(section)
    place = None
    if section.latitude is not None:
        place = measured(section.latitude, "°", "[bench] latitude")
    return Hand(
        gravity=_gravity(section),
        latitude=place,
        tilt=_deviation(section, "tilt", "°"),
        turn_angle=_deviation(section, "turn_angle", "°"),
        turn_tilt=_deviation(section, "turn_tilt", "°"),
        timebase=_deviation(section, "timebase", "1"),
    )


def _rate_table(section: RateTableSection) -> RateTable:
    radius = measured(section.radius, "m", "[bench] radius")
    if radius.value <= 0:
        raise InputError(f"[bench] radius: {section.radius!r} must be positive")
    return RateTable(
        gravity=_gravity(section),
        radius=radius,
        seat=_deviation(section, "seat", "m"),
        pose=_deviation(section, "pose", "°"),
        rate=_deviation(section, "rate_error", "1"),
        speed=_deviation(section, "speed", "1"),
        lean=_small(section, "lean"),
    )


def _turntable(section: TurntableSection) -> Turntable:
    if section.latitude is None:
        raise InputError("[bench] latitude is missing: gyros on a turntable feel the earth's rate")
    x, y, z = (measured(arm, "m", "[bench] lever", last_digit=False) for arm in section.lever)
    if not all(abs(arm.value) + 2 * arm.sd <= _LONGEST_LEVER for arm in (x, y, z)):
        raise InputError(
            f"[bench] lever: {', '.join(section.lever)}: an IMU on a table is no more than 1 m "
            "from where the axes cross"
        )
    azimuth = measured(section.azimuth, "°", "[bench] azimuth")
    if azimuth.sd > _WIDEST_AZIMUTH:
        raise InputError(
            f"[bench] azimuth: {section.azimuth!r}: its deviation is more than 5°, beyond which "
            "what it does is not linear; state it nearer"
        )
    key = "[bench] harmonics"
    harmonics = tuple(si_value(text, "°", key) for text in section.harmonics)
    if not all(0 <= sd <= _LARGEST_TILT for sd in harmonics):
        raise InputError(f"{key}: {', '.join(section.harmonics)}: give each from 0 to 1°")
    return Turntable(
        gravity=_gravity(section),
        latitude=si_value(section.latitude, "°", "[bench] latitude"),
        azimuth=azimuth,
        axes=section.axes,
        lean=_small(section, "lean"),
        square=_small(section, "square"),
        harmonics=harmonics,
        white=_small(section, "noise"),
        latency=measured(section.latency, "s", "[bench] latency"),
        clock=_deviation(section, "clock", "1"),
        lever=(x, y, z),
        limits=_limits(section),
    )


def _limits(section: TurntableSection) -> tuple[Limits, ...]:
    """Return the limits of all axes alike, or of each where one key has several."""
    likes = {"rate": "°/s", "acceleration": "°/s²", "jerk": "°/s³"}
    stated: dict[str, tuple[str, ...]] = {name: getattr(section, name) for name in likes}
    axes = max(map(len, stated.values()))
    each: dict[str, list[float | None]] = {}
    for name, texts in stated.items():
        values = [si_value(text, likes[name], f"[bench] {name}") for text in texts]
        if not values and name == "jerk":
            each[name] = [None] * axes
        elif len(values) in (1, axes):
            each[name] = [*values] * (axes // len(values))
        else:
            raise InputError(f"[bench] {name}: {len(values)} limits; give one for all axes or each")
    made: list[Limits] = []
    for rate, acceleration, jerk in zip(*each.values(), strict=True):
        assert rate is not None  # only a jerk may be without limit
        assert acceleration is not None
        made.append(Limits(rate, acceleration, jerk))
    return tuple(made)


def _dividing_head(section: DividingHeadSection, folder: Path) -> DividingHead:
    key = "[bench] harmonics"
    harmonics = tuple(si_value(text, "°", key) for text in section.harmonics)
    if not all(0 <= sd <= _LARGEST_TILT for sd in harmonics):
        raise InputError(f"{key}: {', '.join(section.harmonics)}: give each from 0 to 1°")
    drift = _deviation(section, "drift", "m/s²")
    if drift > _LARGEST_DRIFT:
        raise InputError(f"[bench] drift: {section.drift!r} is more than a bias can drift, 10 mg")
    polygon: tuple[float, ...] = ()
    if section.polygon is not None:
        if section.autocollimation == "none":
            raise InputError(
                '[bench] polygon: autocollimation is "none", which reads no face; state "pairs" '
                'or "every"'
            )
        polygon = _polygon(folder / section.polygon, section.polygon_unit)
    return DividingHead(
        gravity=_gravity(section),
        harmonics=harmonics,
        collimated=section.autocollimation,
        polygon=polygon,
        certificate=_small(section, "certificate"),
        division=_small(section, "division"),
        autocollimator=_small(section, "autocollimator"),
        base=_small(section, "base"),
        pier=_small(section, "pier"),
        creep=_small(section, "creep"),
        lean=_small(section, "lean"),
        drift=drift,
    )


def _polygon(path: Path, unit: str) -> tuple[float, ...]:
    """Return the certified deviation of each face, rad.

    Raises
    ------
    InputError
        A table without columns `face` and `deviation`, or whose faces are not 1 to n in order.
    """
    try:
        table = read_table(path)
    except InputError as error:
        raise InputError(f"[bench] polygon: {error}") from None
    for name in ("face", "deviation"):
        if name not in table.columns:
            raise InputError(
                f"[bench] polygon: {path.name} has no column {name!r}, but "
                f"{', '.join(table.columns)}; it takes face and deviation"
            )
    face, deviation = table.numbers("face"), table.numbers("deviation")
    bad = np.flatnonzero((face != np.arange(1, len(face) + 1)) | ~np.isfinite(deviation))
    if bad.size or len(face) < _FEWEST_FACES:
        where = f"line {table.first_line + bad[0]}" if bad.size else f"{len(face)} faces"
        raise InputError(
            f"[bench] polygon: {path.name}, {where}: give each face of the polygon one line, 1, 2, "
            "3, … in the order in which they are read, with its deviation"
        )
    size = si_value(f"1 {unit}", "°", "[bench] polygon_unit")
    return tuple((size * deviation).tolist())


def _centrifuge(section: CentrifugeSection) -> Centrifuge:
    radius = measured(section.radius, "m", "[bench] radius")
    if radius.value <= 0:
        raise InputError(f"[bench] radius: {section.radius!r} must be positive")
    latitude = None
    if section.latitude is not None:
        latitude = measured(section.latitude, "°", "[bench] latitude")
        earth_rate_up_north(latitude.value)  # refuses what is no latitude
    return Centrifuge(
        gravity=_gravity(section),
        radius=radius,
        latitude=latitude,
        stretch=measured(section.stretch, "1/(m/s²)", "[bench] stretch"),
        rate=_deviation(section, "rate_error", "1"),
        tilt=_small(section, "tilt"),
        lean=_small(section, "lean"),
        dwell_rate=_deviation(section, "dwell_rate", "1"),
        dwell_tilt=_small(section, "dwell_tilt"),
        platform=section.platform,
        mounting=_deviation(section, "mounting", "°"),
        indexing=None if section.indexing is None else _deviation(section, "indexing", "°"),
        sense=1 if section.sense == "counter-clockwise" else -1,
    )


def _deviation(section: BenchSection, name: str, like: str) -> float:
    """Return a standard deviation that the section states."""
    text = getattr(section, name)
    value = si_value(text, like, f"[bench] {name}")
    if value < 0:
        raise InputError(f"[bench] {name}: {text!r} must not be negative")
    return value


def _small(section: BenchSection, name: str) -> float:
    """Return a deviation that must be a small angle: tilts act to first order of their square."""
    value = _deviation(section, name, "°")
    if value > _LARGEST_TILT:
        raise InputError(
            f"[bench] {name}: {getattr(section, name)!r} is more than a bench can lean, 1°"
        )
    return value


def _gravity(section: BenchSection) -> Measured:
    """Return gravity as given, or computed from latitude and height."""
    if section.gravity is None:
        assert section.latitude is not None  # the schema requires one of the two
        latitude = measured(section.latitude, "°", "[bench] latitude")
        return normal_gravity(
            latitude.value, si_value(section.height or "0 m", "m", "[bench] height")
        )
    gravity = measured(section.gravity, "m/s²", "[bench] gravity")
    if not 9.5 < gravity.value < 10.0:
        raise InputError(
            f"[bench] gravity: {section.gravity!r} is not gravity on earth, 9.76 to 9.84 m/s²"
        )
    return gravity


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
