"""Recognise the columns of a recording by the names that common loggers use.

The names are those of Arduino sketches for the MPU-6050 ("AcX", "GyX", "Tmp", "millis"), phyphox
("Acceleration x (m/s^2)"), Sensor Logger and SensorLog ("seconds_elapsed",
"accelerometerAccelerationX(G)"), Android ("accelerometer_x", "GYROSCOPE X (rad/s)"), Xsens
("Acc_X", "Gyr_X", "PacketCounter"), LSM and ICM examples ("XL_X", "Accel_X_mg") and exports of
ROS ("field.angular_velocity.x"), EuRoC ("w_RS_S_x [rad s^-1]"), Physics Toolbox ("gFx") and NovAtel
("-(Y Accel)", which is reversed). Upper and lower case are not distinguished.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from math import isclose

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor

_AXES = ("x", "y", "z")
_AXIS_ENDS = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}
_STEMS = {
    "accelerometer": re.compile(
        r"(n?a|f|ac|acc|accl?|accel\w*|accelerometer\w*|xl|linear_?accel\w*|specific_?force"
        r"|g_?f(orce)?|a_rs_s)"
    ),
    "gyro": re.compile(
        r"(g|gy|w|om|omega|gyr|gyro\w*|ang\w*_?(velocity|vel|rate)|angular|((rotation|turn)_?)?rate(_?of_?turn)?"
        r"|w_rs_s)"
    ),
}
_BARE = ("", "axis", "value", "data")  # stems that name no sensor: "X (g)", "x-axis (g)"
_WITHOUT_GRAVITY = re.compile(r"(\w*_)?(linear|lin|user|free)_?acc\w*")
_NO_SENSOR = re.compile(  # names of triads that are neither accelerometers nor gyros
    r"(\w*_)?(mag\w*|[mhb]_?[xyz]|roll|pitch|yaw|azimuth|heading|euler\w*|quat\w*|q[0-3wxyz]|gravity\w*"
    r"|(linear|user|free)_?acc\w*|orientation\w*|lat\w*|lon\w*|alt\w*|press\w*|hum\w*|gps\w*)"
)
_OTHER_FIELDS = re.compile(
    r"orientation|quat(ernion)?|euler|magnetic_field"
)  # "/accel.orientation"
NAMES = {
    "time": re.compile(
        r"t(_?(s|ms|us|ns))?|(?!sample_?time_?fine)(\w*_)?time\w*|\w*timestamp\w*|stamp|date\w*|secs?|seconds?\w*"
        r"|sample(?!_?time_?fine)\w*|n_samples|\w*counter|ms|msecs?|millis\w*|us|usecs?"
        r"|hours?|micros\w*|nanos\w*|elapsed\w*|epoch\w*|uptime\w*"
    ),
    "temperature": re.compile(
        r"((imu|chip|sensor|die|mpu|gyro?|acc\w*)_?)?(temp|tmp)\w*|t_?c(elsius)?"
    ),
    "arm_rate": re.compile(
        r"rpm|arm_?rate(_?(rpm|rad_?s|deg_?s|dps))?|rate|speed_?rpm|omega_over_pi|table_?rate"
    ),
    "axis": re.compile(r"axis|up"),
    "angle": re.compile(r"(?!roll|pitch|yaw|euler|[xyz]_)(\w+_)?angle(_?deg)?|head"),
    "autocollimator": re.compile(r"autocollimator|collimator"),
    "level": re.compile(r"level"),
    "mounting": re.compile(r"mounting|fixture"),
    "hold": re.compile(r"hold"),
    "label": re.compile(r"label|part|section|position|pos|pose|step|face|phase"),
}
"""Names of single columns by role."""

_UNITS = (  # units in a column's name, as text or in brackets, with their kind
    (re.compile(r"cm/s(\^?2|²)"), "Gal"),
    (re.compile(r"m_?/?s_?(\^?2|²|2)\b|m_s2|mps2|m\W?s(\^?-2|⁻²)"), "m/s²"),
    (re.compile(r"\[(mg)\]|\(mg\)|_mg\b"), "mg"),
    (re.compile(r"\[g\]|\(g\)|_g\b"), "g"),
    (re.compile(r"\bmrad/s\b"), "mrad/s"),
    (re.compile(r"rad_?/?s\b|_rad\b|rads\b|rad\W?s(\^?-1|⁻¹)"), "rad/s"),
    (re.compile(r"angular_velocity[./][xyz]$"), "rad/s"),  # of ROS
    (re.compile(r"\bm(dps|(deg|°)/?s)\b|_mdps\b"), "m°/s"),
    (re.compile(r"(deg|°)_?/?s\b|dps\b|_deg\b|(deg|°)\W?s(\^?-1|⁻¹)"), "°/s"),
    (re.compile(r"lsb|counts?|raw"), "LSB"),
    (re.compile(r"_volts?\b"), "V"),
)
_KINDS = {
    **dict.fromkeys(("m/s²", "Gal", "mg", "g"), "accelerometer"),
    **dict.fromkeys(("rad/s", "°/s", "m°/s", "mrad/s"), "gyro"),
}
_BRACKETS = re.compile(r"[\[(](.+?)[\])](?![\])])")
_READING_UNITS = ("m/s²", "rad/s", "V", "A", "LSB")
_UNIT_WORDS = r"m_?s_?2|mps_?2|[mu]?g|m?rad(_?s)?|m?deg(_?s)?|m?dps|raw|lsb|counts?|volts?"
_UNIT_END = re.compile(rf"_({_UNIT_WORDS})$")
_STATE = re.compile(r"_(cal|calibrated|corrected|filt|filtered)$")  # how readings were processed
_TIME_UNITS = (
    (re.compile(r"\[?\bns\b|_ns\b|nanos"), "ns"),
    (re.compile(r"\bus\b|_us\b|µs|micros|usec"), "µs"),
    (re.compile(r"\bms\b|_ms\b|millis|msec"), "ms"),
    (re.compile(r"\[s\]|\(s\)|_s\b|\bsec"), "s"),
)


def column_unit(name: str) -> str | None:
    """Return the unit that a column's name states, if any.

    >>> column_unit("a [mV]"), column_unit("Gyr_X (deg/s)"), column_unit("a_x_raw")
    ('mV', '°/s', 'LSB')
    >>> column_unit("field.angular_velocity.x")
    'rad/s'
    """
    if (stated := bracketed_unit(name, *_READING_UNITS)) is not None:
        same = (unit for unit in (*_KINDS, "LSB") if _same_size(unit, stated))
        return next(same, stated)
    return next((unit for pattern, unit in _UNITS if pattern.search(name.lower())), None)


def _same_size(unit: str, stated: str) -> bool:
    with suppress(InputError):
        return isclose(si_factor(unit), si_factor(stated, unit))
    return False


def bracketed_unit(name: str, *likes: str) -> str | None:
    """Return the unit in brackets in a column's name that has the dimension of one of `likes`."""
    for text in _BRACKETS.findall(name):
        for like in likes:
            with suppress(InputError):
                si_factor(text, like)
                return text
    return None


