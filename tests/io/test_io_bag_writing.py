"""Corrected motion as a bag of ROS 2: what rosbags and inercal read from it."""

import os
import shutil
from collections.abc import Iterator
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.calibration.files import save
from inercal.pipeline import calibrate
from inercal.recordings import Recording
from inercal.recordings.io.bag_writing import (
    FIELD_TOPIC,
    FRAME_ID,
    IMU_TOPIC,
    TEMPERATURE_TOPIC,
    is_bag,
    write_bag,
)
from inercal.recordings.io.read import Columns, read_recording

rosbag2: Any = pytest.importorskip("rosbags.rosbag2", reason="needs the extra inercal[ros]")
typesys: Any = pytest.importorskip("rosbags.typesys", reason="needs the extra inercal[ros]")

LOGS = Path(__file__).parents[2] / "examples" / "logs"
START_NS = 1_780_000_000_123_456_789
N = 300
LETTERS = {
    "f": f"{IMU_TOPIC}.linear_acceleration",
    "w": f"{IMU_TOPIC}.angular_velocity",
    "m": f"{FIELD_TOPIC}.magnetic_field",
}
UNITS = {"f": "m/s²", "w": "rad/s", "m": "T"}
PLACES = [("run.mcap", "mcap"), ("bag", "mcap"), ("bag", "sqlite3")]


def motion(letters: str = "fwm", **changes: object) -> Recording:
    channels = tuple(letter + axis for letter in letters for axis in "xyz")
    fields: dict[str, object] = {
        "time": np.arange(N) / 200,
        "data": np.random.default_rng(3).normal(size=(N, len(channels))),
        "channels": channels,
        "units": tuple(UNITS[name[0]] for name in channels),
        "temperature": np.linspace(295.0, 310.0, N),
        "origin": Fraction(START_NS),
        "source": "run.csv",
    }
    return Recording(**(fields | changes))  # type: ignore[arg-type]


def columns(letters: str = "fwm", **options: object) -> Columns:
    names = [(letter + axis, f"{LETTERS[letter]}.{axis}") for letter in letters for axis in "xyz"]
    return Columns(
        tuple((axis, name, UNITS[axis[0]]) for axis, name in names), time="time", options=options
    )


def file_of(path: Path) -> Path:
    """Return the file that a run file would name."""
    return path if path.suffix else path / "metadata.yaml"


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time of recording and message, as rosbags reads them."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    if path.is_dir():
        reader = rosbag2.Reader(path)
    else:
        reader = rosbag2.Reader.STORAGE_PLUGINS[".mcap"](path)
    reader.open()
    with closing(reader):
        for connection, ns, raw in reader.messages(reader.connections):
            yield connection.topic, ns, store.deserialize_cdr(raw, connection.msgtype)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "storage"), PLACES)
def test_inercal_reads_back_every_bit(tmp_path: Path, name: str, storage: str):
    made = motion()
    assert write_bag(made, tmp_path / name, storage=storage) == ()
    for stamp in ("header", "received"):
        found = read_recording(file_of(tmp_path / name), columns(stamp=stamp))
        np.testing.assert_array_equal(found.data, made.data)
        np.testing.assert_array_equal(found.time, made.time)
        assert found.origin == START_NS


@pytest.mark.parametrize(("name", "storage"), PLACES)
def test_rosbags_reads_the_messages_that_their_definitions_ask_for(
    tmp_path: Path, name: str, storage: str
):
    made = motion()
    write_bag(made, tmp_path / name, frame_id="base", storage=storage)
    sent = list(messages(tmp_path / name))
    assert len(sent) == 3 * N
    by_topic = {topic: [one for other, _, one in sent if other == topic] for topic, _, _ in sent}
    imu, field = by_topic[IMU_TOPIC], by_topic[FIELD_TOPIC]
    celsius = by_topic[TEMPERATURE_TOPIC]
    for topic, ns, message in sent:
        assert message.header.frame_id == "base", topic
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == ns
    force = [[getattr(one.linear_acceleration, axis) for axis in "xyz"] for one in imu]
    flux = [[getattr(one.magnetic_field, axis) for axis in "xyz"] for one in field]
    np.testing.assert_array_equal(force, made.data[:, :3])
    np.testing.assert_array_equal(flux, made.data[:, 6:])
    assert made.temperature is not None
    np.testing.assert_allclose([one.temperature for one in celsius], made.temperature - 273.15)
    absent = [-1.0, *[0.0] * 8]
    for one in imu:
        assert one.orientation_covariance.tolist() == absent
        assert not one.linear_acceleration_covariance.any()
        assert not one.angular_velocity_covariance.any()
    assert not any(one.magnetic_field_covariance.any() for one in field)
    assert {one.variance for one in celsius} == {0.0}


