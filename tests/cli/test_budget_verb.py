"""`inercal budget`: what it writes and prints, and what it refuses."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.cli.app import main

SHIP = Path(__file__).parents[2] / "examples" / "rate_table" / "ship.toml"
HAND_HELD = ('name = "six_position"\nseconds = "4 s"', 'name = "multi_position"')


Program = Callable[..., tuple[int, str, str]]


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run the program within this process; return its status, its output and its errors."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["inercal", "budget", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        return int(stop.value.code or 0), printed.out, printed.err

    return run


@pytest.mark.slow
def test_tables_a_page_and_an_object(tmp_path: Path, program: Program):
    path = run_file(tmp_path, SIX_POSITIONS)
    status, printed, errors = program(path, "--trials", "40", "--out", tmp_path)
    assert (status, errors) == (0, "")
    assert {p.name for p in tmp_path.iterdir()} == {
        "run.toml",
        "run.budget.json",
        "run.budget.html",
    }
    assert "ax.k1" in printed
    assert "gravity" in printed
    page = (tmp_path / "run.budget.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert "var(--minus)" in page
    content = json.loads((tmp_path / "run.budget.json").read_text(encoding="utf-8"))
    status, printed, _ = program(path, "--trials", "40", "--out", tmp_path, "--json")
    same = json.loads(printed)
    assert same.pop("page") == str(tmp_path / "run.budget.html")
    assert same.pop("budget_file") == str(tmp_path / "run.budget.json")
    assert same == content
    assert content["schema"] == "inercal budget 1"
    assert (content["method"], content["estimator"]) == ("six_position", "ml")
    k1 = next(c for c in content["coefficients"] if c["name"] == "ax.k1")
    gravity = next(x for x in k1["contributions"] if x["name"] == "gravity")
    assert gravity["first_order"] == pytest.approx(2e-4 / 9.81, rel=1e-3)
    sizes = [x["monte_carlo"] for x in k1["contributions"]]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize(
    ("changes", "options", "where"),
    [
        ((), ("--trials", "1"), "--trials 1"),
        ((), ("--seed", "-1"), "--seed -1"),
        ((), ("--workers", "0"), "--workers 0"),
        ((), ("--out", "/dev/null"), "/dev/null"),
        ((HAND_HELD, ('tilt = "0.3 °"\n', "")), (), "multi_position"),
        ((('white = "100 µg/√Hz"\n', ""),), (), "[sensor.accelerometer] white"),
        ((('name = "six_position"', 'name = "seven"'),), (), "'seven'"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_writes_nothing(
    tmp_path: Path,
    program: Program,
    changes: tuple[tuple[str, str], ...],
    options: tuple[str, ...],
    where: str,
):
    path = run_file(tmp_path, SIX_POSITIONS, *changes)
    status, printed, errors = program(path, "--out", tmp_path, *options)
    assert (status, printed) == (2, "")
    assert where in errors
    assert errors.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["run.toml"]


def test_a_search_is_refused_in_the_place_of_hours(tmp_path: Path, program: Program):
    text = SHIP.read_text(encoding="utf-8") + 'estimator = "global"\n'
    (tmp_path / "ship.toml").write_text(text, encoding="utf-8")
    status, printed, errors = program(tmp_path / "ship.toml", "--out", tmp_path)
    assert (status, printed) == (2, "")
    assert "global" in errors
    assert "damped" in errors
    assert errors.count("\n") == 1


def test_no_run_file_is_one_line(tmp_path: Path, program: Program):
    status, _, errors = program(tmp_path / "none.toml", "--out", tmp_path)
    assert (status, errors.count("\n")) == (2, 1)
    assert str(tmp_path / "none.toml") in errors
