"""The page of a worksheet: whole, self-contained, and with a box for each reading."""

import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from inercal.pipeline.design.worksheet import Worksheet, build_worksheet
from inercal.report import write_worksheet
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "dividing_head" / "pair.toml"
READ = ('angle = "angle"', 'angle = "angle"\nautocollimator = "ac"\nlevel = "lv"')
PAIRS = ('autocollimation = "every"', 'autocollimation = "pairs"')


class Boxes(HTMLParser):
    """Counts the boxes of each kind, and checks that elements close in order."""

    def __init__(self, text: str):
        super().__init__()
        self.open: list[str] = []
        self.boxes: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]):
        if tag != "meta":
            self.open.append(tag)
        self.boxes += [value for name, value in attrs if value and name == "class" and tag == "td"]

    def handle_endtag(self, tag: str):
        assert self.open.pop() == tag


def made(folder: Path, *changes: tuple[str, str]) -> tuple[Worksheet, str]:
    path = Path(shutil.copy(EXAMPLE, folder / "run.toml"))
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    sheet = build_worksheet(read(path))
    page = write_worksheet(sheet, folder / "page.html", "readings.csv")
    return sheet, page.read_text(encoding="utf-8")


def test_each_reading_has_a_box_and_what_is_not_read_a_shaded_one(tmp_path: Path):
    _, text = made(tmp_path, READ, PAIRS)
    boxes = Boxes(text).boxes
    # Two accelerometers and the level at 24 positions, the autocollimator at the eight of pairs.
    assert boxes.count("box") == 24 * 3 + 8
    assert boxes.count("box not") == 16


def test_on_paper_a_box_or_a_heading_takes_the_place_of_what_the_terminal_repeats(tmp_path: Path):
    sheet, text = made(tmp_path, READ, PAIRS)
    printed = [heading.text for heading in sheet.sheet.headings]
    assert printed == ["row", "label", "head at", "pass", "autocollimator", "level", "hold for"]
    headings = re.findall(r'<th scope="col">([^<]*)</th>', text[: text.index("<tbody")])
    assert headings == ["row", "label", "head at", "with the autocollimator", "hold"]
    wrapped = re.findall(r'<td class="do">([^<]*)</td>', text)
    assert wrapped == [row.facts["autocollimator"] for row in sheet.sheet.rows]


def test_the_shaded_box_is_the_autocollimators_whatever_a_column_is_called(tmp_path: Path):
    columns = ('["a", "b"]', '["autocollimator", "b"]')
    _, text = made(tmp_path, READ, PAIRS, columns)
    second = text[text.index('<th scope="row">f02</th>') :]
    assert re.findall(r'class="(box[^"]*)"', second)[:4] == ["box", "box", "box not", "box"]


def test_without_autocollimator_and_level_there_is_no_box_for_them(tmp_path: Path):
    none = ('autocollimation = "every"', 'autocollimation = "none"')
    idle = (f"{key}\n" for key in ('autocollimator = "0.1 ″"', 'certificate = "0.05 ″"'))
    _, text = made(tmp_path, none, *((line, "") for line in idle))
    assert Boxes(text).boxes.count("box") == 24 * 2
    assert "with the autocollimator" not in text


def test_the_page_holds_what_the_operator_needs(tmp_path: Path):
    sheet, text = made(tmp_path, READ)
    for words in ("QA pair 7", "operator", "temperature, start", "readings.csv", "run.toml"):
        assert words in text
    for number, row in enumerate(sheet.sheet.rows, start=1):
        angle = f"{row.facts['angle_deg']:.0f}°"
        assert f'<td>{number}</td><th scope="row">{row.label}</th><td>{angle}</td>' in text
    for one in (*sheet.expected, *sheet.together):
        assert f'<th scope="row">{one.name}</th>' in text
    assert text.index("pass 1, forward") < text.index("pass 2, reverse")
    assert "24 positions in 2 passes · 12 min of holding, plus moves" in text
    assert "the noise, the head, the base and the priors stated in" in text


def test_the_page_needs_nothing_but_itself_and_prints_black_on_white(tmp_path: Path):
    _, text = made(tmp_path, READ)
    for word in ("http:", "https:", "src=", "<link", "<script", "url("):
        assert word not in text
    assert "@page { size: A4" in text
    printed = text[text.rindex("@media print") :]
    assert "--ink: #000000" in printed
    assert "--paper: #ffffff" in printed


@pytest.mark.parametrize("name", ["<b>7</b>", "{{ 7 }}"])
def test_names_are_text(tmp_path: Path, name: str):
    _, text = made(tmp_path, ('"QA pair 7"', f'"{name}"'))
    assert f"<h1>{name.replace('<', '&lt;').replace('>', '&gt;')}</h1>" in text
