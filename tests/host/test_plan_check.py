"""A plan whose recording the method would refuse is refused before anything moves."""

from pathlib import Path

import pytest
from tests.host.simulated_runs import SHORT, plan, quick
from tests.host.watched_runs import ADDRESSES
from tests.program import run_program
from tests.refusals import refused

from inercal.host.preparation import check_plan


@pytest.mark.parametrize("seconds", ["6", "19.7"])
def test_a_first_rest_below_twenty_seconds_is_refused(tmp_path: Path, seconds: str):
    path = quick().replace("0,0,0,30", f"0,0,0,{seconds}")
    with refused(key="[method] path", names=("warm-up",)):
        check_plan(plan(tmp_path, path))


def test_a_plan_that_determines_all_coefficients_passes_without_a_word(tmp_path: Path):
    assert check_plan(plan(tmp_path, quick().replace("0,0,0,30", "0,0,0,20"))) == ()


def test_what_a_plan_does_not_determine_is_said_beforehand(tmp_path: Path):
    (words,) = check_plan(plan(tmp_path, SHORT))
    assert "does not determine" in words
    assert "ax.k1" in words


def test_a_run_of_a_plan_that_is_refused_asks_for_no_device_and_leaves_no_folder(tmp_path: Path):
    run = plan(tmp_path / "plan", SHORT.replace("0,0,0,22", "0,0,0,12"))
    table, imu, _ = ADDRESSES  # nobody is there
    ended = run_program(
        "bench", "run", run.path, "--table", table, "--imu", imu, "--out", tmp_path / "run"
    )
    assert ended.status == 2
    assert "warm-up, a rest of 12 s" in ended.error
    assert not (tmp_path / "run").exists()
