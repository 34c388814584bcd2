"""Write the page and the description of the HTTP interface: ``python -m tools.interface_page``."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from inercal.host.web.app import Page
from inercal.host.web.interface import READ_TOKEN, RECORDS, openapi_description

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "http-interface.md"
DESCRIPTION = PAGE.with_name("openapi.json")
_HEAD = """\
# The HTTP interface of the live page

`make interface` writes this page from the program. It lists the requests that the server of
`inercal bench serve` answers, and the fields of the answers. [Read the page from a
script](../how-to/live-page.md#read-the-page-from-a-script) explains how to use them. The server
also describes the interface at `/api/openapi.json`, in
[OpenAPI 3.1](https://spec.openapis.org/oas/v3.1.1), so that other programs can generate a client.
[The same description](openapi.json) is part of this documentation. This is version {version} of
the interface.
"""
_RECORDS = """\
A `CalibrationRecord` is the content of [a calibration file](calibration-file.md). A field is always
present unless it is marked as optional. A value is null if it is unknown.
"""
_COMMANDS = """\
A command is a message `{"do": NAME, …}` with the fields in this table. The read-only token does not
open the websocket, so a script with this token cannot send any of these commands.
"""


def description_text() -> str:
    """Return the description as the text of its file."""
    return json.dumps(openapi_description(Page), indent=1, ensure_ascii=False) + "\n"


def interface_page() -> str:
    """Return the page: the operations, the records of the answers, and the websocket."""
    description = openapi_description(Page)
    lines = [_HEAD.format(version=description["info"]["version"]), "## Operations", ""]
    lines += ["| request | read-only token | what it does | answer |", "|---|---|---|---|"]
    lines += _operation_rows(description["paths"])
    lines += ["", "## Records", ""]
    lines += [_RECORDS]
    for name in RECORDS:
        lines += [f"### {name}", "", "| field | type | unit | meaning |", "|---|---|---|---|"]
        lines += [*_field_rows(description["components"]["schemas"][name]), ""]
    lines += ["## Commands on the websocket `/live`", ""]
    lines += [_COMMANDS]
    lines += ["| command | who | what it does | fields |", "|---|---|---|---|"]
    for name, one in description["paths"]["/live"]["get"]["x-commands"].items():
        who = "everyone" if one["everyone"] else "operator"
        fields = "; ".join(f"`{field}`: {words}" for field, words in one["fields"].items())
        lines.append(f"| `{name}` | {who} | {one['meaning']} | {fields} |")
    return "\n".join(lines) + "\n"


def _operation_rows(paths: dict[str, Any]) -> Iterator[str]:
    for path, methods in paths.items():
        for method, one in methods.items():
            token = "yes" if {READ_TOKEN: []} in one["security"] else "refused"
            content = one["responses"].get("200", {}).get("content", {})
            answers = (_answer(kind, each) for kind, each in content.items())
            query = [p["name"] for p in one.get("parameters", ()) if p["in"] == "query"]
            shown = path + "".join(f"?{name}=N" for name in query)
            row = f"`{method.upper()} {shown}`", token, one["summary"], ", ".join(answers)
            yield f"| {' | '.join(row)} |"


def _answer(kind: str, content: dict[str, Any]) -> str:
    named = content.get("schema", {}).get("$ref")
    return f"`{named.rpartition('/')[2]}`" if named else kind


def _field_rows(schema: dict[str, Any]) -> Iterator[str]:
    for name, field in schema["properties"].items():
        kind = _kind(field) + ("" if name in schema["required"] else ", optional")
        yield f"| `{name}` | {kind} | {field.get('x-unit', '')} | {field['description']} |"


def _kind(field: dict[str, Any]) -> str:
    if "$ref" in field:
        return f"`{field['$ref'].rpartition('/')[2]}`"
    if "anyOf" in field:
        return f"{_kind(field['anyOf'][0])} or null"
    return f"list of {_kind(field['items'])}" if field["type"] == "array" else field["type"]


if __name__ == "__main__":
    PAGE.write_text(interface_page(), encoding="utf-8")
    DESCRIPTION.write_text(description_text(), encoding="utf-8")
    print(f"wrote {PAGE.name} and {DESCRIPTION.name}")
