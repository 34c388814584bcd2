"""A log that is analysed in blocks gives what it gives at once, in every format, with its gaps."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import chosen, evidence
from tests.noise.generator import MEMS, draw
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.noise import NoiseAnalysis, analyse_noise
from inercal.noise.analysis import candidate_models
from inercal.pipeline.drafts import long_rest_recording
from inercal.pipeline.drafts.long_rest_recording import open_long_rest_recording
from inercal.pipeline.drafts.rest_recording import read_rest_recording
from inercal.recordings.io.isolation import MOST_VALUES_KEY
from inercal.recordings.io.long_tables import open_long_table

N = 100_000
UNIT = {"sensor.gyro.unit": "rad/s"}
GAP = slice(60_000, 66_000)
FORMATS = ["csv", "npz", "data.npz", "parquet", "h5", "matrix.h5", "packed.h5"]


@pytest.fixture(scope="module")
def table() -> np.ndarray:
    """Return time and three gyros at rest, with single losses and one gap."""
    y = draw(replace(MEMS, n=N), 7, 3)
    found = np.column_stack([MEMS.dt * np.arange(N), y.T + 0.01])
    kept = np.ones(N, dtype=bool)
    kept[GAP] = False
    kept[np.random.default_rng(1).choice(N, 50, replace=False)] = False
    return found[kept]


def write(folder: Path, kind: str, table: np.ndarray) -> Path:
    names = ["time", "gx", "gy", "gz"]
    path = folder / f"log.{kind}"
    if kind == "csv":
        np.savetxt(path, table, "%.12g", ",", header=",".join(names), comments="")
    elif kind == "npz":
        np.savez_compressed(path, **dict(zip(names, table.T, strict=True)))
    elif kind == "data.npz":
        np.savez(path, data=table, columns=np.array(names))
    elif kind.endswith("h5"):
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            if kind == "matrix.h5":
                file["imu/gyro"], file["time"] = table[:, 1:], table[:, 0]
            else:
                for name, column in zip(names, table.T, strict=True):
                    more = {"chunks": (4096,), "compression": "gzip"} if "packed" in kind else {}
                    file.create_dataset(name, data=column, **more)
            file["serial_number"] = np.arange(5)
    else:
        pyarrow = pytest.importorskip("pyarrow")
        parquet = pytest.importorskip("pyarrow.parquet")
        columns = dict(zip(names, table.T, strict=True))
        parquet.write_table(pyarrow.table(columns), path)
    return path


def in_blocks(path: Path, stated: Mapping[str, str] = UNIT) -> NoiseAnalysis:
    if path.name == "log.matrix.h5":
        stated = {**stated, "data.gyro": "imu.gyro(1),imu.gyro(2),imu.gyro(3)"}
    found = open_long_rest_recording(path, stated, 1000)
    assert found is not None
    return found.stream().analysis(candidate_models("NBK"))


@pytest.fixture(scope="module")
def at_once(table: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> NoiseAnalysis:
    path = write(tmp_path_factory.mktemp("whole"), "data.npz", table)
    return analyse_noise(read_rest_recording(path, UNIT), terms="NBK", kinds=())


@pytest.mark.slow
@pytest.mark.parametrize("kind", chosen(FORMATS, ("csv", "packed.h5")))
def test_blocks_of_each_format_give_the_coefficients_of_the_whole(
    kind: str, table: np.ndarray, tmp_path: Path, at_once: NoiseAnalysis
):
    found = in_blocks(write(tmp_path, kind, table))
    assert found.duration == pytest.approx(at_once.duration, rel=1e-9)
    assert any("lost samples" in text for text in found.remarks)
    assert any("2 pieces" in text for text in found.remarks)
    for one, other in zip(found.channels, at_once.channels, strict=True):
        assert one.channel == other.channel
        assert one.n == other.n
        assert one.dt == pytest.approx(other.dt, rel=1e-9)
        for a, b in zip(one.coefficients, other.coefficients, strict=True):
            assert abs(a.value - b.value) < 0.3 * b.u


@pytest.mark.slow
def test_times_that_restart_and_lines_above_are_read_in_blocks_too(
    table: np.ndarray, tmp_path: Path, at_once: NoiseAnalysis
):
    path = write(tmp_path, "csv", np.column_stack([table[:, 0] % 16384, table[:, 1:]]))
    path.write_text("1,2,3,4\n" + path.read_text("utf-8"), encoding="utf-8")
    stated = UNIT | {"data.skip": "1", "data.counter_modulus": "16384"}
    found = in_blocks(path, stated)
    assert found.duration == pytest.approx(at_once.duration, rel=1e-9)
    assert [one.n for one in found.channels] == [one.n for one in at_once.channels]


def test_a_log_that_is_too_long_for_its_format_says_which_are_read_in_blocks(
    table: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def too_long(_: Path, **_options: object) -> None:
        raise InputError("log.ulg is too long", key=MOST_VALUES_KEY)

    monkeypatch.setattr("inercal.pipeline.drafts.rest_recording.read_table", too_long)
    with refused(InputError, key="[data] most_values") as refusal:
        read_rest_recording(write(tmp_path, "data.npz", table[:100]), UNIT)
    assert "HDF5" in str(refusal.value)


def test_a_short_log_is_read_at_once(table: np.ndarray, tmp_path: Path):
    assert open_long_rest_recording(write(tmp_path, "data.npz", table), UNIT) is None


@pytest.mark.parametrize(("n", "gap"), [(60_000, 0.0), (60_000, 500.0), evidence(200_000, 0.0)])
def test_a_drift_with_the_temperature_is_fitted_in_blocks_as_at_once(
    n: int, gap: float, tmp_path: Path
):
    rate = draw(replace(MEMS, n=n), 8)[0]
    celsius = 25 + 8 * np.sin(2 * np.pi * np.arange(n) / n) + 0.01 * np.arange(n) / n
    slope = 20 * MEMS.unit
    columns = {
        "time": MEMS.dt * np.arange(n) + gap * (np.arange(n) > 0.4 * n),
        "gx": rate + slope * celsius,
        "gy": rate,
        "gz": -rate,
    }
    path = tmp_path / "log.npz"
    np.savez(path, **columns, temperature=celsius)
    whole = analyse_noise(read_rest_recording(path, UNIT), terms="NBK", kinds=()).channels
    blocks = in_blocks(path).channels
    for one, other in zip(blocks, whole, strict=True):
        assert [term.name for term in one.drift] == [term.name for term in other.drift]
        for a, b in zip(one.drift, other.drift, strict=True):
            assert abs(a.value - b.value) < 0.1 * b.u
        for a, b in zip(one.coefficients, other.coefficients, strict=True):
            assert abs(a.value - b.value) < 0.3 * b.u
    found = {term.name: term for term in blocks[0].drift}["temperature"]
    assert abs(found.value - slope) < 4 * found.u
    assert not {term.name for term in blocks[1].drift} & {"temperature", "temperature rate"}


def test_text_in_an_hdf5_file_is_left_to_the_whole_reader(table: np.ndarray, tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    path = write(tmp_path, "h5", table[:2000])
    assert open_long_table(path, 1000) is not None
    with h5py.File(path, "a") as file:
        file["stamp"] = ["2026-01-01"] * 2000
    assert open_long_table(path, 1000) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "text"),
    [("nan", "not finite"), ("reset", "does not increase"), ("losses", "in short gaps")],
)
def test_what_blocks_cannot_take_is_refused_with_its_place(
    table: np.ndarray, tmp_path: Path, change: str, text: str
):
    bad = table.copy()
    if change == "nan":
        bad[75_000, 2] = np.nan
    elif change == "reset":
        bad[75_000:, 0] -= 15_000
    else:
        kept = np.ones(len(bad), dtype=bool)
        kept[35_000::20] = False
        bad = bad[kept]
    with pytest.raises(InputError, match=text) as refusal:
        in_blocks(write(tmp_path, "npz", bad))
    if change != "losses":
        assert "row 75001" in str(refusal.value)


@pytest.mark.slow
def test_the_verb_takes_a_long_log_in_blocks_by_itself(
    table: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(long_rest_recording, "LONG_VALUES", 1000)
    log = write(tmp_path, "data.npz", table)
    options = ("--set", "sensor.gyro.unit=rad/s")
    done = run_program("noise", log, *options, "--json", "--report", "--out", tmp_path)
    assert done.status == 0, done.error
    found = json.loads(done.output)
    assert [one["channel"] for one in found["channels"]] == ["gx", "gy", "gz"]
    assert list(found["channels"][0]["deviations"]) == ["oadev"]
    assert found["sha256"]
    assert "<svg" in (tmp_path / "log.data.noise.html").read_text()
    for option in (("--skip-disturbed",), ("--taus", "all"), ("--method", "gmwm")):
        refused = run_program("noise", log, *options, *option)
        assert refused.status == 2
        assert option[0] in refused.error
