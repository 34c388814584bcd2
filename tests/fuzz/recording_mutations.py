"""Recordings of fourteen formats with bytes changed anywhere, each read by `read_recording`.

`python -m tests.fuzz.recording_mutations FORMAT SEED COUNT` prints what became of them as JSON.
"""

import json
import random
import re
import resource
import struct
import sys
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from tests.io.log_files import ARDUPILOT, PX4, dataflash_bytes, six_positions, ulog_bytes
from tests.io.ros_files import messages, write_bag, write_bag2
from tests.io.test_io_mat import save_v73
from tests.io.test_io_xlsx import workbook

from inercal.basics.errors import InputError
from inercal.recordings.io.read import Columns, read_recording, read_table

SAMPLES = six_positions()
TABLE = {"time": SAMPLES.time} | {
    f"a{axis}": SAMPLES.acc[:, k].astype(float) for k, axis in enumerate("xyz")
}
ROWS = np.stack(list(TABLE.values()), axis=1).tolist()
OWN = ("ax", "ay", "az")


def save_csv(path: Path) -> None:
    np.savetxt(path, ROWS, delimiter=",", header=",".join(TABLE), comments="")


def save_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, column in TABLE.items():
            file.create_dataset(name, data=column, chunks=(60,), compression="gzip")
        file["label"] = ["up"] * len(ROWS)


def save_mat(**options: Any) -> Callable[[Path], None]:
    def save(path: Path) -> None:
        content = TABLE | {"part": np.array(["up", "down"], object), "imu": {"acc": SAMPLES.acc}}
        four = options.get("format") == "4"
        scipy.io.savemat(path, TABLE if four else content, appendmat=False, **options)

    return save


class Format(NamedTuple):
    """How a recording of a format is made, and the columns of its accelerometers."""

    make: Callable[[Path], Any]
    columns: tuple[str, ...] = OWN


IMU = tuple(f"/imu/data_raw.linear_acceleration.{axis}" for axis in "xyz")
FORMATS: dict[str, Format] = {
    "csv": Format(save_csv),
    "npz": Format(lambda path: np.savez_compressed(path, allow_pickle=False, **TABLE)),
    "parquet": Format(lambda path: pq.write_table(pa.table(TABLE), path)),
    "v4.mat": Format(save_mat(format="4")),
    "v6.mat": Format(save_mat()),
    "v7.mat": Format(save_mat(do_compression=True)),
    "v73.mat": Format(lambda path: save_v73(path, {k: v[:, None] for k, v in TABLE.items()})),
    "h5": Format(save_hdf5),
    "xlsx": Format(lambda path: workbook(path, [list(TABLE), *ROWS])),
    "ulg": Format(
        lambda path: path.write_bytes(ulog_bytes(SAMPLES, parameters=PX4)),
        tuple(f"sensor_accel.{axis}" for axis in "xyz"),
    ),
    "bin": Format(
        lambda path: path.write_bytes(dataflash_bytes(SAMPLES, parameters=ARDUPILOT)),
        ("IMU.AccX", "IMU.AccY", "IMU.AccZ"),
    ),
    "bag": Format(lambda path: write_bag(path, messages(SAMPLES, True), "LZ4"), IMU),
    "db3": Format(lambda path: write_bag2(path, messages(SAMPLES, False)), IMU),
    "mcap": Format(lambda path: write_bag2(path, messages(SAMPLES, False), "STORAGE"), IMU),
}


def mutated(raw: bytes, rng: random.Random) -> bytes:
    """Return bytes with some replaced, removed or put in, at the begin more often."""
    made = bytearray(raw)
    for _ in range(rng.choice((1, 1, 2, 5, 30))):
        if len(made) < 200:
            break
        at = rng.randrange(min(len(made), 2000) if rng.random() < 0.5 else len(made))
        match rng.randrange(6):
            case 0 | 1:
                made[at] = rng.randrange(256)
            case 2:
                made[at : at + 8] = rng.choice((b"\xff" * 8, bytes(8), b"\xff\xff\xff\x7f" * 2))
            case 3:
                del made[at : at + rng.choice((1, 2, 8, 100))]
            case 4:
                made[at:at] = rng.randbytes(rng.choice((1, 4, 50)))
            case _:
                del made[max(at, 200) :]
    return bytes(made)


def mutated_within(raw: bytes, rng: random.Random) -> bytes:
    """Return bytes that are changed below their compression, where its checks do not see it."""
    if raw.startswith(b"PK"):
        packed = BytesIO()
        with zipfile.ZipFile(BytesIO(raw)) as old, zipfile.ZipFile(packed, "w") as new:
            changed = rng.choice(old.namelist())
            for name in old.namelist():
                content = old.read(name)
                new.writestr(name, mutated(content, rng) if name == changed else content)
        return packed.getvalue()
    if raw.startswith(b"MATLAB 5.0") and raw[128] == 15:
        made, at = raw[:128], 128
        while at < len(raw):
            size = struct.unpack_from("<I", raw, at + 4)[0]
            inner = zlib.decompress(raw[at + 8 : at + 8 + size])
            packed_element = zlib.compress(mutated(inner, rng) if rng.random() < 0.5 else inner)
            made += struct.pack("<2I", 15, len(packed_element)) + packed_element
            at += 8 + size
        return made
    return mutated(raw, rng)


def outcomes(name: str, folder: Path, seed: int, count: int) -> dict[str, Any]:
    """Return how many mutations of a format were read and refused, and what they cost.

    Raises
    ------
    Exception
        Anything but an `InputError` of one line.
    """
    kind = FORMATS[name]
    path = folder / f"recording.{name}"
    kind.make(path)
    raw, rng = path.read_bytes(), random.Random(f"{name} {seed}")
    axes = tuple(zip(OWN, kind.columns, ("m/s²",) * 3, strict=True))
    told: Counter[str] = Counter()
    slowest = 0.0
    for number in range(count):
        path.write_bytes((mutated_within if rng.random() < 0.5 else mutated)(raw, rng))
        begin = perf_counter()
        try:
            if rng.random() < 0.5:
                read_recording(path, Columns(axes, time="time"))
            else:
                read_table(path)
        except InputError as error:
            if not str(error) or "\n" in str(error):
                raise AssertionError(f"{name} {number}: {error!r}") from error
            text = str(error)
            told[
                "limit" if "the limit for" in text else "crash" if "crashes" in text else "refused"
            ] += 1
        else:
            told["read"] += 1
        if perf_counter() - begin > slowest:
            slowest = perf_counter() - begin
    return {"told": dict(told), "slowest": slowest}


def main() -> None:
    """Print the outcomes, with the largest memory of this process and of those it started, kB."""
    from inercal.recordings.io import isolation

    name, seed, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    with tempfile.TemporaryDirectory() as folder:
        found = outcomes(name, Path(folder), seed, count)
    isolation.end_all()
    # The largest size of a process itself counts that of the process that started it.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    own = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert own is not None
    found["memory"] = [int(own[1]), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
