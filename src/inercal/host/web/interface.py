"""The HTTP interface of the page, as `interface.toml` declares it, and its OpenAPI 3.1 description.

Sources: OpenAPI Specification 3.1.1 (openapis.org); RFC 6750 section 2.1 for the token's header.
"""

import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from inspect import cleandoc
from typing import Any, NamedTuple

from inercal.basics.documents import record_object
from inercal.calibration.file_schema import CalibrationRecord

READ_TOKEN = "readToken"
_DECLARED = tomllib.loads(
    files("inercal.host.web").joinpath("interface.toml").read_text(encoding="utf-8")
)
_TYPES = {"text": "string"} | {one: one for one in ("number", "integer", "boolean", "object")}
_SCHEMAS = "#/components/schemas/"
_SESSION = "session"
_REFUSALS = {
    "401": "The token is missing or wrong.",
    "403": "The request comes from another site, or the read-only token was sent with a command.",
    "421": "The request is addressed to another host.",
    "429": "There were too many wrong tokens, or there are too many requests of this kind.",
}
_HEAD = """
Answers are JSON and are never stored by caches. Each number has its unit: in the same object, in
`units`, or in the schema (`x-unit`). Wall-clock times are ISO 8601 in UTC.

A server that other machines can reach asks for a token. Scripts send the read-only token in the
header `Authorization: Bearer TOKEN`, never in an address. The token opens the GET operations; every
command with this token is refused with status 403, also on the websocket. Commands need the session
of a browser that has shown the page's own token, and the Origin header of the page.
"""


class InterfaceRoute(NamedTuple):
    """A route of the interface; `interface.toml` explains the fields."""

    method: str
    path: str
    handler: str
    answer: str | list[str] = ""
    body: str = ""
    query: Mapping[str, str] = {}
    choices: Mapping[str, list[str]] = {}
    refusals: Mapping[str, str] = {}

    @property
    def reads(self) -> bool:
        """Whether the read-only token opens this route."""
        return self.method == "GET"


class ViewerCommand(NamedTuple):
    """A command on the websocket, with the meanings of its further fields."""

    meaning: str
    fields: Mapping[str, str] = {}
    everyone: bool = False


class RecordField(NamedTuple):
    """A field of a record: its JSON schema, its unit, and the record in it, if any."""

    schema: Mapping[str, Any]
    unit: str
    record: str
    required: bool

    @classmethod
    def parse(cls, name: str, text: str) -> "RecordField":
        """Convert the text of a field in `interface.toml`."""
        head, _, words = text.partition(": ")
        kind, _, unit = head.partition(" ")
        about = {"description": words} | ({"x-unit": unit} if unit else {})
        record = kind.rstrip("[]?")
        return cls(_schema(kind) | about, unit, record, not name.endswith("?"))


def _schema(kind: str) -> dict[str, Any]:
    if kind.endswith("?"):
        return {"anyOf": [_schema(kind[:-1]), {"type": "null"}]}
    if kind.endswith("[]"):
        return {"type": "array", "items": _schema(kind[:-2])}
    return {"type": _TYPES[kind]} if kind in _TYPES else {"$ref": _SCHEMAS + kind}


ROUTES = tuple(InterfaceRoute(**one) for one in _DECLARED["routes"])
COMMANDS = {name: ViewerCommand(**one) for name, one in _DECLARED["commands"].items()}
RECORDS: Mapping[str, Mapping[str, RecordField]] = {
    record: {name.rstrip("?"): RecordField.parse(name, text) for name, text in fields.items()}
    for record, fields in _DECLARED["records"].items()
}


def units_of(record: str) -> dict[str, str]:
    """Return the units of the numbers in a record and in the records that it contains, by name."""
    result: dict[str, str] = {}
    for name, field in RECORDS.get(record, {}).items():
        result |= units_of(field.record) | ({name: field.unit} if field.unit else {})
    return result


def openapi_description(page: type) -> dict[str, Any]:
    """Return the description of the interface as an OpenAPI 3.1 document.

    Parameters
    ----------
    page : type
        Class of the page, whose handlers state the summaries.
    """
    paths: dict[str, dict[str, Any]] = {}
    for route in ROUTES:
        about = {"operationId": route.handler, "summary": _summary(getattr(page, route.handler))}
        described = _websocket_object() if route.method == "WEBSOCKET" else _operation(route)
        method = "post" if route.method == "POST" else "get"
        paths.setdefault(route.path, {})[method] = about | described
    # A default may be NaN, which JSON does not have.
    calibration = record_object(
        CalibrationRecord.model_json_schema(ref_template=_SCHEMAS + "{model}")
    )
    schemas = calibration.pop("$defs") | {"CalibrationRecord": calibration}
    for record, fields in RECORDS.items():
        schemas[record] = {
            "type": "object",
            "properties": {name: one.schema for name, one in fields.items()},
            "required": [name for name, one in fields.items() if one.required],
        }
    cookie = {"type": "apiKey", "in": "cookie", "name": "inercal-session-PORT"}
    schemes = {READ_TOKEN: {"type": "http", "scheme": "bearer"}, _SESSION: cookie}
    title, version = "inercal live page", _DECLARED["version"]
    return {
        "openapi": "3.1.0",
        "info": {"title": title, "version": version, "description": cleandoc(_HEAD)},
        "paths": paths,
        "components": {"schemas": schemas, "securitySchemes": schemes},
    }


def _operation(route: InterfaceRoute) -> dict[str, Any]:
    answer = route.answer
    listed = isinstance(answer, list)
    content: dict[str, Any] = {kind: {} for kind in answer} if listed else _json(answer)
    refusals = {
        status: {"description": words}
        for status, words in sorted((_REFUSALS | dict(route.refusals)).items())
    }
    in_path: list[dict[str, Any]] = [
        {"name": name, "in": "path", "required": True, "schema": _choice(route, name)}
        for name in re.findall(r"{(\w+)}", route.path)
    ]
    in_query: list[dict[str, Any]] = [
        {"name": name, "in": "query", "description": words, "schema": {"type": "integer"}}
        for name, words in route.query.items()
    ]
    return {
        "parameters": in_path + in_query,
        "security": [{}, {_SESSION: []}, *([{READ_TOKEN: []}] if route.reads else [])],
        **({"requestBody": {"content": _json(route.body)}} if route.body else {}),
        "responses": {"200": {"description": "The answer.", "content": content}} | refusals,
    }


def _websocket_object() -> dict[str, Any]:
    """Return the operation of the websocket; OpenAPI only knows its opening request."""
    return {
        "security": [{}, {_SESSION: []}],
        "responses": {
            "101": {"description": "The websocket is open."},
            "403": {"description": _REFUSALS["403"]},
        },
        "x-commands": {name: one._asdict() for name, one in COMMANDS.items()},
    }


def _summary(handler: object) -> str:
    return (handler.__doc__ or "").partition("\n")[0]


def _json(kind: str) -> dict[str, Any]:
    return {"application/json": {"schema": _schema(kind)}}


def _choice(route: InterfaceRoute, name: str) -> dict[str, Any]:
    values = route.choices.get(name)
    return {"type": "string"} | ({"enum": values} if values else {})
