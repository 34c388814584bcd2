"""Write the page of the verbs from the program: ``python -m tools.verbs_page``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer.main

from inercal.cli.app import app

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "verbs.md"
_HEAD = """\
# Verbs

What `inercal VERB --help` prints, of all verbs: written from the program by `make verbs`. A
quantity has its unit, such as `"2 g"`. What a verb returns to the shell is on the page of
[exit statuses](exit-status.md).
"""


def verbs_page() -> str:
    """Return the page: each verb with its help, its arguments and its options."""
    parts = [_HEAD]
    for path, command in _commands(typer.main.get_command(app), ["inercal"]):
        lines = [f"## {' '.join(path)}", "", _plain(command.help), ""]
        shown = [one for one in command.params if not one.hidden and one.name != "help"]
        lines += ["| argument or option | default | meaning |", "|---|---|---|"]
        lines += [f"| {_form(one)} | {_default(one)} | {_plain(one.help)} |" for one in shown]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _commands(command: Any, path: list[str]) -> Iterator[tuple[list[str], Any]]:
    groups = getattr(command, "commands", None)
    if not groups:
        yield path, command
        return
    for name, one in groups.items():
        yield from _commands(one, [*path, name])


def _plain(text: str | None) -> str:
    """Return help on one line, for a cell of a table."""
    return " ".join((text or "").replace("\\[", "[").split()).replace("|", "\\|")


def _form(one: Any) -> str:
    """Return how a parameter is written: all names, then its value."""
    if one.param_type_name == "argument":
        name = (one.metavar or one.name).upper().rstrip("…").replace("|", "\\|")
        return f"`{name}`" if one.nargs == 1 else f"`{name} …`"
    value = "" if one.is_flag else f" {one.metavar or one.name.upper()}"
    names = [*one.opts, *one.secondary_opts]
    more = ", repeatable" if one.multiple else ""
    return ", ".join(f"`{name}{value}`".replace("|", "\\|") for name in names) + more


def _default(one: Any) -> str:
    if one.required:
        return "required"
    if one.default is True:
        return f"`{one.opts[0]}`"
    without = one.default is None or one.default is False or one.default == [] or one.default == ""
    return "" if without or callable(one.default) else f"`{one.default}`"


if __name__ == "__main__":
    PAGE.write_text(verbs_page(), encoding="utf-8")
    print(f"wrote {PAGE.name}")
