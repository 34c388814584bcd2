"""Converts TOML descriptions of packets to a `PacketLayout`, with one-line error messages."""

import math
import re
from collections.abc import Callable, Mapping
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar, cast

from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import parse_toml, read_small_file
from inercal.basics.units import parse_quantity, si_factor
from inercal.host.packets.layout import PacketLayout, Scale
from inercal.host.packets.packet_format import AXES, BinaryFrame, TextLine, read_frame, read_line
from inercal.recordings.io.column_table import shorten

_PRESETS = files("inercal.host.packets") / "presets"
PRESETS = tuple(
    sorted(p.name.removesuffix(".toml") for p in _PRESETS.iterdir() if p.name.endswith(".toml"))
)

_SECTIONS = ("accelerometer", "gyro", "temperature", "time", "counter", "status")
# Keys of each section. If the packets do not contain a channel, its section may be omitted.
KEYS: Mapping[str, Mapping[str, type]] = {
    "": {
        **dict.fromkeys(("about", "byte_order", "rate", "line"), str),
        "frame": list,
        **dict.fromkeys(_SECTIONS, dict),
    },
    "frame": {"packet": str, "length": int},
    "accelerometer": {"scale": str, "full_scale": str, "invalid": list},
    "gyro": {"scale": str, "full_scale": str, "invalid": list},
    "temperature": {"scale": str, "zero": str, "invalid": list},
    "time": {"scale": str, "wraps": str},
    "counter": {"step": int, "wraps": int},
    "status": {"mask": int, "good": int},
}
_TYPE_NAMES = {str: "text", int: "a whole number", list: "a list", dict: "a section"}
# Units of the scale and of the increments of each channel, and an example.
_CHANNEL_UNITS = {
    "accelerometer": ("m/s²", "m/s", "1 µg"),
    "gyro": ("rad/s", "rad", "16/32768 °/s"),
    "temperature": ("K", None, "0.01 °C"),
    "time": ("s", None, "100 µs"),
}
_EXACT = 2**53  # the largest count that a float represents exactly
_MASKED = 2**63 - 1  # usable bits of a status, which is a signed 64-bit integer
T = TypeVar("T")
_SCALE = re.compile(r"([-+0-9.eE^/ ]+?) +(\S.*)")
_TERM = re.compile(r"[+-]?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?|2\^-?[0-9]{1,2}")


def read_layout(source: str | Path) -> PacketLayout:
    """Return the layout in a TOML file, or the preset with a given name.

    Parameters
    ----------
    source : str or path
        Path of a file, or the name of one of `PRESETS`.

    Raises
    ------
    InputError
        The description is invalid. The one-line message states the file, the key and the remedy.
    """
    if isinstance(source, str) and source in PRESETS:
        return parse_layout((_PRESETS / f"{source}.toml").read_text(encoding="utf-8"), source)
    path = Path(source)
    try:
        raw = read_small_file(path, "description of packets")
    except InputError as error:
        raise InputError(f"{error}; presets are {', '.join(PRESETS)}", file=path) from None
    return parse_layout(raw, path.name)


def parse_layout(text: str | bytes, name: str) -> PacketLayout:
    """Return the layout in a TOML text.

    Parameters
    ----------
    text : str or bytes
    name : str
        Name of the file; messages begin with this name.

    Raises
    ------
    InputError
        See `read_layout`.
    """
    with error_location(name, file=name):
        return _build_layout(parse_toml(text, "description of packets"), name)


