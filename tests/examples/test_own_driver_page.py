"""The page of a driver of one's own says what the template and the program say."""

import re
from pathlib import Path

from inercal.host.driver_check import CHAMBER_CHECKS
from inercal.host.driver_check.checks import CHECKS
from inercal.host.drivers.rotary_table import RotaryTable
from inercal.host.drivers.table_address import DRIVERS
from inercal.host.equipment import CHAMBERS, INSTRUMENTS
from inercal.host.link import LINKS

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "own_driver"
TEXT = (ROOT / "docs" / "how-to" / "own-driver.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[str]:
    """Return the first cells of the table with this heading."""
    text = TEXT[TEXT.index(f"\n| {heading} |") :].partition("\n\n")[0]
    return [line.split(" | ")[0].removeprefix("| ") for line in text.strip().splitlines()[2:]]


def test_the_excerpts_are_those_of_the_template():
    source = "\n".join(path.read_text(encoding="utf-8") for path in FOLDER.iterdir())
    excerpts = re.findall(r"```(?:python|text)\n((?!  +spindle:).*?)```", TEXT, flags=re.S)
    assert len(excerpts) == 11
    for text in excerpts:
        assert text in source, text


def test_the_table_of_checks_is_complete():
    assert rows("check") == list(CHECKS)
    *own, shared = rows("check of a chamber")
    assert [*own, *shared.split(", ")] == list(CHAMBER_CHECKS)


def test_the_table_of_members_is_complete():
    members = {re.split(r"[`(]", cell)[1] for cell in rows("member")}
    assert members == {*RotaryTable.__annotations__, *RotaryTable.__abstractmethods__, "close"}


def test_the_groups_of_entry_points_are_those_of_the_registries():
    groups = [f"`{one.group}`" for one in (LINKS, INSTRUMENTS, CHAMBERS)]
    assert rows("group of entry points") == groups
    assert f'[project.entry-points."{DRIVERS.group}"]' in TEXT
