"""One text of each family of messages, compared with the text on file and held to its form.

`CASES` of each module here raises the errors, given an empty folder; `<module>.toml` has the texts.
"""

import re
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from tests.test_glossary import BANNED

from inercal.basics.errors import InercalError

FOLDER = Path(__file__).parent
PARTS = sorted(one.stem for one in FOLDER.glob("*.py") if not one.stem.startswith(("_", "test_")))
CASES: dict[str, dict[str, Callable[[Path], object]]] = {
    part: import_module(f"tests.messages.{part}").CASES for part in PARTS
}
TEXTS: dict[str, dict[str, str]] = {
    part: tomllib.loads((FOLDER / f"{part}.toml").read_text(encoding="utf-8")) for part in PARTS
}
LONGEST = 300  # characters: three lines of a terminal
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|\{folder\}\S*")


@pytest.mark.parametrize("part", PARTS)
def test_every_family_has_its_text_and_every_text_its_family(part: str):
    assert sorted(TEXTS[part]) == sorted(CASES[part])


@pytest.mark.parametrize(
    ("part", "family"), [(part, family) for part in PARTS for family in CASES[part]]
)
def test_a_message_is_the_text_on_file_one_plain_line(part: str, family: str, tmp_path: Path):
    with pytest.raises(InercalError) as refusal:
        CASES[part][family](tmp_path)
    message = str(refusal.value).replace(str(tmp_path), "{folder}")
    assert message == TEXTS[part].get(family)
    assert message.isprintable()
    assert len(message) <= LONGEST
    words = set(re.findall(r"[a-z]+", QUOTED.sub("", message).lower()))
    assert not words & (BANNED | {"felt", "told", "asked"})