def _build_layout(content: dict[str, Any], name: str) -> PacketLayout:
    _check_keys(content, "")
    for section, value in content.items():
        for part in value if section == "frame" else [value]:
            if isinstance(part, dict) or section == "frame":
                _check_keys(part, section)
    frames = _frames(content)
    roles = {field.role for field in frames[0].fields}
    rate: float | None = None
    if "rate" in content:
        rate = _with_key("rate", lambda: parse_quantity(content["rate"], "Hz").value)
        if rate <= 0:
            text = f": {content['rate']!r} is not possible; give a rate above 0"
            raise _refusal("rate", text)
    carried = {
        "accelerometer": roles & set(AXES[:3]),
        "gyro": roles & set(AXES[3:]),
        "temperature": {f.role for frame in frames for f in frame.fields} & {"temperature"},
        "time": roles & {"time"},
    }
    if not carried["accelerometer"] | carried["gyro"]:
        raise InputError(f"the packet contains no reading; name one or more of {', '.join(AXES)}")
    scales = {
        section: _scale(section, content.get(section), rate) if wanted else Scale()
        for section, wanted in carried.items()
    }
    step = float(_whole_number(content, "counter", "step", 1, 1, _EXACT))
    if "counter" not in roles:
        step = 1 / (rate * scales["time"].size) if rate and "time" in roles else 0.0
    mask = _whole_number(content, "status", "mask", 0, 0, _MASKED)
    good = _whole_number(content, "status", "good", 0, 0, _MASKED)
    if good & ~mask:
        text = f": {good:#x} has bits that mask, {mask:#x}, leaves out; add them to mask"
        raise _refusal("[status] good", text)
    return PacketLayout(
        name=name.removesuffix(".toml"),
        description=content.get("about", ""),
        frames=frames,
        rate_hz=rate,
        step=step,
        wraps=_wrap_values(content, frames[0], scales["time"]),
        status_good=(mask, good),
        **scales,
    )


def _check_keys(part: Any, section: str) -> None:
    """Raise an error for an unknown key or a value of the wrong type."""
    where, keys = f"[{section}] " if section else "", KEYS[section]
    if not isinstance(part, dict):
        raise InputError(
            f"[[{section}]] has an entry that is not a section; give sections with the keys "
            f"{', '.join(keys)}",
            key=section,
        )
    for key, value in cast(dict[str, Any], part).items():
        if key not in keys:
            raise InputError(
                f"unknown key {where}{key}; possible here: {', '.join(keys)}", key=f"{where}{key}"
            )
        wanted = keys[key]
        if not isinstance(value, wanted) or isinstance(value, bool):
            text = f": {shorten(repr(value))} is not {_TYPE_NAMES[wanted]}"
            raise _refusal(f"{where}{key}", text)


def _refusal(key: str, text: str, *names: str) -> InputError:
    """Return the error about a key, which stands before the text."""
    return InputError(f"{key}{text}", key=key, names=names)


def _with_key(key: str, made: Callable[[], T]) -> T:
    """Call a function, and add the key to any error."""
    with error_location(key, key=key):
        return made()


def _frames(content: dict[str, Any]) -> tuple[BinaryFrame, ...] | tuple[TextLine]:
    if ("line" in content) == ("frame" in content):
        raise InputError(
            'the packet format is missing or ambiguous; give either line = "…" for text, or '
            "[[frame]] for binary packets"
        )
    if "line" in content:
        return (_with_key("line", lambda: read_line(content["line"])),)
    order = content.get("byte_order")
    if order not in (None, "big", "little"):
        raise _refusal("byte_order", f': {order!r} is unknown; state "big" or "little"')
    frames = tuple(_frame(section, order) for section in content["frame"])
    if not frames:
        raise InputError("[[frame]] is missing; add one section for each kind of packet")
    if any(not _distinguishable(*pair) for pair in combinations(frames, 2)):
        raise _refusal(
            "[frame] packet",
            ": no fixed byte distinguishes two of the packets; add a different fixed byte to each",
        )
    for frame in frames[1:]:
        differ = {f[:3] for f in frame.fields} ^ {f[:3] for f in frames[0].fields}
        roles = {role for role, _, _ in differ} - {"temperature", "status"}
        if roles:
            text = "differ between two packets; only temperature and status may differ"
            names = sorted(roles)
            raise _refusal("[frame] packet", f": {', '.join(names)} {text}", *names)
    return frames


def _frame(section: dict[str, Any], order: str | None) -> BinaryFrame:
    for key in ("packet", "length"):
        if key not in section:
            raise _refusal(f"[frame] {key}", " is missing; add it to each [[frame]]")
    frame = _with_key("[frame] packet", lambda: read_frame(section["packet"], order))
    if frame.length != section["length"]:
        raise InputError(
            f"[frame] packet has {frame.length} bytes, but length is {section['length']}; correct "
            "one of the two",
            key="[frame] length",
        )
    return frame


