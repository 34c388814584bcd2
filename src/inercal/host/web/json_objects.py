"""What a page asks for, as JSON objects that may hold anything."""

import json
from collections.abc import Mapping
from typing import Any, cast

JsonObject = Mapping[str, Any]


def parse_object(text: str | bytes) -> JsonObject:
    """Return a JSON object.

    Raises
    ------
    ValueError
        It is none.
    """
    try:
        made = as_object(json.loads(text))
    except RecursionError:
        made = None
    if made is None:
        raise ValueError("no JSON object")
    return made


def as_object(value: object) -> JsonObject | None:
    """Return a value that is a JSON object; None for all else."""
    return cast("JsonObject", value) if isinstance(value, Mapping) else None
