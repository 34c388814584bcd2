"""A draft states the defaults of the bench that act, and `show` their values."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from tests.program import run_program

from inercal.pipeline.drafts.stated_keys import default_bench_keys


def found(content: dict[str, Any], method: str) -> dict[str, Any]:
    return {one.key: one.value for one in default_bench_keys(content, method)}


def hand(**bench: str) -> dict[str, Any]:
    return {"sensor": {"accelerometer": {}, "gyro": {}}, "bench": bench, "data": {}}


def test_turns_of_ferraris_have_their_defaults():
    assert found(hand(gravity="9.8 m/s²"), "ferraris") == {
        "tilt": "0.5 °",
        "turn_angle": "1 °",
        "turn_tilt": "0.5 °",
        "timebase": "100 ppm",
    }


def test_a_stated_key_and_one_that_changes_nothing_are_left_out():
    assert "tilt" not in found(hand(tilt="0.1 °"), "ferraris")
    assert "tilt" not in found(hand(), "multi_position")
    assert "turn_angle" not in found(hand(), "six_position")


def test_other_benches_state_theirs_and_no_unknown_value_hinders_it():
    content = {"sensor": {"gyro": {}}, "bench": {"kind": "turntable", "latitude": "?"}, "data": {}}
    assert found(content, "turntable_kalman")["lean"] == "5 ″"
    content = {"sensor": {}, "bench": {"kind": "centrifuge", "radius": "?"}, "data": {}}
    keys = found(content, "centrifuge_norm")
    assert keys["tilt"] == "2 ″"
    assert "lean" not in keys  # a locked platform
    assert "dwell_tilt" not in keys  # zero


def means(folder: Path) -> Path:
    path = folder / "means.csv"
    rows = ["label,ax,ay,az", "x_p,9.83,0.01,0.02", "x_a,-9.78,0.02,0.01", "y_p,0.03,9.80,0.01"]
    rows += ["y_a,0.01,-9.81,0.02", "z_p,0.02,0.01,9.82", "z_a,0.02,0.02,-9.79"]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.slow
def test_a_drafted_line_names_the_default_and_show_prints_its_value(tmp_path: Path):
    log = means(tmp_path)
    run_file = tmp_path / "run.toml"
    done = run_program("init", log, "-o", run_file, "--yes")
    assert done.status == 0, done.error
    assert tomllib.loads(run_file.read_text())["bench"]["tilt"] == "0.5 °"
    line = next(one for one in run_file.read_text().splitlines() if one.startswith("tilt ="))
    assert "this is the default; state your own value" in line
    shown = json.loads(run_program("show", run_file, "--json").output)
    tilt = next(one for one in shown["bench_parameters"] if one["name"] == "tilt1")
    assert tilt["key"] == "tilt"
    assert abs(tilt["std"] - 0.008726646) < 1e-8
    assert "0.50" in run_program("show", run_file).output


def test_a_stated_value_without_unit_is_refused_alone(tmp_path: Path):
    done = run_program(
        "init", means(tmp_path), "-o", tmp_path / "run.toml", "--set", "bench.tilt=1"
    )
    assert done.status == 2
    assert done.error.startswith("inercal: --set bench.tilt: '1' has no unit")
    assert "six_position" not in done.error
