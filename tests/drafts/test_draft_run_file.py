"""Drafts of run files: of every shared recording and of each example's data, and of odd files."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence, slow

import inercal
from inercal.basics.errors import InputError
from inercal.pipeline.drafts import Draft, draft_run_file

EXAMPLES = Path(__file__).parents[2] / "examples"
AXES = ("x", "y", "z")


def chosen(draft: Draft) -> dict[str, Any]:
    """Return the keys of a draft by section and name."""
    return {f"{one.section}.{one.key}": one.value for one in draft.entries}


def calibrated(draft: Draft) -> inercal.Calibration:
    """Write the run file, and calibrate from it."""
    draft.path.write_text(draft.text, encoding="utf-8")
    return inercal.calibrate(draft.path).calibration


def columns(*names: str) -> list[Any]:
    return [int(name) if name.isdecimal() else name for name in names]


SHARED = {
    "mpu9150": (
        ["mpu9150_multiposition/imu0.log"],
        {"data.rate": "100 Hz"},
        "data.rate",
        {
            "data.accelerometer": columns("1", "2", "3"),
            "data.gyro": columns("4", "5", "6"),
            "sensor.accelerometer.unit": "m/s²",
            "sensor.gyro.unit": "rad/s",
            "method.name": "multi_position",
        },
    ),
    "xsens": (
        ["xsens_mti_multiposition/xsens_acc.mat", "xsens_mti_multiposition/xsens_gyro.mat"],
        {},
        None,
        {
            "data.time": 1,
            "data.accelerometer": columns("2", "3", "4"),
            "data.gyro": columns("2", "3", "4"),
            "sensor.accelerometer.offset": 32768.0,
            "sensor.gyro.offset": 32768.0,
            "method.name": "multi_position",
        },
    ),
    "xsens accelerometers": (
        ["xsens_mti_multiposition/xsens_acc.mat"],
        {},
        None,
        {"data.time": 1, "data.accelerometer": columns("2", "3", "4")},
    ),
    "ferraris, physical units": (
        ["ferraris_imucal/example_ferraris_session.csv"],
        {"data.rate": "102.4 Hz"},
        "data.rate",
        {
            "data.time": "n_samples",
            "data.time_unit": "sample",
            "sensor.accelerometer.unit": "m/s²",
            "sensor.gyro.unit": "°/s",
            "method.name": "ferraris",
            "method.turn": "-360 °",
        },
    ),
    "ferraris, counts": (
        ["ferraris_imucal/annotated_session.csv"],
        {"data.rate": "204.8 Hz"},
        "data.rate",
        {
            "data.label": "part",
            "sensor.accelerometer.scale": "2048 LSB/g",
            "sensor.gyro.scale": "16.4 LSB/(°/s)",
            "method.name": "ferraris",
            "method.turn": "360 °",
        },
    ),
    "centrifuge table": (
        ["centrifuge_table1/table1_corrected.csv"],
        {"bench.radius": "1 m ± 1 µm"},
        "bench.radius",
        {
            "data.kind": "means",
            "data.label": "position",
            "data.arm_rate": "omega_over_pi",
            "data.arm_rate_unit": "0.5 rev/s",
            "method.name": "centrifuge_norm",
        },
    ),
}
FAST = ("xsens", "ferraris, counts", "centrifuge table")


@pytest.fixture(scope="module")
def xsens(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Draft:
    """Return the draft of the recordings in counts of a sensor that was turned by hand."""
    logs = [data_dir / file for file in SHARED["xsens"][0]]
    return draft_run_file(logs, tmp_path_factory.mktemp("xsens") / "run.toml")


@pytest.mark.slow
@pytest.mark.parametrize("case", [c if c in FAST else slow(c) for c in SHARED])
def test_shared_recordings_need_one_answer_at_most(
    case: str, data_dir: Path, tmp_path: Path, xsens: Draft
):
    files, stated, question, expected = SHARED[case]
    logs = [data_dir / file for file in files]
    first = xsens if case == "xsens" else draft_run_file(logs, tmp_path / "run.toml")
    assert [f"{one.section}.{one.key}" for one in first.questions] == [question][: bool(question)]
    draft = draft_run_file(logs, tmp_path / "run.toml", stated) if stated else first
    assert not draft.questions
    assert expected.items() <= chosen(draft).items()
    if case == "xsens":  # tests/accuracy calibrates it
        assert draft.method is not None
        assert draft.method.outcome is not None
    else:
        assert calibrated(draft).method == expected.get("method.name", "multi_position")


def test_scales_of_counts_are_found_by_gravity_and_turns(xsens: Draft):
    found = chosen(xsens)
    gravity = float(found["sensor.accelerometer.scale"].split()[0])
    turn = float(found["sensor.gyro.scale"].split()[0])
    assert gravity == pytest.approx(415 * 9.80665, rel=0.02)  # factory calibration
    assert turn == pytest.approx(4770 * np.pi / 180, rel=0.02)


def test_gyros_alone_are_refused(data_dir: Path, tmp_path: Path):
    log = data_dir / "xsens_mti_multiposition" / "xsens_gyro.mat"
    with pytest.raises(InputError) as caught:
        draft_run_file([log], tmp_path / "run.toml")
    assert caught.value.file == log


@pytest.mark.parametrize(
    ("table", "run_file"),
    [
        ("six_position/positions.csv", "six_position/run.toml"),
        evidence("six_position/soaks.csv", "six_position/soaks.toml"),
        ("centrifuge/lab.csv", "centrifuge/lab.toml"),
        ("dividing_head/lab.csv", "dividing_head/lab.toml"),
        ("dividing_head/tumble.csv", "dividing_head/tumble.toml"),
        ("rate_table/ship.csv", "rate_table/ship.toml"),
    ],
)
def test_tables_of_the_examples_are_recognised(table: str, run_file: str, tmp_path: Path):
    content = tomllib.loads((EXAMPLES / run_file).read_text(encoding="utf-8"))
    stated = {"bench.radius": content["bench"]["radius"]} if "centrifuge" in table else {}
    draft = draft_run_file([EXAMPLES / table], tmp_path / "run.toml", stated)
    found = chosen(draft)
    for key in ("kind", "accelerometer", "label", "angle", "arm_rate", "mounting", "attitude"):
        if key in content["data"]:
            assert found[f"data.{key}"] == content["data"][key]
    scale = content["sensor"]["accelerometer"].get("scale")
    if scale is not None:
        drafted = float(found["sensor.accelerometer.scale"].split()[0])
        assert drafted == pytest.approx(float(scale.split()[0]), rel=0.05)
    assert found["method.name"] == content["method"]["name"]


def still_log(path: Path, head: str, scale: float, **more: float) -> Path:
    """Write a log of an IMU in eight attitudes, moved by hand between them."""
    rng = np.random.default_rng(5)
    faces = [*np.eye(3), *-np.eye(3), np.ones(3) / 3**0.5, -np.ones(3) / 3**0.5]
    rows = [scale * up + rng.normal(0, 2e-3 * scale, (300, 3)) for up in faces]
    rows = [np.concatenate([row, row[-60:] + rng.normal(0, 0.5 * scale, (60, 3))]) for row in rows]
    data = np.concatenate(rows)
    time = np.arange(len(data)) * more.get("step", 0.01)
    np.savetxt(path, np.column_stack([time, data]), delimiter=",", header=head, comments="")
    return path


@pytest.mark.parametrize(
    ("head", "unit", "scale"),
    [
        ("Time (s),Acc X (g),Acc Y (g),Acc Z (g)", "g", 1.0),
        ("timestamp,accX,accY,accZ", "m/s²", 9.79),
        ("t,a_x [mg],a_y [mg],a_z [mg]", "mg", 1000.0),
        ("t,ax,ay,az", "LSB", 16384.0),
        ("t,ax,ay,az", "LSB", 1.08 * 16384.0),
        ("t,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "m/s²", 9.81),
    ],
)
def test_units_follow_from_gravity_or_from_names(
    head: str, unit: str, scale: float, tmp_path: Path
):
    draft = draft_run_file([still_log(tmp_path / "log.csv", head, scale)], tmp_path / "run.toml")
    found = chosen(draft)
    assert found["sensor.accelerometer.unit"] == unit
    assert found["data.accelerometer"] == head.split(",")[1:]
    if unit == "LSB":
        assert found["sensor.accelerometer.scale"] == "16384 LSB/g"
        assert any("16384 LSB/g" in one for one in draft.assumptions)


@pytest.mark.parametrize(("step", "unit"), [(10.0, "ms"), evidence(10_000.0, "µs"), (1e7, "ns")])
def test_the_unit_of_time_follows_from_likely_rates(step: float, unit: str, tmp_path: Path):
    log = still_log(tmp_path / "log.csv", "time,ax,ay,az", 9.81, step=step)
    draft = draft_run_file([log], tmp_path / "run.toml")
    assert chosen(draft)["data.time_unit"] == unit


def test_what_is_told_replaces_a_guess(tmp_path: Path):
    log = still_log(tmp_path / "log.csv", "time,ax,ay,az", 9.81)
    stated = {"bench.latitude": "48.1 °", "sensor.name": 'SN "7"', "bench.height": "520 m"}
    found = chosen(draft_run_file([log], tmp_path / "run.toml", stated))
    assert stated.items() <= found.items()
    assert "bench.gravity" not in found


def test_a_file_without_sensors_is_refused(tmp_path: Path):
    log = tmp_path / "log.csv"
    log.write_text("price,volume\n1,2\n3,4\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        draft_run_file([log], tmp_path / "run.toml")
    assert caught.value.file == log


@pytest.mark.slow
def test_a_log_with_stated_marks_is_six_positions(tmp_path: Path):
    folder = EXAMPLES / "logs"
    draft = draft_run_file(
        [folder / "px4.ulg"], folder / "draft.toml", {"data.marks": "marks.json"}
    )
    found = chosen(draft)
    assert found["sensor.accelerometer.unit"] == "m/s²"
    assert found["method.name"] == "six_position"
    assert draft.method is not None
    assert draft.method.outcome is not None


@pytest.mark.parametrize("log", ["px4_sample_log_small.ulg", "ardupilot_test.BIN"])
def test_logs_of_seconds_support_no_method(log: str, data_dir: Path, tmp_path: Path):
    with pytest.raises(InputError) as caught:
        draft_run_file([data_dir / "logs" / log], tmp_path / "run.toml")
    assert caught.value.names == ("method",)


@pytest.mark.parametrize("table", ["gyros.csv", "imu.csv"])
def test_what_only_the_user_can_state_of_a_rate_table_is_not_guessed(table: str, tmp_path: Path):
    draft = draft_run_file([EXAMPLES / "rate_platform" / table], tmp_path / "run.toml")
    asked = {"latitude", "rate_scale", "rate_asymmetry", "rate_stability", "setting"}
    asked |= {"attitude", "mounting"} if table == "imu.csv" else set()
    assert {one.key for one in draft.questions} == asked
    assert chosen(draft)["method.name"] == "rates_and_poses"
