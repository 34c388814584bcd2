"""Parses requests from a page: JSON objects whose content is not trusted."""

import json
from collections.abc import Mapping
from typing import Any, cast

from inercal.basics.errors import InputError

JsonObject = Mapping[str, Any]
_AMBIENT_RANGE = (-90.0, 100.0)  # °C


def parse_object(text: str | bytes) -> JsonObject:
    """Convert a text to a JSON object.

    Raises
    ------
    ValueError
        The text is not a JSON object.
    """
    try:
        result = object_or_none(json.loads(text))
    except RecursionError:
        result = None
    if result is None:
        raise ValueError("the message is not a JSON object; send one")
    # JSON can contain half of a surrogate pair, which files, databases and replies cannot
    # represent.
    json.dumps(result, ensure_ascii=False).encode()
    return result


def object_or_none(value: object) -> JsonObject | None:
    """Return a value if it is a JSON object, and None otherwise."""
    return cast("JsonObject", value) if isinstance(value, Mapping) else None


def printable_line(text: object, most: int) -> str | None:
    """Return a typed text without outer spaces; None if it is not a printable line."""
    if not isinstance(text, str) or not text.isprintable():
        return None
    return text.strip() if 0 < len(text.strip()) <= most else None


def ambient_temperature(asked: object) -> float | None:
    """Return the room temperature that the operator typed, °C; None if the field is empty.

    Raises
    ------
    InputError
        The value is not a possible temperature.
    """
    low, high = _AMBIENT_RANGE
    if asked is None:
        return None
    if not isinstance(asked, (int, float)) or isinstance(asked, bool) or not low <= asked <= high:
        raise InputError(
            f"the ambient temperature {str(asked)[:40]!r} is not possible; give a number from "
            f"{low:g} to {high:g} °C",
            key="ambient",
        )
    return float(asked)
