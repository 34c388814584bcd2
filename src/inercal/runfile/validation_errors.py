"""What a run file's schema refuses, in one line: the key, what is there and what is possible.

Names, types and choices are worded here; quantities are judged where they are taken, in `build`.
"""

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from json import dumps
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from inercal.benches.kinds import KINDS
from inercal.data.data_section import DataSection
from inercal.io.readers import known_options
from inercal.runfile.schema import RunSchema

_QUANTITY = re.compile(r"[-+]?[0-9.]+ \S.*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")  # a key that TOML takes without quotes
_RESERVED: Mapping[str, str] = {  # sections of later versions, and what they are for
    "specification": "limits per coefficient, which this version does not judge",
    "environment": "temperatures of the bench, their uncertainty and the sensor's lag, which this "
    "version does not take",
}
_LONGEST = 60  # characters of a value that are repeated
_NO_SCALAR: Mapping[type, str] = {dict: "a section", list: "a list"}
_SCALAR: Mapping[type, str] = {
    str: "text",
    int: "a number",
    float: "a number",
    bool: "neither text nor number",
}


class _SchemaLocation(NamedTuple):
    """Where a complaint is: the names on the way, the type that is taken and an example of it."""

    names: tuple[str, ...]
    takes: Any
    example: Any
    meaning: str = ""


def describe_unknown_kind(chosen: object) -> str:
    """Return what is wrong with a [bench] kind that there is not."""
    return f"[bench] kind: {_format_value(chosen)}; it is {_join_alternatives(KINDS)}"


def describe_error(
    error: ValidationError, content: Mapping[str, Any], schema: type[RunSchema]
) -> str:
    """Return the first complaint as one line, with a name beside it that is misspelt.

    Parameters
    ----------
    error : ValidationError
        Of `RunSchema`.
    content : mapping
        The run file as it was written.
    schema : type
        That refused it.
    """
    # A column that the kind of bench needs comes last: it may be there for another kind.
    complaint, *others = sorted(error.errors(include_url=False), key=_is_missing_column)
    kind, loc, value = complaint["type"], complaint["loc"], complaint["input"]
    if kind == "extra_forbidden":
        return _describe_unknown_key(loc, value, content, schema)
    if loc[-1] == "[key]":
        options = get_args(get_args(_locate(loc[:-2], schema).takes)[0])
        names = _dotted_key(map(str, loc[:-1]))
        return f"unknown key {names}; possible here: {', '.join(options)}"
    place = _locate(loc, schema)
    if kind == "value_error":
        return f"[{_dotted_key(place.names)}]: {complaint['msg'].removeprefix('Value error, ')}"
    if isinstance(loc[-1], int) and kind == "missing":  # of a list of fixed length
        place, kind = _locate(loc[:-1], schema), "too_short"
    if kind == "missing":
        column = f": name the {place.meaning}" * place.meaning.startswith("column ")
        line = f"{_format_key(place.names)} is missing{column}{_example_clause(place)}"
        if _is_section(place.takes):
            line = f"[{_dotted_key(place.names)}] is missing"
        for other in others:  # it may be there, misspelt
            if other["type"] == "extra_forbidden" and other["loc"][:-1] == loc[:-1]:
                return (
                    f"{line}; "
                    f"{_describe_unknown_key(other['loc'], other['input'], content, schema)}"
                )
        return line
    return (
        f"{_format_key(place.names)}: "
        f"{_describe_wrong_value(kind, value, complaint.get('ctx', {}), place)}"
    )


def _describe_unknown_key(
    loc: tuple[int | str, ...],
    value: object,
    content: Mapping[str, Any],
    schema: type[RunSchema],
) -> str:
    place = _locate(loc[:-1], schema)
    (model,) = _annotation_types(place.takes)
    key = str(loc[-1])
    names = (*place.names, key)
    if len(names) == 1 and names[0] in _RESERVED:
        return f"section [{names[0]}] is reserved for {_RESERVED[names[0]]}: leave it out"
    dotted = _dotted_key(names)
    line = f"unknown section [{dotted}]" if isinstance(value, dict) else f"unknown key {dotted}"
    possible = tuple(model.model_fields)
    if place.names == ("data",):
        possible += tuple(known_options())
    if near := get_close_matches(names[-1], possible, n=1):
        line += f"; did you mean {near[0]}?"
    line += f"; possible here: {', '.join(possible)}"
    if owners := _kinds_with_key(names):
        hand = "; kind is missing, so hand is taken" * ("kind" not in content.get("bench", {}))
        if place.names == ("data",):
            return f"[data] {key} goes with [bench] kind = {_join_alternatives(owners)}{hand}"
        line += f"{hand}; {key} goes with kind = {_join_alternatives(owners)}"
    return line


