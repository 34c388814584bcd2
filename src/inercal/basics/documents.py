"""JSON documents that inercal writes and reads: calibrations, control charts, qualifications.

Each record of a document is declared once, as a `Record` whose fields define the permitted values.
The reader returns a `Record`, and `record_object` writes a result with the same fields. The reader
does not convert types: it does not accept `true` or a number in quotation marks as a number. A
number that is not finite is written as null.
"""

import datetime as dt
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import version
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
)

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file

Content = TypeVar("Content", bound=BaseModel)


class Record(BaseModel):
    """A record in a document: its numbers must be finite, and unknown keys are ignored."""

    model_config = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False, defer_build=True)


def _nan_of_null(value: object, number: ValidatorFunctionWrapHandler) -> float:
    return nan if value is None else number(value)


Positive = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Measured = Annotated[
    float, WrapValidator(_nan_of_null), WithJsonSchema({"type": ["number", "null"]})
]
"""A number in a result; null if it is not finite."""


def record_object(value: Any) -> Any:
    """Return a result as JSON content, with null for numbers that are not finite.

    Parameters
    ----------
    value : dataclass, named tuple, mapping, sequence, array, date, number, text or None
    """
    if isinstance(value, float):
        return value if isfinite(value) else None
    if value is None or isinstance(value, str | int):  # most values
        return value
    if names := _field_names(value.__class__):
        return {name: record_object(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        content = cast("Mapping[str, Any]", value)
        return {key: record_object(one) for key, one in content.items()}
    if isinstance(value, tuple | list):
        return [record_object(one) for one in cast("list[Any]", value)]
    if isinstance(value, np.ndarray):
        return record_object(value.tolist())
    return value.isoformat() if isinstance(value, dt.date) else value


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass or a named tuple; empty for other types."""
    named: tuple[str, ...] = getattr(kind, "_fields", ())
    return tuple(one.name for one in fields(kind)) if is_dataclass(kind) else named


def to_utc(text: str) -> str:
    """Convert a time in ISO 8601 to the form in the register: in UTC, to the millisecond.

    A time without a zone is assumed to be UTC, and a date means the beginning of this day.

    Raises
    ------
    ValueError
        If the text is not a time in ISO 8601.

    Examples
    --------
    >>> to_utc("2026-03-01"), to_utc("2026-03-01T10:00:00+02:00")
    ('2026-03-01T00:00:00.000+00:00', '2026-03-01T08:00:00.000+00:00')
    """
    time = dt.datetime.fromisoformat(text)
    try:
        time = time.replace(tzinfo=dt.UTC) if time.tzinfo is None else time.astimezone(dt.UTC)
    except OverflowError:  # in UTC, before the first year or after the last year
        raise ValueError(f"{text} is out of range") from None
    return time.isoformat(timespec="milliseconds")


def stated_time(text: str, start: str = "", example: str = "") -> str:
    """Return the time of measurement that a user states, as `to_utc` does.

    Parameters
    ----------
    text : str
    start : str
        Start of the message, if the text is not a time.
    example : str
        End of the message, after the example of a date.

    Raises
    ------
    InputError
        The text is not a time in ISO 8601.
    """
    try:
        return to_utc(text)
    except ValueError:
        raise InputError(
            f"{start}{text!r} is not a time; write it in ISO 8601, such as 2026-03-01{example}",
            key="--measured",
        ) from None


def document_text(content: Mapping[str, Any]) -> str:
    """Return a document as the text of its file."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def attributes(record: object, names: str) -> dict[str, Any]:
    """Return the named attributes of a record as JSON fields; blanks separate the names."""
    return {name: getattr(record, name) for name in names.split()}


@cache
def installed_version() -> str:
    """Return the version of inercal."""
    return version("inercal")


def origin() -> dict[str, str]:
    """Return the last fields of a document: the date, and the version of inercal."""
    now = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    return {"created": now, "inercal": installed_version()}


def read_document(path: Path, model: type[Content], verb: str) -> Content:
    """Read and check a JSON file that was written by a verb of inercal.

    Parameters
    ----------
    path : Path
    model : type
        The pydantic model of the content.
    verb : str
        The verb that writes such files, such as "inercal repeat"; messages name it.

    Raises
    ------
    InputError
        The file does not exist, or it was not written by the verb.
    """
    text = read_small_file(path, f"file of {verb}")
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        place, reason = first_problem(error)
        raise InputError(
            f"{place or 'the whole file'}: {reason}; give a file that {verb} wrote"
        ).located(path) from None


def first_problem(error: ValidationError) -> tuple[str, str]:
    """Return the first invalid field, such as coefficients[3].std, and its problem."""
    first = error.errors(include_url=False)[0]
    place = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in first["loc"])
    reasons = {"missing": "is missing", "finite_number": "is not finite"}
    message = first["msg"]
    return place.lstrip("."), reasons.get(first["type"], message[0].lower() + message[1:])
