"""The long description of the package: README without what leads nowhere outside the repository.

A package index shows README alone. Its pictures and its links to files of the repository would be
dead there, and the project has no address in the web yet that could stand before them. Hatchling
calls the hook when it builds the metadata.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_FENCE = "```"
_ABSOLUTE = r"(?:https?:|mailto:)"
_PICTURE = re.compile(rf"!\[[^\]]*\]\((?!{_ABSOLUTE})[^)]*\)\n*")
_LINK = re.compile(rf"\[([^\]]*)\]\((?!{_ABSOLUTE})[^)]*\)")
_WHERE = (
    "\nThe pages and examples named here are in the source archive, in `docs` and `examples`.\n"
)


def long_description(readme: str) -> str:
    """Return README with its relative pictures left out and its relative links as plain text."""
    parts = re.split(rf"(^{_FENCE}.*?^{_FENCE}$)", readme, flags=re.MULTILINE | re.DOTALL)
    text = "".join(part if part.startswith(_FENCE) else _without_targets(part) for part in parts)
    return text.rstrip("\n") + "\n" + _WHERE


def _without_targets(text: str) -> str:
    return _LINK.sub(r"\1", _PICTURE.sub("", text))


class LongDescription(MetadataHookInterface):
    """States the long description as the readme of the metadata."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Write the readme, which pyproject.toml declares as dynamic."""
        readme = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": long_description(readme),
        }
