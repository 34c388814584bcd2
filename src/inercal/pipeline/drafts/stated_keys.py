"""Read run-file keys that the user states as text: `data.rate=100 Hz`, `data.gyro=[5, 6, 7]`.

A draft also states the keys of [bench] whose defaults have an effect, so that the user sees them.
Such defaults often dominate U, for example half a degree for the tilt of a face or one degree for a
turn.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin

from pydantic import BaseModel

from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import parse_toml
from inercal.basics.units import si_factor
from inercal.benches.kind_definition import KINDS, Kind
from inercal.physics.plan import Turn
from inercal.physics.quantities import SensorKind
from inercal.physics.section_settings import PLANNING, BenchUsage, key_error
from inercal.physics.sensors import output_unit
from inercal.pipeline.drafts.column_names import NAMES
from inercal.pipeline.drafts.draft_entries import UNKNOWN, DraftKey
from inercal.recordings.io.column_table import Table, select_columns
from inercal.recordings.io.read import detect_reader
from inercal.recordings.io.readers import known_options
from inercal.recordings.temperature import TemperatureReadout, named_unit, temperature_readout
from inercal.runfile.schema import RunSchema

_TRIADS = ("accelerometer", "gyro")
_COLUMNS = (*_TRIADS, *NAMES)
# Defaults that no test of the data can contradict, with what they assume
_ASSUMED = {
    "timebase": ", because a recorder without a crystal (ceramic or RC oscillator) may be 0.5 % to "
    "2 % off, and the gyros' scale factors with it"
}


def stated_values(stated: Mapping[str, str]) -> dict[str, Any]:
    """Parse the values of stated keys; lists and numbers are written as in TOML.

    >>> stated_values({"data.gyro": "a,b,c", "data.accelerometer": "[2, 3, 4]"})
    {'data.gyro': ['a', 'b', 'c'], 'data.accelerometer': [2, 3, 4]}
    >>> stated_values({"method.temperature_order": "auto"})
    {'method.temperature_order': 'auto'}

    Raises
    ------
    InputError
        If a key does not exist in run files, or a list cannot be read.
    """
    return {key: _value(key, text) for key, text in stated.items()}


def stated_units(values: Mapping[str, Any]) -> dict[str, str]:
    """Return the output unit of each triad that the user states directly or in a nominal scale.

    >>> stated_units({"sensor.accelerometer.unit": "g", "sensor.gyro.scale": "131 LSB/(°/s)"})
    {'accelerometer': 'g', 'gyro': 'LSB'}

    Raises
    ------
    InputError
        If a unit does not belong to the quantity.
    """
    found: dict[str, str] = {}
    for kind, like in (("accelerometer", "m/s²"), ("gyro", "rad/s"), ("magnetometer", "T")):
        key = f"sensor.{kind}.unit"
        if key in values:
            found[kind] = str(values[key])
        elif scale := values.get(f"sensor.{kind}.scale"):
            found[kind] = str(scale).partition(" ")[2].partition("/")[0]
        if kind in found and output_unit(found[kind]) is None:
            try:
                si_factor(found[kind], like)
            except InputError as error:
                raise InputError(f"--set {key}: {error}", key=key, names=(key,)) from None
    return found


def stated_options(values: Mapping[str, Any], log: Path) -> dict[str, object]:
    """Return the stated options of a file's reader, such as `skip` or `corrections`."""
    stated = {key: values.get(f"data.{key}") for key in detect_reader(log).keys}
    return {key: value for key, value in stated.items() if value is not None}


def stated_thermometer(values: Mapping[str, Any], column: str | None) -> TemperatureReadout:
    """Return the readout of the temperature column from the stated values.

    Raises
    ------
    InputError
        If the unit is not a temperature unit, if counts are stated without scale and zero, or if a
        value has the wrong type.
    """
    given = {key: values.get(f"data.temperature_{key}") for key in ("unit", "scale", "zero")}
    for key, value in given.items():
        if value is not None and not isinstance(value, str):
            raise key_error(
                f"data.temperature_{key}", f"{value!r} has no unit; write it as text with its unit"
            )
    allowed = values.get("data.allow_temperature", False)
    if not isinstance(allowed, bool):
        raise key_error(
            "data.allow_temperature", f"{allowed!r} is not possible; it can be true or false"
        )
    unit = given["unit"] or named_unit(column)
    return temperature_readout(unit, given["scale"], given["zero"], allowed=allowed)


