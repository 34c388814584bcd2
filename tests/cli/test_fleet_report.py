"""`inercal fleet report`: what it prints and writes, and what it refuses."""

import json
from pathlib import Path

import pytest
from tests.fleet.simulated_line import Truth, write_line
from tests.program import run_program


@pytest.mark.slow
def test_page_and_summary(tmp_path: Path):
    write_line(tmp_path / "line", 100, Truth(outliers=1, lot_size=50))
    ended = run_program("fleet", "report", tmp_path / "line")
    assert ended.status == 0
    assert "100 sensors" in ended.output
    assert "S000000" in ended.output  # the outlier
    html = (tmp_path / "line" / "report.html").read_text(encoding="utf-8")
    assert "<h1>line</h1>" in html
    assert "S000000" in html
    assert run_program("fleet", "report", tmp_path / "line").status == 0  # in its place


def test_json_alone_writes_no_page(tmp_path: Path):
    write_line(tmp_path, 40)
    ended = run_program("fleet", "report", tmp_path, "--json")
    content = json.loads(ended.output)
    assert content["sensors"] == 40
    assert content["yield"][0]["rule"] == "guarded"
    assert not (tmp_path / "report.html").exists()


def test_a_page_takes_the_place_of_a_page_alone(tmp_path: Path):
    write_line(tmp_path, 40)
    page = tmp_path / "notes.txt"
    page.write_text("mine", encoding="utf-8")
    assert run_program("fleet", "report", tmp_path, "--out", page).status == 2
    assert page.read_text(encoding="utf-8") == "mine"


def test_a_line_without_results_is_refused(tmp_path: Path):
    line = write_line(tmp_path, 20)
    for part in (line.folder / "fleet").iterdir():
        part.unlink()
    ended = run_program("fleet", "report", tmp_path)
    assert ended.status == 2
    assert "no calibrated sensor" in ended.error
