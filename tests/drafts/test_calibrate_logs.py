"""`inercal calibrate LOG…` and `inercal.calibrate("log.csv")` draft and calibrate at once."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import generated_logs as logs
from tests.program import run_program

import inercal
from inercal.basics.errors import InputError
from inercal.basics.small_files import parse_toml

HEAD = ("t", "ax", "ay", "az", "gx", "gy", "gz")


def hand_held(folder: Path, seed: int = 3) -> Path:
    log = logs.by_hand(seed, hz=50.0)
    columns = [log["t"], *log["f"].T, *np.radians(log["w"]).T]
    return logs.write(folder / "imu.csv", HEAD, columns)


def six_rests(folder: Path) -> Path:
    """Write a log without turns between the rests, so that nothing confirms the gyros' unit."""
    force, _ = logs.six_faces(1, 20.0)
    rate = np.random.default_rng(0).normal([0.5, -0.3, 0.2], 0.05, force.shape)
    return logs.write(folder / "six.csv", HEAD, [np.arange(len(force)) / 50, *force.T, *rate.T])


def values(path: Path) -> dict[str, float]:
    found = inercal.load(path)
    return dict(zip(found.sensor.coefficients, found.values.tolist(), strict=True))


@pytest.mark.slow
def test_a_log_gives_what_init_and_calibrate_give(tmp_path: Path):
    log = hand_held(tmp_path)
    run_file, two, one = tmp_path / "two" / "imu.toml", tmp_path / "two", tmp_path / "one"
    assert run_program("init", log, "-o", run_file, "--yes").status == 0
    assert run_program("calibrate", run_file, "-o", two, "--no-report").status == 0
    done = run_program("calibrate", log, "-o", one, "--no-report", "--json")
    assert done.status == 0, done.error
    found: dict[str, Any] = json.loads(done.output)
    assert Path(found["run_file"]) == one / "imu.toml"
    (assumed,) = found["assumptions"]  # no test of the data can contradict it
    assert assumed.startswith("assumed: [bench] timebase = 100 ppm")
    assert (one / "imu.toml").read_text("utf-8") == run_file.read_text("utf-8")
    names = "imu.calibration.json"
    assert values(one / names) == values(two / names)
    outcome = inercal.calibrate(log)
    calibration = outcome.calibration
    found_values = dict(zip(calibration.sensor.coefficients, calibration.values, strict=True))
    assert found_values == pytest.approx(values(one / names), rel=1e-12, abs=1e-15)
    assert outcome.verdict.grade == "consistent"


@pytest.mark.slow
def test_an_assumed_unit_is_told_and_gives_reservations(tmp_path: Path):
    log, key = six_rests(tmp_path), "sensor.gyro.unit"
    refused = run_program("calibrate", log, "-o", tmp_path / "refused")
    assert refused.status == 2
    assert key in refused.error
    assert not (tmp_path / "refused").exists()
    with pytest.raises(InputError) as error:
        inercal.calibrate(log)
    assert error.value.names == (key,)

    assumed = run_program("calibrate", log, "-o", tmp_path / "assumed", "--yes", "--no-report")
    stated = run_program(
        "calibrate", log, "-o", tmp_path / "stated", "--set", f"{key}=°/s", "--no-report"
    )
    assert (assumed.status, stated.status) == (0, 0)
    assert "[sensor.gyro] unit = °/s" in assumed.output.splitlines()[0]
    name = "six.calibration.json"
    assert values(tmp_path / "assumed" / name) == values(tmp_path / "stated" / name)
    first, second = (inercal.load(tmp_path / one / name) for one in ("assumed", "stated"))
    assert first.verdict is not None
    assert second.verdict is not None
    assert (first.verdict.grade, second.verdict.grade) == ("reservations", "consistent")
    run_file = tmp_path / "assumed" / "six.toml"
    assert parse_toml(run_file.read_bytes())["sensor"]["gyro"]["unit_assumed"] is True
    outcome = inercal.calibrate(log, sensor={"gyro": {"unit": "°/s"}})
    assert outcome.verdict.grade == "consistent"


@pytest.mark.slow
def test_answers_in_a_terminal_are_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from inercal.cli import log_drafts

    class Terminal:
        def isatty(self) -> bool:
            return True

    asked: list[str] = []

    def answer(prompt: str) -> str:
        asked.append(prompt)
        return "rad/s"

    monkeypatch.setattr(log_drafts.sys, "stdin", Terminal())
    monkeypatch.setattr(log_drafts.sys, "stdout", Terminal())
    monkeypatch.setattr("builtins.input", answer)
    draft = log_drafts.draft_logs([six_rests(tmp_path)], tmp_path / "six.toml", (), yes=False)
    assert len(asked) == 1
    assert {one.dotted: one.value for one in draft.entries}["sensor.gyro.unit"] == "rad/s"
    assert "sensor.gyro.unit_assumed" not in {one.dotted for one in draft.entries}
    monkeypatch.setattr("builtins.input", lambda _: "")
    draft = log_drafts.draft_logs([tmp_path / "six.csv"], tmp_path / "six.toml", (), yes=False)
    assert {one.dotted: one.value for one in draft.entries}["sensor.gyro.unit_assumed"] is True


def means(folder: Path) -> Path:
    return logs.write(folder / "poses.csv", ("ax", "ay", "az"), [*logs.poses(3, 20).T])


@pytest.mark.slow
def test_stated_values_stay_and_a_key_of_the_method_replaces_the_drafted_one(tmp_path: Path):
    place = {"latitude": "48.1 °", "height": "520 m"}
    stated = [text for key, one in place.items() for text in ("--set", f"bench.{key}={one}")]
    stated += ["--set", 'method.also=["k2"]', "--no-report"]
    done = run_program("calibrate", means(tmp_path), "-o", tmp_path, *stated)
    assert done.status == 0, done.error
    assert "ax.k2" in values(tmp_path / "poses.calibration.json")
    drafted = parse_toml((tmp_path / "poses.toml").read_bytes())
    assert drafted["bench"] | place == drafted["bench"]
    assert drafted["method"]["also"] == ["k2"]


@pytest.mark.slow
def test_a_run_file_of_before_is_kept(tmp_path: Path):
    log = means(tmp_path)
    kept = tmp_path / "poses.toml"
    kept.write_text("# mine\n", encoding="utf-8")
    refused = run_program("calibrate", log, "-o", tmp_path)
    assert refused.status == 2
    assert kept.read_text("utf-8") == "# mine\n"
    assert run_program("calibrate", log, "-o", tmp_path, "--force", "--no-report").status == 0
    assert values(tmp_path / "poses.calibration.json")


@pytest.mark.parametrize(
    "arguments",
    [("a.csv", "run.toml"), ("run.toml", "--yes"), ("run.toml", "--set", "data.rate=1")],
)
def test_run_files_and_logs_do_not_mix(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    refused = run_program("calibrate", *arguments)
    assert refused.status == 2
    assert "run.toml" in refused.error
    assert not list(tmp_path.iterdir())
