"""Store the keys of a drafted run file, each with the reason for it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

UNKNOWN = "?"
"""The value of a key that only the user knows."""

ANYWHERE = "9.80 m/s² ± 0.02 m/s²"
"""Gravity anywhere near sea level."""

ASSUMED_UNIT = "unit_assumed"
"""The key that tells that nobody has confirmed a unit."""


@dataclass(frozen=True)
class DraftKey:
    """A key of a run file.

    Parameters
    ----------
    section : str
        Name of the section, such as "sensor.accelerometer".
    key : str
    value : object
        Value as in TOML; `UNKNOWN` if only the user knows it.
    reason : str
        Reason for the value, for the comment beside it.
    ask : str
        Question for the user; empty if there is no need to ask.
    typical : str
        A typical value that the user may accept; empty if there is none.
    assumed : bool
        Whether the value is the typical one because the user was not asked.
    """

    section: str
    key: str
    value: Any
    reason: str = ""
    ask: str = ""
    typical: str = ""
    assumed: bool = False

    @property
    def question(self) -> str:
        """The question with the typical value."""
        return f"{self.ask}; {self.typical} is typical" if self.typical else self.ask

    @property
    def name(self) -> str:
        """The key with its section, as it appears in messages."""
        return f"[{self.section}] {self.key}"

    @property
    def dotted(self) -> str:
        """The key as in `--set`: section, dot, name."""
        return f"{self.section}.{self.key}"


def with_typical_values(entries: Iterable[DraftKey]) -> Iterator[DraftKey]:
    """Yield the keys with typical values where only the user knows the value.

    An assumed unit or scale is marked in the run file, and the result is one with reservations.
    """
    marked = ""
    for entry in entries:
        if entry.value != UNKNOWN or not entry.typical:
            yield entry
            continue
        reason = entry.reason or f"assumed: {entry.ask}"
        yield replace(entry, value=entry.typical, reason=reason, assumed=True)
        if entry.key in ("unit", "scale") and entry.section != marked:
            marked, why = entry.section, "remove this line when you have checked the unit"
            yield DraftKey(entry.section, ASSUMED_UNIT, True, why)


def as_sections(entries: tuple[DraftKey, ...]) -> dict[str, Any]:
    """Return the sections of the run file, nested as a TOML parser returns them."""
    content: dict[str, Any] = {}
    for entry in entries:
        place = content
        for part in entry.section.split("."):
            place = place.setdefault(part, {})
        place[entry.key] = entry.value
    return content


def run_file_text(entries: tuple[DraftKey, ...], head: tuple[str, ...]) -> str:
    """Return the text of the run file with comments.

    Parameters
    ----------
    entries : tuple of DraftKey
    head : tuple of str
        Lines for the comment at the top.
    """
    lines = [f"# {line}".rstrip() for line in head]
    by_section: dict[str, list[DraftKey]] = {}
    for entry in entries:
        by_section.setdefault(entry.section, []).append(entry)
    for section, found in by_section.items():
        lines += ["", f"[{section}]"]
        for entry in found:
            text = f"{entry.key} = {_toml(entry.value)}"
            reason = "please state: " + entry.question if entry.value == UNKNOWN else entry.reason
            lines.append(f"{text}  # {' '.join(reason.split())}" if reason else text)
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    """Return a value as TOML text; it may be text, a number, true, false, or a list of these."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, cast(list[object], value))) + "]"
    text = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text) + '"'
