"""The keys of a drafted run file, each with its reason."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

UNKNOWN = "?"
"""The value of a key that only the user knows."""


@dataclass(frozen=True)
class DraftKey:
    """A key of a run file.

    Parameters
    ----------
    section : str
        "sensor.accelerometer".
    key : str
    value : object
        As TOML holds it; `UNKNOWN` where only the user knows it.
    reason : str
        How it was chosen, for the comment beside it.
    ask : str
        What to ask the user; empty where there is no need.
    """

    section: str
    key: str
    value: Any
    reason: str = ""
    ask: str = ""

    @property
    def name(self) -> str:
        """The key with its section, as in messages."""
        return f"[{self.section}] {self.key}"


def as_sections(entries: tuple[DraftKey, ...]) -> dict[str, Any]:
    """Return the sections of the run file, nested as TOML reads them."""
    content: dict[str, Any] = {}
    for entry in entries:
        place = content
        for part in entry.section.split("."):
            place = place.setdefault(part, {})
        place[entry.key] = entry.value
    return content


def run_file_text(entries: tuple[DraftKey, ...], head: tuple[str, ...]) -> str:
    """Return the commented run file.

    Parameters
    ----------
    entries : tuple of DraftKey
    head : tuple of str
        Lines of the comment at the top.
    """
    lines = [f"# {line}".rstrip() for line in head]
    for section, found in _by_section(entries).items():
        lines += ["", f"[{section}]"]
        for entry in found:
            text = f"{entry.key} = {_toml(entry.value)}"
            reason = "please state: " + entry.ask if entry.value == UNKNOWN else entry.reason
            lines.append(f"{text}  # {_one_line(reason)}" if reason else text)
    return "\n".join(lines) + "\n"


def _by_section(entries: tuple[DraftKey, ...]) -> Mapping[str, list[DraftKey]]:
    found: dict[str, list[DraftKey]] = {}
    for entry in entries:
        found.setdefault(entry.section, []).append(entry)
    return found


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _toml(value: object) -> str:
    """Return a value as TOML: text, number, true or false, or a list of these."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, cast(list[object], value))) + "]"
    text = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text) + '"'
