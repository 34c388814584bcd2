"""Run files of the estimators of norms: what a search is told, how it went, and a stated frame."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.calibration.files import load, save
from inercal.cli.app import main
from inercal.cli.console import generation_text
from inercal.methods.ship_multi_angle.norm_equations import (
    GOAL,
    Bounds,
    Generation,
    SearchHistory,
    SearchOptions,
)
from inercal.physics.sensors import G0
from inercal.pipeline import Outcome, calibrate
from inercal.report import write_report
from inercal.report.filter_figures import search_figure
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "rate_table"
NAME = 'name = "ship_multi_angle"\n'
SYMMETRIC = ('name = "model 12, midships"\n', 'name = "model 12"\nframe = "symmetric"\n')


def write_search_example(
    folder: Path, estimator: str, search: str = "", *changes: tuple[str, str]
) -> Path:
    """Return the example's run file with an estimator and what its search is told."""
    text = (EXAMPLE / "ship.toml").read_text(encoding="utf-8")
    section = f"\n[method.search]\n{search}\n" if search else ""
    for old, new in ((NAME, f'{NAME}estimator = "{estimator}"\n{section}'), *changes):
        assert old in text
        text = text.replace(old, new)
    (folder / "ship.csv").write_bytes((EXAMPLE / "ship.csv").read_bytes())
    path = folder / "ship.toml"
    path.write_text(text, encoding="utf-8")
    return path


def estimate_with_search(
    folder: Path, estimator: str, search: str = "", *changes: tuple[str, str]
) -> Outcome:
    return calibrate(write_search_example(folder, estimator, search, *changes))


@pytest.fixture(scope="module")
def estimated(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Outcome]:
    """Return `estimate_with_search` that computes each estimate once."""
    folder = tmp_path_factory.mktemp("searches")

    @cache
    def once(estimator: str, search: str = "", *changes: tuple[str, str]) -> Outcome:
        return estimate_with_search(folder, estimator, search, *changes)

    return once


# What a search is told


def test_without_a_section_a_search_has_the_defaults(tmp_path: Path):
    search = read(write_search_example(tmp_path, "global")).search
    assert search is not None
    assert search == SearchOptions(Bounds(bias=search.bounds.bias))
    assert search.bounds.bias == pytest.approx(Bounds().bias, rel=1e-12)
    assert search.goal == GOAL


def test_all_keys_reach_the_search(tmp_path: Path):
    text = (
        'seed = 7\ntime_limit = "1 min"\ngoal = "1 %"\nscale_error = "0.2"\ncross_axis = "30 %"\n'
    )
    search = read(write_search_example(tmp_path, "global", f'{text}bias = "4.903325 m/s²"')).search
    assert search is not None
    assert search.bounds.half_width == pytest.approx(Bounds(0.2, 0.3, 0.5).half_width)
    assert (search.seed, search.seconds, search.goal) == (7, 60.0, 0.01)


@pytest.mark.parametrize("estimator", ["joint", "planar", "planar_norm", "damped"])
def test_estimators_that_do_not_search_refuse_the_section(tmp_path: Path, estimator: str):
    with refused(key="[method.search]", file="ship.toml", names=(estimator,)) as no:
        read(write_search_example(tmp_path, estimator, "seed = 1"))
    assert "\n" not in str(no.value)


@pytest.mark.parametrize(
    ("search", "words"),
    [
        ("seed = -1", "[method.search] seed: -1"),
        ("seed = 1.5", "[method.search] seed: 1.5 is not a whole number"),
        ('seed = "abc"', "[method.search] seed: 'abc' is not a whole number"),
        ('time_limit = "-1 s"', "[method.search] time_limit: '-1 s' must be positive"),
        ('time_limit = "0 s"', "must be positive"),
        ('time_limit = "20 m"', "[method.search] time_limit: "),
        ("time_limit = 20", '20 is a number; give text with its unit, such as "20 s"'),
        ("goal = 5", '[method.search] goal: 5 is a number; give text with its unit, such as "5 %"'),
        ('goal = "abc"', "goal: 'abc' is not a finite number, such as '0.5' or '50 %'"),
        ('goal = "0 %"', "[method.search] goal: '0 %' must be positive"),
        ('goal = "100 %"', "[method.search] goal: '100 %' must be less than 100 %"),
        ('goal = "5 mg"', "[method.search] goal: "),
        ('scale_error = "-10 %"', "[method.search] scale_error: '-10 %' must be positive"),
        ('bias = "10 %"', "[method.search] bias: "),
        ("generations = 5", "unknown key method.search.generations; possible here: seed, time"),
    ],
)
def test_values_out_of_place_are_one_line_and_status_two(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    search: str,
    words: str,
):
    path = write_search_example(tmp_path, "global", search)
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(path), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as status:
        main()
    assert status.value.code == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.slow