def time_unit(name: str) -> str | None:
    """Return the unit of time that a column's name states, if any."""
    return next((unit for pattern, unit in _TIME_UNITS if pattern.search(name.lower())), None)


def role_of_name(name: str) -> str | None:
    """Return the role of a single column, judged by its name.

    >>> role_of_name("millis"), role_of_name("Tmp"), role_of_name("volume")
    ('time', 'temperature', None)
    """
    words = plain_name(name.rpartition(".")[2])  # a log's columns are "topic.field"
    return next((role for role, pattern in NAMES.items() if pattern.fullmatch(words)), None)


def is_reversed(name: str) -> bool:
    """Return whether a name states that the column has the opposite sign: "-(Y Accel)"."""
    return name.startswith("-(") and name.endswith(")")


def is_other_quantity(name: str) -> bool:
    """Return whether a name states a quantity that neither accelerometers nor gyros measure."""
    return _NO_SENSOR.fullmatch(plain_name(name)) is not None


def has_axes(names: Sequence[str]) -> bool:
    """Return whether three names are those of the axes x, y and z, in any order."""
    return sorted(plain_name(name)[-1:] for name in names) == list(_AXES)


def in_axis_order(names: Sequence[str]) -> tuple[str, ...]:
    """Sort three columns by the axes at the end of their names, if the names have axes.

    >>> in_axis_order(("z", "y", "x"))
    ('x', 'y', 'z')
    """
    axes = [_AXIS_ENDS.get(plain_name(name)[-1:]) for name in names]
    if sorted(axis for axis in axes if axis is not None) != [0, 1, 2]:
        return tuple(names)
    return tuple(names[axes.index(k)] for k in range(len(_AXES)))


