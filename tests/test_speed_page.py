"""The page of speeds says what was measured, and what was missed."""

from benchmarks import Duration, Row, Skipped
from benchmarks._page import speed_page


def test_the_page_has_a_line_of_each_row_and_says_what_is_missed():
    rows = [
        Row("fast work", Duration(0.5, 0.5, 0.9), 1.0, "another", to_reach=1.7),
        Row("slow work", 2.0, 1.0, "limit", "GB"),
        Skipped("no work", "no data"),
    ]
    text = speed_page({"processor": "abacus", "commit": "0123abc"}, rows)
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|")
    ]
    by_name = {cells[0]: cells[1:] for cells in lines}
    assert by_name["processor"] == ["abacus"]
    assert by_name["commit"] == ["0123abc"]
    assert by_name["fast work"] == ["0.5 s", "0.5 s", "0.9 s", "another: 1 s", "2", "1.7", "yes"]
    assert by_name["slow work"] == ["2 GB", "", "", "limit: 1 GB", "0.5", "1", "**missed**"]
    assert by_name["no work"][-1] == "not measured: no data"
    assert len({len(cells) for cells in lines[4:]}) == 1
    assert "1 of 2 figures" in text