def stated_columns(
    values: Mapping[str, Any], table: Table, *, second_file: bool
) -> dict[str, tuple[str, ...]]:
    """Return the stated columns of a table by role; column numbers start at 1.

    Parameters
    ----------
    values : mapping of str to object
        Values from `stated_values`.
    table : Table
    second_file : bool
        Whether the gyros are in a second file.

    Raises
    ------
    InputError
        If a stated column is not in the table.
    """
    roles = [role for role in _COLUMNS if role != "gyro" or not second_file]
    return {role: _columns(role, values, table) for role in roles if f"data.{role}" in values}


def stated_triad(
    kind: SensorKind, values: Mapping[str, Any], table: Table
) -> dict[str, tuple[str, ...]]:
    """Return the stated columns of one kind of axes, such as those of a separate gyro file.

    Raises
    ------
    InputError
        If a stated column is not in the file.
    """
    return {kind: _columns(kind, values, table)} if f"data.{kind}" in values else {}


def _columns(role: str, values: Mapping[str, Any], table: Table) -> tuple[str, ...]:
    key = f"data.{role}"
    value = values[key]
    given = cast(list[object], value) if isinstance(value, list) else [value]
    names = tuple(_column_name(one, table) for one in given)
    with error_location(key, key=key):
        select_columns(table.names, names, table.source)
    if role in _TRIADS and len(set(names)) != len(names):
        raise InputError(f"{key}: {', '.join(names)}: name each column once", key=key)
    return names


def _column_name(column: object, table: Table) -> str:
    """Return the name, without sign, of a column that is given by name or number."""
    text = str(column).removeprefix("-")
    if text in table.names or not text.isdecimal() or not 1 <= int(text) <= len(table.names):
        return text
    return table.names[int(text) - 1]


def _value(key: str, text: str) -> Any:
    types = _types(key)
    words = [word for one in types if get_origin(one) is Literal for word in get_args(one)]
    if text in words:
        return text
    if any(get_origin(one) in (tuple, list) for one in types):
        return _list(key, text)
    if str in types and not (int in types and text.isdecimal()):
        return text
    return _toml(text, text)


def _list(key: str, text: str) -> list[Any]:
    """Parse a list that is written as TOML, or as words separated by commas."""
    if not text.startswith("["):
        words = [word.strip() for word in text.split(",")]
        return [int(word) if word.isdecimal() else word for word in words]
    value = _toml(text, None)
    if not isinstance(value, list):
        # A shell removes the quotes in ["a", "b"].
        words = [word.strip().strip("'\"") for word in text.strip("[]").split(",")]
        if not text.endswith("]") or not all(words):
            raise InputError(
                f'{key}: {text} is not a list; write ["a", "b", "c"] or a,b,c', key=key
            )
        return [int(word) if word.isdecimal() else word for word in words]
    return cast(list[Any], value)


def _toml(text: str, otherwise: Any) -> Any:
    try:
        return parse_toml(f"value = {text}")["value"]
    except InputError:
        return otherwise


def _types(key: str) -> tuple[Any, ...]:
    """Return the types that a key accepts.

    Raises
    ------
    InputError
        If the key does not exist in run files; the message names the nearest possible ones.
    """
    section, *rest = key.split(".")
    models: list[Any] = [RunSchema]
    place = section if section in ("bench", "data") else ""
    if place:
        models = [kind.section if place == "bench" else kind.data for kind in KINDS.values()]
    else:
        rest = [section, *rest]
    types: tuple[Any, ...] = ()
    for part in rest:
        fields = {name: field for model in models for name, field in model.model_fields.items()}
        if section == "data" and part in known_options() and part not in fields:
            return (int, float, bool)
        if part not in fields:
            raise _unknown(key, place, part, tuple(fields))
        types = _members(fields[part].annotation)
        if any(get_origin(one) is dict for one in types):
            return (str,)
        models = [one for one in types if isinstance(one, type) and issubclass(one, BaseModel)]
        place = f"{place}.{part}".lstrip(".")
        if not models:
            break
    if models or key != place:
        possible = tuple(name for model in models for name in model.model_fields)
        raise _unknown(key, place, key.removeprefix(f"{place}."), possible)
    return types


