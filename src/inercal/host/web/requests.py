"""What a page asks for, as JSON objects that may hold anything."""

import json
from collections.abc import Mapping
from typing import Any, cast

Asked = Mapping[str, Any]


def parsed(text: str | bytes) -> Asked:
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


def as_object(value: object) -> Asked | None:
    """Return a value that is a JSON object; None for all else."""
    return cast("Asked", value) if isinstance(value, Mapping) else None
