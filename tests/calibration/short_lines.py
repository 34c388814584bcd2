"""What the lines of every verdict must be: few, short, and free of numbers like 3.1e+02."""

import re

from inercal.calibration.grade import Verdict

MOST_LINES, MOST_CHARACTERS = 6, 100
PASTED = re.compile(r"Next: .*set in the run file: \[")  # keys to paste may be long
KEY = re.compile(r"\[(?:sensor|bench|data|method|environment)[\w.]*\]|(?<!\w)--[a-z]|run file")


def require_short(verdict: Verdict) -> None:
    """Require at most six lines of at most 100 characters, and an explanation of all of them."""
    assert 1 <= len(verdict.lines) <= MOST_LINES, verdict.lines
    for line in verdict.lines:
        assert "\n" not in line
        assert len(line) <= MOST_CHARACTERS or PASTED.match(line), line
        assert not re.search(r"\d[.\d]*e\+?\d", line), line
        assert line.count("(") == line.count(")"), line
        assert not line.endswith("…."), line
    grade, _, reason = verdict.lines[0].partition(": ")
    assert grade.lower().startswith(verdict.word)
    assert reason, verdict.reasons
    headings = [one.heading for one in verdict.explanation]
    assert len(set(headings)) == len(headings)
    assert all(one.lines for one in verdict.explanation)