def _unknown(key: str, place: str, part: str, possible: tuple[str, ...]) -> InputError:
    near = get_close_matches(part, possible, n=3, cutoff=0.5)
    head = f"{place}." if place else ""
    hint = f"did you mean {' or '.join(head + one for one in near)}? " if near else ""
    listed = f"possible: {', '.join(head + one for one in dict.fromkeys(possible))}"
    return InputError(
        f"--set {key}: a run file has no such key; {hint or listed}".strip(), key=key, names=(key,)
    )


def _members(annotation: Any) -> tuple[Any, ...]:
    """Return the alternatives of a union type, without None."""
    if get_origin(annotation) in (Union, UnionType):
        return tuple(one for one in get_args(annotation) if one is not type(None))
    return (annotation,)


_UNITS = "°"  # unit for an error message about a default, which no user sees


def default_bench_keys(content: Mapping[str, Any], method_name: str) -> tuple[DraftKey, ...]:
    """Return the keys of [bench] that are not stated and whose default is not zero.

    Parameters
    ----------
    content : mapping
        Sections of the drafted run file.
    method_name : str
        Name of the proposed method; defaults that do not change its results are left out.
    """
    from inercal.methods import method

    bench = cast("dict[str, Any]", content.get("bench", {}))
    kind = KINDS[bench.get("kind", "hand")]
    chosen = method(method_name)
    steps = () if chosen.unknown_attitudes or Turn not in kind.steps else chosen.plan()
    use = BenchUsage(
        method=chosen.name,
        turns=any(isinstance(step, Turn) for step in steps),
        attitudes=not chosen.unknown_attitudes,
        gyros="w" in chosen.default_coefficients and "gyro" in content.get("sensor", {}),
        means=content["data"].get("kind") == "means",
        rest=chosen.follows_rest,
        angles=not chosen.without_angles,
    )
    known = {key: value for key, value in bench.items() if value != UNKNOWN}
    unused = kind.section.model_construct(**known).unused_keys(use)
    meanings = _meanings(kind)
    found: list[DraftKey] = []
    for key, info in kind.section.model_fields.items():
        if key in bench or key in unused or info.json_schema_extra == PLANNING:
            continue
        default = cast("object", info.default)
        value = list(cast("tuple[object, ...]", default)) if isinstance(default, tuple) else default
        if _acts(value):
            meaning = meanings.get(key, info.description or "")
            words = f"{meaning}: " if meaning else ""
            reason = f"{words}this is the default; state your own value{_ASSUMED.get(key, '')}"
            found.append(DraftKey("bench", key, value, reason, assumed=key in _ASSUMED))
    return tuple(found)


def _acts(value: object) -> bool:
    """Return whether a default is a quantity, or a list of them, that is not exactly zero."""
    from inercal.basics.units import parse_quantity

    texts = cast("list[object]", value) if isinstance(value, list) else [value]
    for text in texts:
        if not isinstance(text, str) or not text[:1].isdigit():
            continue
        like = text.split(" ± ")[-1].partition(" ")[2]
        try:
            read = parse_quantity(text, like or _UNITS)
        except InputError:
            continue
        if read.value or read.sd:
            return True
    return False


def _meanings(kind: Kind[Any, Any]) -> dict[str, str]:
    """Return the meaning of each key that a kind of bench declares."""
    from inercal.benches.key_declarations import declarations

    found: dict[str, str] = {}
    for name, one in declarations(kind.bench).items():
        words = one.parameters
        each = [words] if isinstance(words, str) else list(dict.fromkeys(words.values()))
        found[one.key or name] = " and ".join(each)
    return found
