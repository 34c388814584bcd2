"""The page of the verbs is that of the program."""

import re

from tools.verbs_page import PAGE, verbs_page


def test_the_page_of_verbs_is_written_from_the_program_of_today():
    assert PAGE.read_text(encoding="utf-8") == verbs_page(), "run make verbs"


def test_each_row_has_three_cells():
    rows = [line for line in verbs_page().splitlines() if line.startswith("|")]
    assert {len(re.split(r"(?<!\\)\|", row)) - 2 for row in rows} == {3}
