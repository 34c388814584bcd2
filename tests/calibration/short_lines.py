"""What the lines of every verdict must be: few, short, and free of numbers like 3.1e+02."""

import re
import tomllib

from inercal.basics.run_file_advice import Change
from inercal.calibration.grade import Verdict

MOST_LINES, MOST_CHARACTERS = 6, 100
PASTED = re.compile(r"Next: .*set in the run file: \[")  # keys to paste may be long
KEY = re.compile(r"\[(?:sensor|bench|data|method|environment)[\w.]*\]|(?<!\w)--[a-z]|run file")


def require_toml(text: str, changes: tuple[Change, ...]) -> None:
    """Require that keys to paste, each on a line below its section, state exactly these changes."""
    pasted = re.sub(r" and (?=\[[a-z.]+\] )", "\n", text.partition("run file: ")[2])
    found: dict[str, object] = {}
    for line in pasted.splitlines():
        section, key = re.fullmatch(r"\[([a-z.]+)\] (.*)", line).groups()  # pyright: ignore[reportOptionalMemberAccess]
        found |= {f"{section}: {name}": value for name, value in tomllib.loads(key).items()}
    assert found == {
        f"{one.section}: {one.key}": list(one.value) if isinstance(one.value, tuple) else one.value
        for one in changes
    }


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