def axes_of_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the axes that the names of different axes state; empty if they state none.

    >>> axes_of_names(["ay_mg", "ax_mg", "az_mg"]), axes_of_names(["imu.x.run7", "imu.z.run7"])
    (('y', 'x', 'z'), ('x', 'z'))
    """
    found = [_stem_and_axis(plain_name(name))[1] for name in names]
    if None not in found and len(set(found)) == len(found):
        return tuple(_AXES[k] for k in found if k is not None)
    differ = [one for one in zip(*names, strict=False) if len(set(one)) > 1]
    letters = tuple("".join(differ[0]).lower()) if len(differ) == 1 else ()
    return letters if set(letters) <= {*_AXES} and len(set(letters)) == len(letters) else ()


def named_triads(
    names: Sequence[str], reasons: dict[str, str], units: dict[str, str], incomplete: bool = False
) -> dict[str, tuple[str, ...]]:
    """Find the accelerometers and gyros by names that differ only in their axis.

    With `incomplete`, axes of a kind may be missing if no triad of this kind is complete.
    """
    groups: dict[str, dict[int, str]] = {}
    for name in names:
        stem, axis = _stem_and_axis(plain_name(name))
        if axis is not None:
            groups.setdefault(stem, {}).setdefault(axis, name)
    triads: dict[str, tuple[str, ...]] = {}
    for kind, pattern in _STEMS.items():
        whole = _groups_of_kind(groups, pattern, len(_AXES))
        for found in whole or (_groups_of_kind(groups, pattern, 1) if incomplete else ()):
            if kind in triads:
                reasons[kind] += f"; {', '.join(found.values())} are not used"
                continue
            triads[kind] = tuple(found[k] for k in sorted(found))
            reasons[kind] = "by their names"
            if unit := column_unit(triads[kind][0]):
                units[kind] = unit
    for bare in (groups[stem] for stem in _BARE if len(groups.get(stem, ())) == len(_AXES)):
        unit = column_unit(bare[0]) or ""
        if (kind := _KINDS.get(unit)) is not None and kind not in triads:
            triads[kind] = tuple(bare[k] for k in range(len(_AXES)))
            reasons[kind], units[kind] = "by their unit", unit
    return triads


def _groups_of_kind(
    groups: Mapping[str, Mapping[int, str]], pattern: re.Pattern[str], fewest: int
) -> list[Mapping[int, str]]:
    """Return the groups with enough axes of a kind; those with gravity removed come last."""
    complete = [
        (stem, found)
        for stem, found in groups.items()
        if len(found) >= fewest
        and _ends_with(_UNIT_END.sub("", stem), pattern)
        # A topic "/accel" also contains an orientation.
        and (_WITHOUT_GRAVITY.fullmatch(stem) or not _ends_with(stem, _OTHER_FIELDS))
    ]
    complete.sort(key=lambda one: _WITHOUT_GRAVITY.fullmatch(one[0]) is not None)
    return [found for _, found in complete]


def _ends_with(stem: str, pattern: re.Pattern[str]) -> bool:
    """Return whether a name, or its last words, matches a pattern."""
    words = stem.split("_")
    return any(pattern.fullmatch("_".join(words[k:])) for k in range(len(words)))


@lru_cache  # because the sensors of a line have the same columns
def plain_name(name: str) -> str:
    """Return a name in lower case, with words joined by "_" and without units in brackets."""
    if is_reversed(name):
        name = name[2:-1]
    name = re.sub(r"\(.*?\)|\[[^\]]*[^\d\]][^\]]*\]", "", name)  # "[0]" stays
    name = re.sub(r"[ωΩ]", "w", name)
    name = re.sub(r"([a-z])([A-Z])|([A-Z])(?=[A-Z][a-z])", r"\1\3_\2", name)
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return _STATE.sub("", words)


def _stem_and_axis(words: str) -> tuple[str, int | None]:
    """Split a name into its stem and axis: ("acc", 0) for "acc_x", "accx" and "ax"."""
    if words in _AXES:
        return "", _AXIS_ENDS[words]
    head, _, last = words.rpartition("_")
    if head and last in _AXIS_ENDS:
        return head, _AXIS_ENDS[last]
    if (bare := _UNIT_END.sub("", words)) != words:
        inner, _, axis = bare.rpartition("_")
        if axis in _AXIS_ENDS:
            return inner, _AXIS_ENDS[axis]
        if len(bare) > 1 and bare[-1] in _AXES:
            return bare[:-1], _AXIS_ENDS[bare[-1]]
    if len(words) > 1 and words[-1] in _AXES:
        return words[:-1], _AXIS_ENDS[words[-1]]
    if len(words) > 1 and words[0] in _AXES and "_" in words:
        return words[2:], _AXIS_ENDS[words[0]]
    return words, None


def run_file_column(name: str) -> str | int:
    """Return a column as it is named in a run file: by its number if it has no name.

    A name that states the opposite sign, "-(Y Accel)", gets the sign that reverses it.
    """
    if is_reversed(name):
        return f"-{name}"
    return int(name) if name.isdecimal() else name