def test_one_seed_makes_one_result_and_is_stated(tmp_path: Path, estimated: Callable[..., Outcome]):
    first = estimated("global", "seed = 3")
    again, other = (estimate_with_search(tmp_path, "global", f"seed = {seed}") for seed in (3, 4))
    assert (first.calibration.values == again.calibration.values).all()
    assert (first.calibration.values != other.calibration.values).all()
    assert "generations of seed 3" in " ".join(first.calibration.notes)
    conditions = first.calibration.conditions
    assert conditions["search"] == "seed 3, goal 5 %, at most 20 s"
    assert conditions["bounds of the search"] == "scale ±10 %, cross ±10 %, bias ±0.2 g"


@pytest.mark.slow
def test_the_goal_is_the_stated_one(tmp_path: Path):
    outcome = estimate_with_search(tmp_path, "global", 'goal = "0.01 %"')
    assert "goal of 0.01 %" in " ".join(outcome.verdict.statements)
    assert outcome.search is not None
    assert outcome.search.goal_generation is None


@pytest.mark.slow
def test_progress_is_reported_after_each_generation_and_stored(tmp_path: Path):
    seen: list[Generation] = []
    outcome = calibrate(write_search_example(tmp_path, "global", "seed = 1"), seen.append)
    assert outcome.search == SearchHistory(GOAL, tuple(seen))
    assert [g.number for g in seen] == list(range(1, len(seen) + 1))
    assert generation_text(Generation(12, 1.234e-5, 0.0123)) == (
        "generation 12, sum of squares 1.23e-05 g⁴, largest norm error 1.2 %"
    )


# Its history in the report


@pytest.mark.slow
def test_only_a_search_has_its_history_drawn(tmp_path: Path, estimated: Callable[..., Outcome]):
    assert estimated("damped").search is None
    for estimator, search in (("global", "seed = 3"), ("damped", "")):
        page = tmp_path / f"{estimator}.html"
        write_report(estimated(estimator, search), page)
        text = page.read_text(encoding="utf-8")
        assert ('id="search"' in text) == (estimator == "global")
        assert ("goal 5 %" in text) == (estimator == "global")
        assert "Each dot is the norm of the specific force on the bench" in text
        assert "degrees of freedom" in text
        assert "cannot be determined from these data" in text
        assert "rates of the table" in text


@pytest.mark.slow
def test_the_history_has_the_goal_and_the_generation_that_met_it():
    went = tuple(Generation(k, 10.0 ** (-k / 10), 0.2 * 0.99**k) for k in range(1, 250))
    text = str(search_figure(SearchHistory(0.05, went)))
    met = next(g.number for g in went if g.worst <= 0.05)
    assert f"met at generation {met}" in text
    assert "met at" not in str(search_figure(SearchHistory(0.001, went)))
    assert "$" not in text
    assert len(re.findall("<svg", str(search_figure(SearchHistory(0.05, went[:1]))))) == 1


# A stated frame


@pytest.mark.slow
def test_a_stated_frame_takes_the_place_of_what_norms_leave_free(
    tmp_path: Path, estimated: Callable[..., Outcome]
):
    outcomes = [estimated(name, "", SYMMETRIC) for name in ("damped", "global")]
    for outcome in outcomes:
        said = " ".join(outcome.verdict.statements)
        assert "the stated frame determines three" in said
        assert "rotation of the triad" not in said
        assert outcome.calibration.frame == "symmetric"
        file = save(outcome.calibration, tmp_path / "ship.calibration.json")
        assert load(file).frame == "symmetric"
    one, other = (outcome.calibration for outcome in outcomes)
    assert np.abs((one.values - other.values) / one.std).max() < 1e-6
    write_report(outcomes[0], tmp_path / "ship.html")
    plain = estimated("damped").calibration
    assert plain.frame == "mount"
    assert plain.in_frame("symmetric").values == pytest.approx(one.values, abs=1e-8)


def test_with_a_frame_the_tilted_states_do_alone(tmp_path: Path):
    whole = estimate_with_search(tmp_path, "damped", "", SYMMETRIC).calibration
    head, *rows = (tmp_path / "ship.csv").read_text(encoding="utf-8").splitlines()
    tilted = [row for row in rows if " " in row.partition(",")[0]]
    assert len(tilted) == 16
    (tmp_path / "ship.csv").write_text("\n".join([head, *tilted]) + "\n", encoding="utf-8")
    alone = calibrate(tmp_path / "ship.toml").calibration
    assert alone.values == pytest.approx(whole.values, rel=1e-12)


def test_joint_finds_the_same_in_that_frame(estimated: Callable[..., Outcome]):
    joint = estimated("joint").calibration.in_frame("symmetric")
    damped = estimated("damped", "", SYMMETRIC).calibration
    away = (joint.values - damped.values) / damped.std
    print(away.round(2), damped.std / joint.std)
    assert np.abs(away).max() < 3.5
    assert max(damped.uncertainty(f"a{axis}.k0") for axis in "xyz") < 8e-3 * G0


@pytest.mark.parametrize("estimator", ["joint", "planar", "planar_norm"])
def test_estimators_that_know_the_mounting_refuse_a_frame(tmp_path: Path, estimator: str):
    with refused(key="[sensor] frame", file="ship.toml", names=(estimator,)) as no:
        read(write_search_example(tmp_path, estimator, "", SYMMETRIC))
    assert "\n" not in str(no.value)
