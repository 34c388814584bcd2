"""What a bad input is: a command, changes to good files, and words that the line must hold."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from inercal.calibration.files import canonical_text

Change = bytes | str | Callable[[str], str | bytes]


@dataclass(frozen=True)
class BadInput:
    """A command that must be refused.

    Parameters
    ----------
    command : str or tuple of str
        A text is split at its spaces. "@name" is a file of the folder, "@" the folder.
    words : tuple of str
        What the line on standard error holds: the file or key at fault, and what is wrong.
    files : dict of str to Change
        Files to write before: their content, or a function of the text that is there.
    """

    command: str | tuple[str, ...]
    words: tuple[str, ...]
    files: dict[str, Change] = field(default_factory=dict[str, Change])


def swap(old: str, new: str) -> Callable[[str], str]:
    """Replace a part of a text, which must be there."""

    def change(text: str) -> str:
        assert old in text, old
        return text.replace(old, new, 1)

    return change


def each_row(change: Callable[[int, list[str]], list[str]]) -> Callable[[str], str]:
    """Change the cells of each row below the header of a table; rows count from 0."""

    def changed(text: str) -> str:
        header, *rows = text.splitlines()
        made = [",".join(change(k, row.split(","))) for k, row in enumerate(rows)]
        return "\n".join([header, *made, ""])

    return changed


def rehashed(change: Callable[[dict[str, Any]], object]) -> Callable[[str], str]:
    """Change a calibration file as a program does that also writes its hash."""

    def changed(text: str) -> str:
        content = json.loads(text)
        change(content)
        content.pop("sha256")
        content["sha256"] = hashlib.sha256(canonical_text(content).encode()).hexdigest()
        return json.dumps(content)

    return changed
