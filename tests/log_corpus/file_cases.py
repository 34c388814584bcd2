"""Logs in two files, and logs that are no text: spreadsheets, MATLAB, NumPy, ROS, flight logs."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.log_corpus.motion import G0, Log, Motion, by_hand
from tests.log_corpus.text_forms import EPOCH, Form, Written, text_columns, write_text

AXES = "xyz"
UNNAMED = {"accelerometer": "m/s²", "gyro": "rad/s"}


class Pair(NamedTuple):
    """The forms of the two files of a phone, their names, and their motions."""

    acc: Form
    gyro: Form
    names: tuple[str, str] = ("Accelerometer", "Gyroscope")
    hz: tuple[float, float] = (100.0, 100.0)
    stated: Mapping[str, str] = {}


METAWEAR = ("epoch_ms|epoch (ms)", "isoz|time (-00:00)", "t3|elapsed (s)")
PAIRS: dict[str, Pair] = {
    "phyphox files": Pair(
        Form(("t|Time (s)", "a|{X} (m/s^2)"), digits=9),
        Form(("t|Time (s)", "w|{X} (rad/s)"), digits=9),
        hz=(100.0, 125.0),
    ),
    "sensor logger": Pair(
        Form(("epoch_ns|time", "t|seconds_elapsed", "a.zyx|{x}"), digits=8),
        Form(("epoch_ns|time", "t|seconds_elapsed", "w.zyx|{x}"), digits=8),
        ("TotalAcceleration", "Gyroscope"),
        stated={"sensor.gyro.unit": "rad/s"},
    ),
    "sensor kinetics": Pair(
        Form(("t3|Time", "a|{X}_value"), digits=4),
        Form(("t3|Time", "w|{X}_value"), digits=4),
        hz=(50.0, 100.0),
    ),
    "metawear": Pair(
        Form((*METAWEAR, "a|{x}-axis (g)"), "g", digits=3),
        Form((*METAWEAR, "w|{x}-axis (deg/s)"), gyro="°/s", digits=3),
        hz=(50.0, 50.0),
    ),
    "blue st": Pair(
        Form(("iso|Date", "ms|NodeTimestamp", "a|{X} (mg)"), "mg", digits=0),
        Form(("iso|Date", "ms|NodeTimestamp", "w|{X} (dps)"), gyro="°/s", digits=1),
        hz=(50.0, 50.0),
    ),
}


def write_pair(pair: Pair, folder: Path, seed: int, gravity: float) -> Written:
    """Write the two files of a phone, each with its own clock."""
    made = [
        write_text(by_hand(seed, Motion(hz=hz), gravity), form, folder, name)
        for form, name, hz in zip((pair.acc, pair.gyro), pair.names, pair.hz, strict=True)
    ]
    first, second = made
    return Written(
        (*first.files, *second.files),
        {**first.columns, **second.columns},
        {**first.units, **second.units},
        truth=first.truth,
    )


def _named(log: Log, acc: str, gyro: str) -> dict[str, np.ndarray]:
    columns = {acc.replace("?", x): log.force[:, k] for k, x in enumerate(AXES)}
    return columns | {gyro.replace("?", x): log.rate[:, k] for k, x in enumerate(AXES)}


def _written(path: Path, log: Log, acc: str, gyro: str) -> Written:
    names = {"accelerometer": acc, "gyro": gyro}
    columns = {kind: tuple(name.replace("?", x) for x in AXES) for kind, name in names.items()}
    return Written((path,), columns, UNNAMED, truth=log.truth)


def matlab_mobile(folder: Path, log: Log) -> Written:
    """Write vectors and matrices as MATLAB saves them."""
    from scipy.io import savemat

    path = folder / "sensorlog.mat"
    savemat(path, {"Acceleration": log.force, "AngularVelocity": log.rate, "t": log.time[:, None]})
    kinds = {"accelerometer": "Acceleration", "gyro": "AngularVelocity"}
    columns = {kind: tuple(f"{one}({k})" for k in (1, 2, 3)) for kind, one in kinds.items()}
    return Written((path,), columns, UNNAMED, truth=log.truth)


def matlab_struct(folder: Path, log: Log) -> Written:
    """Write a struct of matrices, in degrees and g."""
    from scipy.io import savemat

    path = folder / "imu.mat"
    degrees = np.degrees(log.rate)
    imu = {"time": log.time, "acc": log.force / G0, "gyr": degrees, "mag": log.force * 3 + 1}
    savemat(path, {"imu": imu, "fs": 100.0})
    kinds = {"accelerometer": "imu.acc", "gyro": "imu.gyr"}
    columns = {kind: tuple(f"{one}({k})" for k in (1, 2, 3)) for kind, one in kinds.items()}
    return Written((path,), columns, {"accelerometer": "g", "gyro": "°/s"}, truth=log.truth)


def npz_columns(folder: Path, log: Log) -> Written:
    """Write an array for each column."""
    path = folder / "log.npz"
    columns: dict[str, Any] = {"t": log.time} | _named(log, "acc_?", "gyro_?")
    np.savez(path, **columns)
    return _written(path, log, "acc_?", "gyro_?")


def npz_table(folder: Path, log: Log) -> Written:
    """Write one array and the names of its columns."""
    path = folder / "log.npz"
    columns = {"stamp_ns": EPOCH * 1e9 + log.time * 1e9} | _named(log, "a?", "w?")
    np.savez(path, data=np.column_stack(list(columns.values())), columns=np.array(list(columns)))
    return _written(path, log, "a?", "w?")


def npy(folder: Path, log: Log, named: bool) -> Written:
    """Write a matrix, or records with names."""
    columns = {"t": log.time} | _named(log, "acc?", "gyr?")
    table = np.column_stack(list(columns.values()))
    if named:
        types = [(name, float) for name in columns]
        table = np.array(list(map(tuple, table.tolist())), dtype=types)
    np.save(folder / "log.npy", table)
    written = _written(folder / "log.npy", log, "acc?", "gyr?")
    places = {"accelerometer": (2, 3, 4), "gyro": (5, 6, 7)}
    return written if named else written._replace(columns=places)


def parquet(folder: Path, log: Log) -> Written:
    """Write a Parquet file with dates."""
    arrow = pytest.importorskip("pyarrow", reason="needs the extra inercal[io]")
    parquet_io = pytest.importorskip("pyarrow.parquet")
    ns = (round(EPOCH * 1e9) + np.rint(log.time * 1e9)).astype(np.int64)
    columns = {"timestamp": ns, "frame": ["imu"] * len(ns)} | _named(log, "accel_?", "gyro_?")
    path = folder / "log.parquet"
    parquet_io.write_table(arrow.table(columns), path)
    return _written(path, log, "accel_?", "gyro_?")


def hdf5(folder: Path, log: Log) -> Written:
    """Write groups of an HDF5 file."""
    h5py = pytest.importorskip("h5py", reason="needs the extra inercal[io]")
    path = folder / "log.h5"
    with h5py.File(path, "w") as file:
        file["imu/time"], file["imu/accel"], file["imu/gyro"] = log.time, log.force, log.rate
    kinds = {"accelerometer": "imu.accel", "gyro": "imu.gyro"}
    columns = {kind: tuple(f"{one}({k})" for k in (1, 2, 3)) for kind, one in kinds.items()}
    return Written((path,), columns, UNNAMED, truth=log.truth)


def workbook(folder: Path, log: Log, form: Form, title: tuple[str, ...] = ()) -> Written:
    """Write a log as a spreadsheet saves it."""
    excel = pytest.importorskip("openpyxl", reason="needs the extra inercal[excel]")
    cells, _ = text_columns(log, form)
    book = excel.Workbook()
    for line in title:
        book.active.append([line])
    book.active.append([head.strip('"') for head in cells])
    for row in zip(*cells.values(), strict=True):
        book.active.append([float(one) for one in row])
    path = folder / "log.xlsx"
    book.save(path)
    text = write_text(log, form, folder, "as_text")
    return text._replace(files=(path,))


def _samples(log: Log) -> object:
    from tests.io.log_files import BOOT_NS, Samples

    ns = BOOT_NS + np.rint(log.time * 1e9).astype(np.int64)
    return Samples(ns, *(x.astype(np.float32) for x in (log.force, log.rate, log.celsius)))


def bag(folder: Path, log: Log, suffix: str) -> Written:
    """Write a bag of ROS 1 or 2 with one topic of an IMU."""
    from tests.io import ros_files

    first = suffix == ".bag"
    write = ros_files.write_bag if first else ros_files.write_bag2
    messages = ros_files.messages(_samples(log), first)  # type: ignore[arg-type]
    sent = (one for one in messages if one[0] in (ros_files.RAW, ros_files.CELSIUS))
    path = write(folder / f"log{suffix}", sent)
    topic = ros_files.RAW
    return _written(path, log, f"{topic}.linear_acceleration.?", f"{topic}.angular_velocity.?")


def ulog(folder: Path, log: Log) -> Written:
    """Write a log of PX4 with raw readings."""
    from tests.io.log_files import ulog_bytes

    pytest.importorskip("pyulog", reason="needs the extra inercal[px4]")
    path = folder / "log.ulg"
    topics = ("sensor_accel", "sensor_gyro")
    path.write_bytes(ulog_bytes(_samples(log), {}, topics))  # type: ignore[arg-type]
    return _written(path, log, "sensor_accel.?", "sensor_gyro.?")


def dataflash(folder: Path, log: Log) -> Written:
    """Write a log of ArduPilot, which has corrected the readings."""
    from tests.io.log_files import dataflash_bytes

    path = folder / "log.bin"
    path.write_bytes(dataflash_bytes(_samples(log)))  # type: ignore[arg-type]
    columns = {
        kind: tuple(f"IMU.{name}{x}" for x in "XYZ")
        for kind, name in (("accelerometer", "Acc"), ("gyro", "Gyr"))
    }
    return Written((path,), columns, UNNAMED, truth=log.truth)


SHEET = Form(("ms|Time (ms)", "a|Accel {X} (g)", "w|Gyro {X} (deg/s)"), "g", "°/s", 4)
BARE_SHEET = Form(("t|t", "w|g{x}", "a|a{x}"), "m/s²", "°/s", 4)
FILES: dict[str, tuple[Callable[[Path, Log], Written], Motion]] = {
    "matlab mobile": (matlab_mobile, Motion()),
    "matlab struct": (matlab_struct, Motion()),
    "npz": (npz_columns, Motion()),
    "npz table": (npz_table, Motion(hz=200, rests=14)),
    "npy": (partial(npy, named=False), Motion()),
    "npy records": (partial(npy, named=True), Motion()),
    "parquet": (parquet, Motion()),
    "hdf5": (hdf5, Motion()),
    "xlsx": (partial(workbook, form=SHEET, title=("Recorded on 29 November", "")), Motion(hz=50)),
    "xlsx bare": (partial(workbook, form=BARE_SHEET), Motion(hz=50)),
    "bag": (partial(bag, suffix=".bag"), Motion(hz=50)),
    "mcap": (partial(bag, suffix=".mcap"), Motion(hz=50)),
    "db3": (partial(bag, suffix=".db3"), Motion(hz=50)),
    "px4": (ulog, Motion(hz=100)),
    "ardupilot": (dataflash, Motion(hz=50)),
}
