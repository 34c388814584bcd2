"""One-line error messages for TOML files: the key, its value and the possible values.

Names, types and choices are checked here. Quantities are checked when they are converted to SI
units.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from difflib import get_close_matches
from json import dumps
from math import inf
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, cast, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from inercal.basics.errors import InputError
from inercal.basics.units import LARGEST_NUMBER, format_count
from inercal.benches.kind_definition import KINDS
from inercal.recordings.data import DataSection
from inercal.recordings.io.readers import known_options

_QUANTITY = re.compile(r"[-+]?[0-9.]+ \S.*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")  # a key that TOML takes without quotes
_LONGEST = 60  # characters of a value that are printed
_MISSPELT = 0.85  # similarity, from `difflib`, above which a key counts as a misspelling
_NO_SCALAR: Mapping[type, str] = {dict: "a section", list: "a list"}
_SCALAR: Mapping[type, str] = {
    str: "text",
    int: "a number",
    float: "a number",
    bool: "neither text nor number",
}


class _SchemaLocation(NamedTuple):
    """Location of an error: names of the sections and the key, its type and an example."""

    names: tuple[str, ...]
    annotation: Any
    example: Any
    meaning: str = ""


def unknown_kind_error(kind: object) -> InputError:
    """Return the error for an unknown [bench] kind."""
    key = "[bench] kind"
    return InputError(f"{key}: {_not_possible(kind, KINDS)}", key=key)


def require_possible_numbers(content: object, names: tuple[str, ...] = ()) -> None:
    """Raise an error if a number in a run file is larger than any quantity.

    Raises
    ------
    InputError
    """
    if isinstance(content, Mapping):
        for name, value in cast("Mapping[str, object]", content).items():
            require_possible_numbers(value, (*names, name))
    elif isinstance(content, list | tuple):
        for value in cast("Sequence[object]", content):
            require_possible_numbers(value, names)
    elif isinstance(content, int | float) and LARGEST_NUMBER < abs(content) < inf:
        key = _format_key(names)
        raise InputError(
            f"{key}: {_format_value(content)} is too large; a number can be up to "
            f"{LARGEST_NUMBER:.0e}",
            key=key,
        )


def schema_error(
    error: ValidationError, content: Mapping[str, Any], schema: type[BaseModel]
) -> InputError:
    """Return the first validation error as one line, with a similar name as a suggestion.

    Parameters
    ----------
    error : ValidationError
        Error from validating against `schema`.
    content : mapping
        Contents of the file as written.
    schema : type
        Schema that was used for the validation, such as `RunSchema`.
    """
    # A missing column that only this kind of bench needs is reported last, because the stated kind
    # may be wrong.
    first, *others = sorted(error.errors(include_url=False), key=_is_missing_column)
    kind, loc, value = first["type"], first["loc"], first["input"]
    if kind == "extra_forbidden":
        return _unknown_key_error(loc, value, content, schema)
    if loc[-1] == "[key]":
        options = get_args(get_args(_locate(loc[:-2], schema).annotation)[0])
        names = tuple(map(str, loc[:-1]))
        return InputError(
            f"unknown key {_dotted_key(names)}; possible here: {', '.join(options)}",
            key=_format_key(names),
        )
    place = _locate(loc, schema)
    key = f"[{_dotted_key(place.names)}]" if _is_section(place.annotation) else None
    key = key or _format_key(place.names)
    if kind == "value_error":
        text = first["msg"].removeprefix("Value error, ")
        return InputError(f"[{_dotted_key(place.names)}]: {text}", key=key)
    if isinstance(loc[-1], int) and kind == "missing":  # a list of fixed length is too short
        place, kind = _locate(loc[:-1], schema), "too_short"
    if kind != "missing":
        text = _describe_wrong_value(kind, value, first.get("ctx", {}), place)
        name = _format_key(place.names)
        return InputError(f"{name}: {text}", key=name)
    text = f"{key} is missing"
    if not _is_section(place.annotation):
        is_column = place.meaning.startswith("column ")
        action = f"name the {place.meaning}" if is_column else "state it"
        text += f": {action}{_example_clause(place)}"
    for other in others:  # the key may be present but misspelt
        if other["type"] == "extra_forbidden" and other["loc"][:-1] == loc[:-1]:
            unknown = _unknown_key_error(other["loc"], other["input"], content, schema)
            return InputError(f"{text}; {unknown}", key=key)
    return InputError(text, key=key)


def _unknown_key_error(
    loc: tuple[int | str, ...], value: object, content: Mapping[str, Any], schema: type[BaseModel]
) -> InputError:
    place = _locate(loc[:-1], schema)
    (model,) = _annotation_types(place.annotation)
    name = str(loc[-1])
    names = (*place.names, name)
    dotted, is_section = _dotted_key(names), isinstance(value, dict)
    key = f"[{dotted}]" if is_section else _format_key(names)
    possible = tuple(model.model_fields)
    if place.names == ("data",):
        possible += tuple(known_options())
    # The other kinds of bench are not searched for a misspelt key, because loading them takes 80
    # ms.
    is_misspelt = bool(get_close_matches(name, possible, n=1, cutoff=_MISSPELT))
    owners = [] if is_misspelt else _kinds_with_key(names)
    default = "; [bench] kind is missing, so kind is hand" * (
        bool(owners) and "kind" not in content.get("bench", {})
    )
    benches = f"[bench] kind = {_join_alternatives(owners)}" if owners else ""
    if owners and names[0] == "data":
        text = f"{key} exists only with {benches}{default}: remove {name} or change kind"
        return InputError(text, key=key)
    text = f"unknown section {key}" if is_section else f"unknown key {dotted}"
    if near := get_close_matches(name, possible, n=1):
        text += f"; did you mean {near[0]}?"
    text += f"; possible here: {', '.join(possible)}{default}"
    if owners:
        text += f"; {name} exists only with {benches}"
    return InputError(text, key=key)


def _kinds_with_key(names: tuple[str, ...]) -> list[str]:
    """Return the kinds of bench that have this key of [bench] or [data], quoted."""
    if len(names) != 2 or names[0] not in ("bench", "data"):
        return []
    sections = {
        name: kind.section if names[0] == "bench" else kind.data for name, kind in KINDS.items()
    }
    return [f'"{name}"' for name, section in sections.items() if names[1] in section.model_fields]


def _is_missing_column(error: ErrorDetails) -> bool:
    """Return whether an error reports a missing column that only this kind of bench needs."""
    loc = error["loc"]
    needed = len(loc) == 2 and loc[0] == "data" and loc[1] not in DataSection.model_fields
    return error["type"] == "missing" and needed


def _describe_wrong_value(
    kind: str, value: Any, context: Mapping[str, Any], place: _SchemaLocation
) -> str:
    """Describe the error in the value of a key."""
    types = _annotation_types(place.annotation)
    if kind in ("too_short", "too_long"):
        return f"the list has {format_count(len(value), 'item')}; give {len(get_args(types[0]))}"
    if kind == "greater_than_equal":
        return f"{_format_value(value)} is too small; give {context['ge']} or more"
    if kind == "greater_than":
        return f"{_format_value(value)} is too small; give more than {context['gt']:g}"
    if kind == "string_pattern_mismatch":
        return f"{_format_value(value)} is not possible{_example_clause(place, '; give text')}"
    if get_origin(types[0]) is Literal:
        lists = [_example_clause(place, " or a list") for one in types if get_origin(one) is tuple]
        return "".join((_not_possible(value, get_args(types[0])), *lists))
    if types == (bool,):
        return _not_possible(value, ("true", "false"))
    if types in ((int,), (float,)):
        return f"{_format_value(value)} is not a {'whole ' * (types == (int,))}number"
    return f"{_describe_type(value)}; give {_describe_expected_type(types, place)}"


def _not_possible(value: object, options: Iterable[str]) -> str:
    return f"{_format_value(value)} is not possible; give {_join_alternatives(options)}"


def _describe_expected_type(types: tuple[Any, ...], place: _SchemaLocation) -> str:
    """Describe the type of value that a key expects."""
    if _is_section(types[0]):
        return f"a section, [{_dotted_key(place.names)}]"
    if int in types:
        return "a column, by its name or its number"
    such_as = _example_clause(place)
    if get_origin(types[0]) is tuple:
        return f"a list{such_as}"
    if types == (date,):
        return f"a date{such_as}"
    quantity = isinstance(place.example, str) and _QUANTITY.fullmatch(place.example)
    return f"text with its unit{such_as}" if quantity else f"text in quotes{such_as}"


def _example_clause(place: _SchemaLocation, before: str = "") -> str:
    if place.example is None:
        return ""
    return f"{before or ','} such as {_format_toml(place.example)}"


def _locate(loc: tuple[int | str, ...], schema: type[BaseModel]) -> _SchemaLocation:
    """Convert a location that pydantic reports to a place in the schema."""
    names: list[str] = []
    annotation: Any = schema
    example: Any = None
    meaning = ""
    for part in loc:
        kind = _annotation_types(annotation)[0]
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            field = kind.model_fields[str(part)]
            annotation, example = field.annotation, _field_example(field)
            meaning = field.description or ""
        elif get_origin(kind) is dict:
            annotation = get_args(kind)[1]
            example = example and example.get(part, next(iter(example.values())))
        elif get_origin(kind) is tuple:
            annotation = get_args(kind)[0]
            example = example[0] if example else None
            continue
        else:  # the union member that pydantic tried
            break
        names.append(str(part))
    return _SchemaLocation(tuple(names), annotation, example, meaning)


def _field_example(field: FieldInfo) -> Any:
    if field.examples or field.is_required():
        return field.examples[0] if field.examples else None
    return field.get_default() or None


def _annotation_types(annotation: Any) -> tuple[Any, ...]:
    """Return the types that an annotation allows, without None."""
    if get_origin(annotation) in (Union, UnionType):
        return tuple(kind for kind in get_args(annotation) if kind is not NoneType)
    return (annotation,)


def _is_section(annotation: Any) -> bool:
    kind = _annotation_types(annotation)[0]
    return get_origin(kind) is dict or (isinstance(kind, type) and issubclass(kind, BaseModel))


def _dotted_key(names: Iterable[str]) -> str:
    return ".".join(name if _BARE.fullmatch(name) else _quote_name(name) for name in names)


def _quote_name(name: str) -> str:
    return dumps(name, ensure_ascii=False)


def _format_key(names: tuple[str, ...]) -> str:
    *section, name = names
    name = name if name.isprintable() else _quote_name(name)
    return f"[{_dotted_key(section)}] {name}" if section else name


def _join_alternatives(options: Iterable[str]) -> str:
    *others, last = options
    return f"{', '.join(others)} or {last}" if others else last


def _format_toml(value: Any) -> str:
    if type(value) in (list, tuple):
        return f"[{', '.join(map(_format_toml, value))}]"
    return str(value) if isinstance(value, date) else f'"{value}"'


def _format_value(value: object) -> str:
    """Return a value as written in the file; for a section or a list, return only its type."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str | int | float):
        return _NO_SCALAR.get(type(value), str(value))  # dates and times
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _describe_type(value: object) -> str:
    """Return a description of a value with its type."""
    if type(value) in _NO_SCALAR:
        return f"the value is {_format_value(value)}"
    sort = _SCALAR.get(type(value), "a date or time")
    return f"{_format_value(value)} is {sort}"


__all__ = ["require_possible_numbers", "schema_error", "unknown_kind_error"]
