"""Logs, bags and sheets with bytes changed anywhere: read, or refused by one line."""

import random
from pathlib import Path

import pytest
from tests.fuzz.test_mutated_toml import require_one_line

from inercal.errors import InputError
from inercal.io.read import Columns, read_recording

LOGS = Path(__file__).parents[2] / "examples" / "logs"
FILES: dict[str, tuple[str, tuple[str, ...]]] = {
    "px4.ulg": ("pyulog", tuple(f"sensor_combined.accelerometer_m_s2[{k}]" for k in range(3))),
    "ardupilot.bin": ("numpy", ("IMU.AccX", "IMU.AccY", "IMU.AccZ")),
    "ros.mcap": ("rosbags", tuple(f"/imu/data_raw.linear_acceleration.{k}" for k in "xyz")),
    "workbook.xlsx": ("openpyxl", ("acc_x", "acc_y", "acc_z")),
    "logger.csv": ("numpy", ("acc_x", "acc_y", "acc_z")),
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


@pytest.mark.parametrize("count", [20, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FILES)
def test_a_mutated_log_is_read_or_refused_by_one_line(name: str, count: int, tmp_path: Path):
    library, names = FILES[name]
    pytest.importorskip(library, reason=f"needs the extra for {library}")
    axes = tuple(zip(("ax", "ay", "az"), names, ("m/s²",) * 3, strict=True))
    rng, raw, refused = random.Random(count), (LOGS / name).read_bytes(), 0
    path = tmp_path / name
    for _ in range(count):
        path.write_bytes(mutated(raw, rng))
        try:
            read_recording(path, Columns(axes, time="time"))
        except InputError as error:
            refused += 1
            require_one_line(error)
    assert refused > count / 3
