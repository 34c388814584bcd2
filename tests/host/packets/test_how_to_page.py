"""The how-to page says what the code says, and its example runs."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.host.packets.test_descriptions import GOOD

from inercal.basics.errors import InputError
from inercal.host.packets import PRESETS, Flag, parse_layout, read_layout
from inercal.host.packets.checksums import CHECKS
from inercal.host.packets.description import KEYS
from inercal.host.packets.packet_format import ROLES

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "how-to" / "imu-packets.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "bench" / "packets.toml"


def rows(cells: int) -> Iterator[list[str]]:
    """Return the rows of the tables of so many columns."""
    for line in PAGE.splitlines():
        row = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(row) == cells:
            yield row


def test_the_page_shows_the_example_and_its_snippet_prints_what_the_page_says(
    capsys: pytest.CaptureFixture[str],
):
    assert EXAMPLE.read_text(encoding="utf-8") in PAGE
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)
    exec(snippet.replace("examples/bench/packets.toml", EXAMPLE.as_posix()), {})
    assert f"```text\n{capsys.readouterr().out}```" in PAGE


def test_the_page_lists_every_preset_with_its_protection():
    listed = {row[0].strip("`"): row[2] for row in rows(3) if row[0].strip("`") in PRESETS}
    assert listed == {name: read_layout(name).protection for name in PRESETS}


def test_the_page_lists_every_flag():
    listed = {row[0].strip("`"): row[1] for row in rows(3) if row[1].isdigit()}
    assert listed == {str(flag.name): str(flag.value) for flag in Flag}


def test_the_page_names_every_key_role_and_check():
    keys, section = dict[str, set[str]](), ""
    for row in rows(4):
        if row[1] == "key":
            section = ""
        elif row[0].startswith("`"):
            section = row[0].strip("`[]")
        if row[1].startswith("`"):
            keys.setdefault(section, set()).add(row[1].strip("`"))
    of_sections = {name: set(KEYS[name]) for name in KEYS if name not in ("", "frame")}
    assert keys == of_sections | {"": {"about", "byte_order", "rate"}}
    assert all(f"`{name}`" in PAGE for name in (*ROLES, *CHECKS))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("zero", "offset"),
        ("length = 11", "length = 12"),
        ("1 mg", "1 mm"),
        ("crc16-xmodem", "crc17"),
    ],
)
def test_the_page_quotes_what_is_said(old: str, new: str):
    with pytest.raises(InputError) as refused:
        parse_layout(GOOD.replace(old, new), "own.toml")
    assert f"`{refused.value}`" in PAGE
