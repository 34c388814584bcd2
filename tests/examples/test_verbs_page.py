"""The page of the verbs is that of the program."""

from tools.verbs_page import PAGE, verbs_page


def test_the_page_of_verbs_is_written_from_the_program_of_today():
    assert PAGE.read_text(encoding="utf-8") == verbs_page(), "run make verbs"
