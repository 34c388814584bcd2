"""Lines in the terminal: a long one is cut, unless no other output holds it."""

import pytest

from inercal.cli.console import print_line

LONG = "x " * 2000 + "end"


@pytest.mark.parametrize("whole", [False, True])
def test_a_line_is_cut_unless_it_is_wanted_whole(capsys: pytest.CaptureFixture[str], whole: bool):
    print_line(LONG, whole=whole)
    printed = "".join(capsys.readouterr().out.split())
    assert printed.endswith("end") == whole
    assert (printed.count("x") == 2000) == whole
