"""The recording of a run: columns as [data] has them, the bench's own words beside them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests import rest_bias_method
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, run_file
from tests.refusals import refused

from inercal.benches import Turntable
from inercal.benches.turntable.reading.track_observation import observe
from inercal.host.assembly import SampleAssembler
from inercal.host.packets import read_layout
from inercal.host.recording_writer import require_recordable, write_recording
from inercal.host.run_log import RunLog, file_sha256, read_frames
from inercal.methods import METHODS
from inercal.pipeline import load_recording
from inercal.runfile import Run

WARM = {'label = "step"': 'label = "step"\ntemperature = "temp"'}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def bench(folder: Path) -> Bench:
    faults = Faults(lost=0.01, changed=0.01, outages=((33.0, 36.0),))
    return Bench(run_file(folder, PATH, **WARM), seed=1, faults=faults)


@pytest.fixture(scope="module")
def run(bench: Bench, folder: Path) -> Run:
    bench.log(folder / "log")
    write_recording(bench.run, LAYOUT, folder / "log", folder, {"table": "pmac://bench:1025"})
    return bench.run


@pytest.mark.slow
def test_a_recording_holds_what_was_assembled_to_the_last_bit(run: Run, folder: Path):
    made = SampleAssembler(run, LAYOUT)
    for frame in read_frames(folder / "log"):
        made.feed(frame)
    block = made.take()
    assert block is not None
    recording = load_recording(run)
    assert recording.time.tobytes() == block.time.tobytes()
    assert recording.data.tobytes() == np.ascontiguousarray(block.output).tobytes()
    assert recording.labels is not None
    assert recording.labels.tolist() == made.sections.labels(block.table).tolist()
    assert set(recording.labels) == {"", "warm-up", "up", "slanted", "y+", "rest"}
    assert recording.temperature == pytest.approx(np.full(block.time.size, 298.15), abs=1e-9)
    assert isinstance(run.bench, Turntable)
    track = observe(run).observations.track
    assert track is not None
    assert track.reading.tobytes() == block.reading.tobytes()
    assert track.angles.tobytes() == np.ascontiguousarray(block.angles).tobytes()
    assert track.hold.tolist() == block.hold.tolist()
    severe = [one for one in recording.findings if one.severity == "refused"]
    assert not severe


def test_the_benchs_own_words_stand_beside(run: Run, bench: Bench, folder: Path):
    with h5py.File(folder / "mimu.h5") as file:
        group: Any = file["bench"]
        polled = bench.polled.size
        assert group["angle"].shape == (polled, 3)
        assert group["time"][()] == pytest.approx(bench.polled + bench.servo, abs=1e-9)
        assert group["rate"].shape == group["following_error"].shape == (polled, 3)
        told = dict(group.attrs)
    assert told["table"] == "pmac://bench:1025"
    assert told["protection"].startswith("CRC-16")
    assert told["log sha256"] == file_sha256(folder / "log")
    assert told["bytes: failed"] > 0
    assert told["samples"] == load_recording(run).time.size


def test_a_log_without_a_section_leaves_nothing_behind(run: Run, tmp_path: Path):
    with RunLog(tmp_path / "log") as log:
        log.append(1, 0.0, b"nothing")
    with refused(file="log", key=None):
        write_recording(run, LAYOUT, tmp_path / "log", tmp_path)
    assert not list(tmp_path.glob("*.h5"))


@pytest.mark.slow
def test_a_recording_is_written_whole_or_not_at_all(run: Run, folder: Path, tmp_path: Path):
    (tmp_path / "file").touch()
    with refused(file=run.data.file):
        write_recording(run, LAYOUT, folder / "log", tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({'file = "mimu.csv"': 'file = "mimu.csv"\nhold = "hold"'}, "file", ()),
        ({'file = "mimu.csv"': 'file = "mimu.h5"'}, "hold", ()),
        ({'label = "step"': ""}, "label", ()),
        ({'rate = "200 Hz"': ""}, "rate", ()),
        ({'time = "time"': ""}, "time", ()),
        ({'time = "time"': 'time = "time"\ntime_unit = "ms"'}, "time_unit", ()),
        ({'"outer"': '"-outer"'}, "table", ("-outer",)),
        ({'"ax"': '"imu.ax"'}, "accelerometer", ("imu.ax",)),
        ({'["gx", "gy", "gz"]': "[5, 6, 7]"}, "gyro", ("5",)),
        ({'label = "step"': 'label = "bench"'}, "label", ("bench",)),
    ],
)
def test_data_that_a_run_cannot_be_written_to_is_refused(
    tmp_path: Path, changes: dict[str, str], key: str, names: tuple[str, ...]
):
    run = run_file(tmp_path, PATH, **changes)
    with refused(file=run.path, key=f"[data] {key}", names=names):
        require_recordable(run)


def test_packets_without_temperature_are_refused_where_it_has_a_column(tmp_path: Path):
    run = run_file(tmp_path, PATH, **WARM)
    require_recordable(run, LAYOUT)
    require_recordable(run, read_layout("xsens"))  # that holds one in some of its packets
    with refused(key="[data] temperature", names=("novatel",)):
        require_recordable(run, read_layout("novatel"))


@pytest.mark.slow
def test_columns_are_named_rightly_where_a_method_leaves_the_accelerometers_out(
    run: Run, folder: Path, tmp_path: Path
):
    whole = load_recording(run)
    only = replace(
        rest_bias_method.METHOD,
        name="of_gyros",
        default_coefficients={"w": ("bias",)},
        needs=("w",),
    )
    with METHODS.with_("of_gyros", only):
        part = run_file(tmp_path, PATH, **{'"turntable_kalman"': '"of_gyros"'})
    write_recording(part, LAYOUT, folder / "log", tmp_path)
    recording = load_recording(part)
    assert recording.channels == ("gx", "gy", "gz")
    assert recording.data.tobytes() == np.ascontiguousarray(whole.data[:, 3:]).tobytes()