def _kinds_with_key(names: tuple[str, ...]) -> list[str]:
    """Return the kinds of bench to which a key of [bench] or [data] belongs, quoted."""
    if len(names) != 2 or names[0] not in ("bench", "data"):
        return []
    sections = {
        name: kind.section if names[0] == "bench" else kind.data for name, kind in KINDS.items()
    }
    return [f'"{name}"' for name, section in sections.items() if names[1] in section.model_fields]


def _is_missing_column(complaint: ErrorDetails) -> bool:
    """Return whether a complaint is of a column that is missing for this kind of bench."""
    loc = complaint["loc"]
    needed = len(loc) == 2 and loc[0] == "data" and loc[1] not in DataSection.model_fields
    return complaint["type"] == "missing" and needed


def _describe_wrong_value(
    kind: str, value: Any, context: Mapping[str, Any], place: _SchemaLocation
) -> str:
    """Return what is wrong with the value of a key."""
    taken = _annotation_types(place.takes)
    if kind in ("too_short", "too_long"):
        return f"{len(value)} in the list; it takes {len(get_args(taken[0]))}"
    if kind == "greater_than_equal":
        return f"{_format_value(value)}; it must be {context['ge']} or more"
    if get_origin(taken[0]) is Literal:
        return f"{_format_value(value)}; it is {_join_alternatives(get_args(taken[0]))}"
    if taken == (bool,):
        return f"{_format_value(value)}; it is true or false"
    if taken in ((int,), (float,)):
        whole = "whole " if taken == (int,) else ""
        return f"{_format_value(value)} is not a {whole}number"
    return f"{_describe_type(value)}; give {_describe_expected_type(taken, place)}"


def _describe_expected_type(taken: tuple[Any, ...], place: _SchemaLocation) -> str:
    """Return what may stand in the place of a value of another type."""
    if _is_section(taken[0]):
        return f"a section, [{_dotted_key(place.names)}]"
    if int in taken:
        return "a column, by its name or its number"
    such_as = _example_clause(place)
    if get_origin(taken[0]) is tuple:
        return f"a list{such_as}"
    quantity = isinstance(place.example, str) and _QUANTITY.fullmatch(place.example)
    return f"text with its unit{such_as}" if quantity else f"text in quotes{such_as}"


def _example_clause(place: _SchemaLocation) -> str:
    return "" if place.example is None else f", such as {_format_toml(place.example)}"


def _locate(loc: tuple[int | str, ...], schema: type[RunSchema]) -> _SchemaLocation:
    """Follow a complaint's location through the schema."""
    names: list[str] = []
    takes: Any = schema
    example: Any = None
    meaning = ""
    parts = list(loc)
    for part in parts:
        kind = _annotation_types(takes)[0]
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            field = kind.model_fields[str(part)]
            takes, example = field.annotation, _field_example(field)
            meaning = field.description or ""
        elif get_origin(kind) is dict:
            takes = get_args(kind)[1]
            example = example and example.get(part, next(iter(example.values())))
        elif get_origin(kind) is tuple:
            takes = get_args(kind)[0]
            example = example[0] if example else None
            continue
        else:  # which type of several was tried
            break
        names.append(str(part))
    return _SchemaLocation(tuple(names), takes, example, meaning)


def _field_example(field: FieldInfo) -> Any:
    if field.examples or field.is_required():
        return field.examples[0] if field.examples else None
    return field.get_default() or None


def _annotation_types(annotation: Any) -> tuple[Any, ...]:
    """Return the types that an annotation allows, None apart."""
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
    return f'"{value}"'


def _format_value(value: object) -> str:
    """Return a value as it stands in the file, or what it is."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str | int | float):
        return _NO_SCALAR.get(type(value), str(value))  # dates and times
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _describe_type(value: object) -> str:
    """Return what a value is."""
    if type(value) in _NO_SCALAR:
        return f"it is {_format_value(value)}"
    sort = _SCALAR.get(type(value), "a date or time")
    return f"{_format_value(value)} is {sort}"


__all__ = ["describe_error", "describe_unknown_kind"]
