"""DataFlash: messages of ArduPilot as columns, corrections undone, damage refused."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.io.log_files import (
    ARDUPILOT,
    SAMPLES,
    TYPES,
    ardupilot_corrected,
    dataflash_bytes,
    dataflash_formats,
    logged,
)
from tests.refusals import refused

from inercal.recordings.io.column_table import ReadRequest
from inercal.recordings.io.dataflash import read_dataflash
from inercal.recordings.io.read import Columns, detect_reader, read_recording, read_table

ACC = ("IMU.AccX", "IMU.AccY", "IMU.AccZ")
GYR = ("IMU.GyrX", "IMU.GyrY", "IMU.GyrZ")
FLOAT32 = 3e-6  # m/s², a step at 20 m/s²
START = int(SAMPLES.ns[0] // 1000)


def wanted(**options: object) -> Columns:
    axes = ("ax", "ay", "az", "gx", "gy", "gz")
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    return Columns(
        tuple(zip(axes, (*ACC, *GYR), units, strict=True)),
        time="time",
        temperature="IMU.T",
        options=options,
    )


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "log.bin"
    path.write_bytes(dataflash_bytes(SAMPLES, **changes))
    return path


def test_what_ardupilot_corrected_is_what_the_sensors_read_once_undone(tmp_path: Path):
    path = written(tmp_path)
    undone = read_recording(path, wanted())
    np.testing.assert_allclose(undone.data[:, :3], SAMPLES.acc, atol=FLOAT32)
    np.testing.assert_allclose(undone.data[:, 3:], SAMPLES.gyr, atol=FLOAT32)
    np.testing.assert_allclose(undone.time, SAMPLES.time, atol=1e-12)
    assert undone.temperature is not None
    np.testing.assert_allclose(undone.temperature - 273.15, SAMPLES.temperature, atol=1e-4)
    assert undone.kept_corrections == ""
    kept = read_recording(path, wanted(corrections="keep"))
    np.testing.assert_allclose(kept.data, np.hstack(ardupilot_corrected(SAMPLES)), atol=FLOAT32)
    for name in ARDUPILOT:
        assert (name in kept.kept_corrections) != name.endswith("_ID")
    assert undone.devices == kept.devices == "INS_ACC_ID 1246730, INS_GYR_ID 2164234"


def test_the_sample_of_pymavlink_is_undone_by_its_parameters(data_dir: Path):
    path = data_dir / "logs" / "ardupilot_test.BIN"
    kept = read_table(path, ACC, options={"corrections": "keep"})
    undone = read_table(path, ACC)
    # Roll of 180°, then scale and offset of the log.
    scale = (0.999653160572052, 0.9025073051452637, 1.0012799501419067)
    offset = (-0.03169693425297737, 2.4852089881896973, -0.29318252205848694)
    for name, sign, k, b in zip(ACC, (1, -1, -1), scale, offset, strict=True):
        raw = sign * kept.numbers(name) / k + b
        np.testing.assert_allclose(undone.numbers(name), raw, rtol=1e-12)


def test_values_of_the_sample_are_those_that_its_bytes_spell(data_dir: Path):
    path = data_dir / "logs" / "ardupilot_test.BIN"
    raw = path.read_bytes()
    at = next(k for k in range(0, len(raw), 89) if raw[k + 5 : k + 9] == b"IMU2")
    head = b"\xa3\x95" + raw[at + 3 : at + 4]
    first = struct.unpack_from("<Q6f2If", raw, raw.index(head, 89 * 100) + 3)
    names = ("IMU2.TimeUS", "IMU2.GyrX", "IMU2.AccZ", "IMU2.T")
    table = read_table(path, names, options={"corrections": "keep"})
    assert [table.numbers(n)[0] for n in names] == [first[k] for k in (0, 1, 6, 9)]


def test_instances_and_units_of_fields_are_told_apart(tmp_path: Path):
    path = written(tmp_path, after=b"".join(logged("MODE", START + k, -5 * k) for k in range(3)))
    both = read_table(path, ["IMU.AccX", "IMU[1].AccX"], options={"corrections": "keep"})
    one, other = (both.numbers(name) for name in ("IMU.AccX", "IMU[1].AccX"))
    np.testing.assert_allclose(other - one, 1, atol=FLOAT32)
    level = read_table(path, ["MODE.Level"]).numbers("MODE.Level")
    np.testing.assert_allclose(level, [0, -0.05, -0.1])


def test_a_parameter_before_the_readings_is_in_force(tmp_path: Path):
    raw = dataflash_bytes(SAMPLES)
    formats = dataflash_formats()
    old = logged("PARM", START - 9, "INS_ACCOFFS_X", 0.9)
    path = tmp_path / "log.bin"
    new = logged("PARM", START - 5, "INS_ACCOFFS_X", ARDUPILOT["INS_ACCOFFS_X"])
    path.write_bytes(formats + old + new + raw[len(formats) :])
    undone = read_recording(path, wanted())
    np.testing.assert_allclose(undone.data[:, :3], SAMPLES.acc, atol=FLOAT32)


WITHOUT = {name: value for name, value in ARDUPILOT.items() if name != "INS_ACCSCAL_Y"}


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"parameters": WITHOUT}, ("INS_ACCSCAL_Y",)),
        ({"parameters": ARDUPILOT | {"INS_TCAL1_ENABLE": 1.0}}, ("INS_TCAL1_ENABLE",)),
        ({"parameters": ARDUPILOT | {"AHRS_ORIENTATION": 101.0}}, ("AHRS_ORIENTATION",)),
        ({"parameters": ARDUPILOT | {"INS_ACCSCAL_X": 0.0}}, ("INS_ACCSCAL",)),
        ({"after": logged("PARM", START + 9_000_000, "INS_ACCOFFS_X", 0.3)}, ("INS_ACCOFFS_X",)),
    ],
)
def test_corrections_that_cannot_be_undone_are_refused(
    tmp_path: Path, changes: dict[str, Any], names: tuple[str, ...]
):
    path = written(tmp_path, **changes)
    with refused(file=path, names=names):
        read_table(path, ACC)


@pytest.mark.parametrize(
    ("names", "options", "data"),
    [
        (("IMU5.AccX",), {}, {"names": ("IMU5.AccX",)}),
        (("IMU.Accx",), {}, {"names": ("IMU.Accx",)}),
        (("MODE.Level",), {}, {"names": ("MODE",)}),
        (ACC, {"most_values": 100}, {"key": "[data] most_values"}),
    ],
)
def test_a_wrong_column_or_limit_is_refused(
    tmp_path: Path, names: tuple[str, ...], options: dict[str, object], data: dict[str, Any]
):
    path = written(tmp_path)
    with refused(file=path, **data):
        read_table(path, names, options=options)


def test_a_log_that_ends_within_a_message_has_the_samples_before(tmp_path: Path):
    path = tmp_path / "log.bin"
    path.write_bytes(dataflash_bytes(SAMPLES)[:-60])
    assert read_table(path, ACC).numbers(ACC[0]).size == len(SAMPLES.ns) - 1


def test_messages_across_blocks_are_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = written(tmp_path)
    whole = read_table(path, ACC).numbers(ACC[1])
    monkeypatch.setattr("inercal.recordings.io.dataflash._BLOCK", 97)
    # In this process: the one that reads files otherwise has blocks of the usual size.
    in_blocks = read_dataflash(path, ReadRequest(ACC))
    assert in_blocks.numbers(ACC[1]).tobytes() == whole.tobytes()


GOOD = dataflash_bytes(SAMPLES)
FORMATS = dataflash_formats()
DAMAGED = {
    "zeros": GOOD[:3000] + bytes(50) + GOOD[3050:],
    "shifted": GOOD[:3000] + GOOD[3001:],
    "format cut": GOOD[:40],
    "unknown type": FORMATS + b"\xa3\x95\x50" + GOOD[len(FORMATS) :],
    "unknown letter": FORMATS + logged("FMT", 90, 12, "X", "Qy", "TimeUS,a"),
    "other length": FORMATS + logged("FMT", 90, 12, "X", "Qf", "TimeUS,a"),
    "format of no bytes": FORMATS + logged("FMT", 90, 0, "X", "", ""),
    "field without name": FORMATS + logged("FMT", 90, 15, "X", "Qf", "TimeUS"),
    "format that changes": FORMATS
    + dataflash_formats({"IMU": (65, "QBffffffIIf", TYPES["IMU"][2].replace("AccX", "AccQ"))}),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_log_is_one_line(tmp_path: Path, name: str):
    path = tmp_path / "log.bin"
    path.write_bytes(DAMAGED[name])
    assert detect_reader(path).name == "dataflash"
    with refused(file=path) as caught:
        read_table(path, ACC)
    assert str(caught.value).startswith("log.bin")
    assert len(str(caught.value)) < 250