def _distinguishable(one: BinaryFrame, other: BinaryFrame) -> bool:
    """Return whether two packets differ in a fixed byte and can therefore be distinguished."""
    fixed = dict(other.constants)
    return any(fixed.get(offset, value) != value for offset, value in one.constants)


def _scale(section: str, given: dict[str, Any] | None, rate: float | None) -> Scale:
    """Return the scale of a channel, which defines what its values mean."""
    like, increment, example = _CHANNEL_UNITS[section]
    key = f"[{section}] scale"
    if given is None or "scale" not in given:
        raise _refusal(key, f' is missing; add one such as "{example}"')
    number, unit = _with_key(key, lambda: _parse_scale(given["scale"], example))
    zero = 0.0
    if section == "temperature":
        stated = given.get("zero", f"0 {unit}")
        zero = _with_key("[temperature] zero", lambda: parse_quantity(stated, "°C").value)
        number *= _with_key(key, lambda: parse_quantity(f"1 {unit}", "K", difference=True).value)
        unit = "K"
    size = _with_key(key, lambda: number * _unit_size(unit, like, increment, rate))
    if not (math.isfinite(size) and size):
        text = f": {given['scale']!r} is not possible; give a finite number other than 0"
        raise _refusal(key, text)
    full = given.get("full_scale")
    return Scale(
        size,
        zero,
        math.inf
        if full is None
        else _with_key(f"[{section}] full_scale", lambda: parse_quantity(full, like).value),
        _invalid_codes(section, given.get("invalid", [])),
    )


def _parse_scale(text: str, example: str) -> tuple[float, str]:
    """Return the number and the unit in a text such as "16/32768 g" or "2^-33 rad"."""
    found = _SCALE.fullmatch(text.strip())
    terms = [term.strip() for term in found[1].split("/")] if found else []
    if found is None or not all(_TERM.fullmatch(term) for term in terms):
        raise InputError(
            f'{text!r} is not a number with a unit, such as "{example}" or "2^-33 rad"'
        )
    powers = [2.0 ** int(t[2:]) if t.startswith("2^") else float(t) for t in terms]
    first, *others = powers
    if not all(others):
        raise InputError(f"{text!r} divides by 0; correct the divisor")
    return first / math.prod(others), found[2]


def _unit_size(unit: str, like: str, increment: str | None, rate: float | None) -> float:
    """Return the size of a unit in SI; for an increment, it is multiplied by the rate."""
    if increment is None:
        return si_factor(unit, like)
    try:
        size = si_factor(unit, increment)
    except InputError:
        try:
            return si_factor(unit, like)
        except InputError as error:
            raise InputError(f"{error}, or an increment in {increment} with a rate") from None
    if rate is None:
        raise InputError(f'{unit!r} is an increment and needs the rate, such as rate = "100 Hz"')
    return size * rate


def _whole_number(
    content: dict[str, Any], section: str, key: str, default: int, least: int, most: int
) -> int:
    """Return the number that a key states, after checking its bounds."""
    value = content.get(section, {}).get(key, default)
    if not least <= value <= most:
        text = f" is {shorten(str(value), 24)}; give a number from {least} to {most}"
        raise _refusal(f"[{section}] {key}", text)
    return value


def _invalid_codes(section: str, codes: list[Any]) -> tuple[float, ...]:
    if not all(
        isinstance(code, int) and not isinstance(code, bool) and abs(code) <= _EXACT
        for code in codes
    ):
        text = " has an entry that is not a whole number; give raw values, such as [-32768]"
        raise _refusal(f"[{section}] invalid", text)
    return tuple(float(code) for code in codes)


def _wrap_values(
    content: dict[str, Any], frame: BinaryFrame | TextLine, time: Scale
) -> dict[str, float]:
    """Return the values at which counter and time wrap, as stated or from their widths."""
    wraps = {f.role: 2.0**f.bits for f in frame.fields if 0 < f.bits < 64}
    if "wraps" in content.get("counter", {}):
        wraps["counter"] = float(_whole_number(content, "counter", "wraps", 2, 2, _EXACT))
    if "wraps" in content.get("time", {}):
        stated = content["time"]["wraps"]
        wraps["time"] = (
            _with_key("[time] wraps", lambda: parse_quantity(stated, "s").value) / time.size
        )
    return {role: wraps.get(role, 0.0) for role in ("counter", "time")}
