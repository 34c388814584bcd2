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
        result = as_object(json.loads(text))
    except RecursionError:
        result = None
    if result is None:
        raise ValueError("the message is not a JSON object; send one")
    # JSON can name half of a surrogate pair, which no file, database or reply can hold.
    json.dumps(result, ensure_ascii=False).encode()
    return result


def as_object(value: object) -> JsonObject | None:
    """Return a value that is a JSON object; None for all else."""
    return cast("JsonObject", value) if isinstance(value, Mapping) else None
