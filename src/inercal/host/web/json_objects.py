"""What a page asks for, as JSON objects that may hold anything."""

import json
from collections.abc import Mapping
from typing import Any, cast

from inercal.basics.errors import InputError

JsonObject = Mapping[str, Any]
_AMBIENT_RANGE = (-90.0, 100.0)  # °C


def parse_object(text: str | bytes) -> JsonObject:
    """Return a JSON object.

    Raises
    ------
    ValueError
        It is none.
    """
    try:
        result = object_or_none(json.loads(text))
    except RecursionError:
        result = None
    if result is None:
        raise ValueError("the message is not a JSON object; send one")
    # JSON can name half of a surrogate pair, which no file, database or reply can hold.
    json.dumps(result, ensure_ascii=False).encode()
    return result


def object_or_none(value: object) -> JsonObject | None:
    """Return a value that is a JSON object; None for all else."""
    return cast("JsonObject", value) if isinstance(value, Mapping) else None


def printable_line(text: object, most: int) -> str | None:
    """Return a text that somebody typed, without spaces around it; None where it is none."""
    if not isinstance(text, str) or not text.isprintable():
        return None
    return text.strip() if 0 < len(text.strip()) <= most else None


def ambient_temperature(asked: object) -> float | None:
    """Return the room temperature that was typed, °C; None if none was.

    Raises
    ------
    InputError
        It is none.
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
