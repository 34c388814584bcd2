"""`init` of readings that no sensor gives: one line, with the place."""

from pathlib import Path

import numpy as np
import pytest
from tests import generated_logs as logs
from tests.refusals import refused

from inercal.pipeline.drafts import draft_run_file

MEANS = "position,ax,ay,az\n" + "".join(
    f"{name},{x},{y},{z}\n"
    for name, x, y, z in (
        ("+x", 1, 0, 0), ("-x", -1, 0, 0), ("+y", 0, 1, 0), ("-y", 0, -1, 0), ("+z", 0, 0, 1),
        ("-z", 0, 0, -1),
    )
)  # fmt: skip


@pytest.mark.parametrize("cell", ["", "nan", "inf", "1e160", "-1e101"])
def test_a_mean_that_is_missing_or_absurd_is_named(tmp_path: Path, cell: str):
    path = tmp_path / "means.csv"
    path.write_text(MEANS.replace("+y,0,1,0", f"+y,0,{cell},0"))
    with refused(file=path, names=("ay",)) as caught:
        draft_run_file([path], tmp_path / "run.toml")
    assert caught.value.line == 4


@pytest.mark.parametrize("size", [0.0, 1e200])
def test_a_sensor_that_is_dead_or_overflows_is_refused(tmp_path: Path, size: float):
    path = tmp_path / "log.csv"
    data = size * np.random.default_rng(1).normal(size=(2000, 6))
    rows = np.column_stack([np.arange(2000) / 100, data])
    np.savetxt(path, rows, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
    with refused(file=path):
        draft_run_file([path], tmp_path / "run.toml")


def test_means_of_a_dead_sensor_are_refused(tmp_path: Path):
    path = tmp_path / "means.csv"
    path.write_text(MEANS.replace("1", "0"))
    with refused(file=path, key="data.accelerometer"):
        draft_run_file([path], tmp_path / "run.toml")


def by_hand(folder: Path, **more: list[str]) -> Path:
    log = logs.by_hand(5, rests=9, hz=50.0)
    columns = {"t": log["t"], **dict(zip(("ax", "ay", "az"), log["f"].T, strict=True)), **more}
    return logs.write(folder / "log.csv", list(columns), list(columns.values()))


@pytest.mark.parametrize("cell", ["inf", "-inf", "1e300", "nan"])
@pytest.mark.parametrize("share", [1, 3])
def test_a_column_that_nobody_uses_may_contain_any_number(tmp_path: Path, cell: str, share: int):
    rows = len(logs.by_hand(5, rests=9, hz=50.0)["t"])
    more = [cell if k % share == 0 else str(k % 7) for k in range(rows)]
    draft = draft_run_file([by_hand(tmp_path, spare=more)], tmp_path / "run.toml")
    assert draft.method is not None
    assert draft.method.name == "multi_position"


def test_times_of_text_may_state_a_zone(tmp_path: Path):
    log = logs.by_hand(5, rests=9, hz=50.0)
    seconds = (log["t"] + 7).tolist()
    times = [f"2026-11-29T12:{int(t) // 60:02d}:{t % 60:05.2f}+01:00" for t in seconds]
    columns = [times, *log["f"].T]
    path = logs.write(tmp_path / "log.csv", ("timestamp", "ax", "ay", "az"), columns)
    draft = draft_run_file([path], tmp_path / "run.toml")
    assert draft.time is not None
    np.testing.assert_allclose(draft.time, log["t"], atol=1e-6)


def test_times_of_text_that_stand_still_are_not_used(tmp_path: Path):
    log = logs.by_hand(5, rests=9, hz=50.0)
    columns = [["2026-11-29T12:00:00Z"] * len(log["t"]), *log["f"].T]
    path = logs.write(tmp_path / "log.csv", ("timestamp", "ax", "ay", "az"), columns)
    (question,) = draft_run_file([path], tmp_path / "run.toml").questions
    assert question.dotted == "data.rate"
    assert "timestamp" in question.ask


@pytest.mark.parametrize("extra", [("angle",), ("rpm",)])
def test_a_dead_sensor_on_a_bench_is_refused(tmp_path: Path, extra: tuple[str, ...]):
    path = tmp_path / "means.csv"
    rows = [f"{10 * k},0,0,0" for k in range(1, 13)]
    path.write_text("\n".join([",".join((*extra, "ax", "ay", "az")), *rows]) + "\n")
    with refused(file=path):
        draft_run_file([path], tmp_path / "run.toml")


def test_an_arm_that_never_turns_is_refused(tmp_path: Path):
    path = tmp_path / "means.csv"
    rows = [f"0,{k % 2},{k % 3},1" for k in range(12)]
    path.write_text("\n".join(["rpm,ax,ay,az", *rows]) + "\n")
    with refused(file=path, key="data.arm_rate"):
        draft_run_file([path], tmp_path / "run.toml")