def test_a_quantity_that_was_not_measured_is_marked_as_absent(tmp_path: Path):
    path = tmp_path / "force.mcap"
    write_bag(motion("f", temperature=None), path)
    sent = list(messages(path))
    assert {topic for topic, _, _ in sent} == {IMU_TOPIC}
    assert {one.angular_velocity_covariance[0] for _, _, one in sent} == {-1.0}
    assert {one.linear_acceleration_covariance[0] for _, _, one in sent} == {0.0}
    with refused(names=(IMU_TOPIC,)):
        read_recording(path, columns("fw"))
    magnetic = tmp_path / "field.mcap"
    write_bag(motion("m", temperature=None), magnetic)
    assert {topic for topic, _, _ in messages(magnetic)} == {FIELD_TOPIC}


@pytest.mark.slow
def test_columns_without_a_field_are_named_and_the_mark_of_a_simulation_is_kept(tmp_path: Path):
    labels, mark = np.full(N, "up"), "simulation of run.toml, seed 3"
    made = motion(labels=labels, readback={"angle": np.zeros(N)}, simulation=mark)
    for name in ("run.mcap", "bag"):
        assert write_bag(made, tmp_path / name, storage="sqlite3") == ("label", "angle")
        assert read_recording(file_of(tmp_path / name), columns()).simulation == mark


def test_a_clock_may_begin_at_zero(tmp_path: Path):
    path = tmp_path / "run.mcap"
    write_bag(motion(origin=None), path)
    found = read_recording(path, columns())
    assert (found.origin, found.time[0], found.time.size) == (0, 0.0, N)


@pytest.mark.parametrize(
    "changes",
    [
        {"channels": ("f1", "f2", "fz")},
        {"channels": ("fx", "fy", "wz")},
        {"origin": Fraction(-1)},
        {"origin": Fraction(2**31 * 10**9)},
    ],
)
def test_what_no_message_can_state_is_refused_and_leaves_nothing(
    tmp_path: Path, changes: dict[str, object]
):
    for name in ("run.mcap", "bag"):
        with refused(file=name, key="--out"):
            write_bag(motion("f", **changes), tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_a_bag_that_fails_halfway_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write, count = rosbag2.Writer.write, iter(range(10))
    monkeypatch.setattr(
        rosbag2.Writer, "write", lambda *given: (write(*given), next(count, None) or 1 / 0)[0]
    )
    for name in ("run.mcap", "bag"):
        with pytest.raises(ZeroDivisionError):
            write_bag(motion(), tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_names_of_bags():
    assert [is_bag(Path(name)) for name in ("a.mcap", "a.MCAP", "a", "b/")] == [True] * 4
    assert not any(is_bag(Path(name)) for name in ("a.csv", "-", "a.db3"))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example of a bag and its calibration."""
    folder = tmp_path_factory.mktemp("log")
    for name in ("ros.toml", "ros.mcap", "marks.json"):
        shutil.copy(LOGS / name, folder)
    save(calibrate(folder / "ros.toml").calibration, folder / "ros.calibration.json")
    return folder


@pytest.mark.slow
def test_the_verb_writes_new_bags_only(log: Path, tmp_path: Path):
    files = ("apply", log / "ros.calibration.json", log / "ros.toml", "--out")
    for name, form in (("c.mcap", ()), ("bag", ("--format", "sqlite3")), ("other", ())):
        assert run_program(*files, tmp_path / name, *form).status == 0
    assert {path.name for path in tmp_path.rglob("*.*")} == {
        "c.mcap", "bag.db3", "other.mcap", "metadata.yaml"
    }  # fmt: skip
    (found, *_) = messages(tmp_path / "bag")
    assert found[2].header.frame_id == FRAME_ID
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    for name, options in (
        ("c.mcap", ()),
        ("bag", ()),
        ("bag", ("--force",)),
        ("c.mcap", ("--format", "sqlite3", "--force")),
        ("new", ("--format", "csv")),
        ("new.csv", ("--frame-id", "base")),
        ("new.csv", ("--format", "mcap")),
        ("new.bag", ()),
    ):
        assert run_program(*files, tmp_path / name, *options).status == 2
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
    assert run_program(*files, tmp_path / "c.mcap", "--force", "--frame-id", "base").status == 0
    assert {one.header.frame_id for _, _, one in messages(tmp_path / "c.mcap")} == {"base"}


def test_a_corrected_bag_has_the_numbers_of_a_corrected_table(log: Path, tmp_path: Path):
    files = ("apply", log / "ros.calibration.json", log / "ros.toml", "--out")
    for name in ("c.mcap", "c.npz"):
        assert run_program(*files, tmp_path / name).status == 0
    force = [message.linear_acceleration for _, _, message in messages(tmp_path / "c.mcap")]
    with np.load(tmp_path / "c.npz") as table:
        for axis in "xyz":
            np.testing.assert_array_equal([getattr(f, axis) for f in force], table[f"f{axis}"])
