"""One recording of six positions, written as the logs of flight controllers and robots."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inercal.recordings.io.message_columns import euler_matrix

POSITIONS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
REST, MOVE = 25, 5  # samples
RATE_HZ = 10
BOOT_NS = 12_000_000_000
SCALE = np.array([1.004, 0.991, 1.012])
BIAS = np.array([0.21, -0.35, 0.11])  # m/s²
GYRO_BIAS = np.array([0.012, -0.021, 0.004])  # rad/s
DEVICE = 2424842


@dataclass(frozen=True, eq=False)
class Samples:
    """Raw readings, in single precision as logs hold them: (n, 3) m/s² and rad/s, (n,) °C."""

    ns: np.ndarray
    acc: np.ndarray
    gyr: np.ndarray
    temperature: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """S from the first sample."""
        return (self.ns - self.ns[0]) * 1e-9


def six_positions() -> Samples:
    """Return the readings of a sensor that is set down on each face and turned in between."""
    rng = np.random.default_rng(7)
    up = np.concatenate([[axis, -axis] for axis in np.eye(3)])
    force, rate = [], []
    for k, here in enumerate(up):
        there = up[(k + 1) % len(up)]
        force += [here] * REST
        path = np.linspace(0, 1, MOVE + 2)[1:-1, None]
        force += list((1 - path) * here + path * there + 0.2 * rng.normal(size=(MOVE, 3)))
        rate += [np.zeros(3)] * REST + list(rng.normal(size=(MOVE, 3)))
    n = len(force)
    acc = SCALE * (9.81 * np.array(force)) + BIAS + 0.004 * rng.normal(size=(n, 3))
    gyr = np.array(rate) + GYRO_BIAS + 0.001 * rng.normal(size=(n, 3))
    ns = BOOT_NS + np.arange(n) * (1_000_000_000 // RATE_HZ)
    celsius = 30 + 0.01 * np.arange(n)
    return Samples(ns, *(x.astype(np.float32) for x in (acc, gyr, celsius)))


def write_marks(path: Path) -> None:
    """Write the marks of the sections."""
    step = REST + MOVE
    marks = {name: {"start": k * step, "end": k * step + REST} for k, name in enumerate(POSITIONS)}
    path.write_text(json.dumps(marks, indent=1) + "\n", encoding="utf-8")


# --- PX4 ------------------------------------------------------------------------------------------

PX4: dict[str, float] = {
    "CAL_ACC0_ID": DEVICE,
    **dict(zip(("CAL_ACC0_XOFF", "CAL_ACC0_YOFF", "CAL_ACC0_ZOFF"), (0.2, -0.3, 0.1), strict=True)),
    **dict(
        zip(
            ("CAL_ACC0_XSCALE", "CAL_ACC0_YSCALE", "CAL_ACC0_ZSCALE"),
            (0.99, 1.01, 0.98),
            strict=True,
        )
    ),
    "CAL_GYRO0_ID": DEVICE,
    "CAL_GYRO0_XOFF": 0.01,
    "CAL_GYRO0_YOFF": -0.02,
    "CAL_GYRO0_ZOFF": 0.03,
    "SENS_BOARD_ROT": 6,
    "SENS_BOARD_X_OFF": 1.5,
    "SENS_BOARD_Y_OFF": -2.0,
    "SENS_BOARD_Z_OFF": 0.5,
}
FORMATS = {
    "sensor_accel": "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;"
    "float y;float z;float temperature;uint8_t[4] _padding0;",
    "sensor_gyro": "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;"
    "float y;float z;float temperature;uint8_t[4] _padding0;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "float[3] accelerometer_m_s2;",
    "sensor_selection": "uint64_t timestamp;uint32_t accel_device_id;uint32_t gyro_device_id;",
}


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def px4_corrected(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Return what PX4 makes of raw readings, by the formula of its sensor_calibration."""
    p = {k: float(np.float32(v)) for k, v in PX4.items()}
    board = euler_matrix(*(p[f"SENS_BOARD_{k}_OFF"] for k in "XYZ")) @ euler_matrix(0, 0, 270)
    offset = np.array([p[f"CAL_ACC0_{k}OFF"] for k in "XYZ"])
    scale = np.array([p[f"CAL_ACC0_{k}SCALE"] for k in "XYZ"])
    drift = np.array([p[f"CAL_GYRO0_{k}OFF"] for k in "XYZ"])
    acc = np.array([board @ ((raw - offset) * scale) for raw in samples.acc.astype(float)])
    gyr = np.array([board @ (raw - drift) for raw in samples.gyr.astype(float)])
    return acc, gyr


def ulog_bytes(
    samples: Samples,
    parameters: Mapping[str, float] = PX4,
    topics: tuple[str, ...] = tuple(FORMATS),
    after: bytes = b"",
) -> bytes:
    """Return a ULog file, built from the published format; `after` comes between the samples."""
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT_NS // 1000))
    out += message("B", bytes(40))
    for name in topics:
        out += message("F", f"{name}:{FORMATS[name]}".encode())
    for name, value in parameters.items():
        kind, code = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
        key = f"{kind} {name}".encode()
        out += message("P", bytes([len(key)]) + key + struct.pack(f"<{code}", value))
    for number, name in enumerate(topics):
        out += message("A", struct.pack("<BH", 0, number) + name.encode())
    acc, gyr = px4_corrected(samples)
    of = {name: struct.pack("<H", number) for number, name in enumerate(topics)}
    if "sensor_selection" in of:
        body = struct.pack("<QII", samples.ns[0] // 1000, DEVICE, DEVICE)
        out += message("D", of["sensor_selection"] + body)
    for k, ns in enumerate(samples.ns.tolist()):
        us = ns // 1000
        t = samples.temperature[k]
        bodies = {
            "sensor_accel": struct.pack("<QQI4f", us + 90, us, DEVICE, *samples.acc[k], t),
            "sensor_gyro": struct.pack("<QQI4f", us + 95, us + 2, DEVICE, *samples.gyr[k], t),
            "sensor_combined": struct.pack("<Q3fI3f", us, *gyr[k], 100, *acc[k]),
        }
        for name, body in bodies.items():
            if name in of:
                out += message("D", of[name] + body)
        if k == len(samples.ns) // 2:
            out += after
    return bytes(out)


# --- ArduPilot ------------------------------------------------------------------------------------

ARDUPILOT: dict[str, float] = {
    "INS_ACCOFFS_X": 0.15,
    "INS_ACCOFFS_Y": 2.5,
    "INS_ACCOFFS_Z": -0.3,
    "INS_ACCSCAL_X": 0.999,
    "INS_ACCSCAL_Y": 0.9,
    "INS_ACCSCAL_Z": 1.02,
    "INS_GYROFFS_X": -0.08,
    "INS_GYROFFS_Y": 0.01,
    "INS_GYROFFS_Z": 0.02,
    "AHRS_ORIENTATION": 8.0,
    "INS_ACC_ID": 1246730.0,
    "INS_GYR_ID": 2164234.0,
}
SIZES = {"Q": 8, "B": 1, "f": 4, "N": 16, "Z": 64, "n": 4, "c": 2, "I": 4, "H": 2}
TYPES = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNf", "TimeUS,Name,Value"),
    "IMU": (65, "QBffffffIIf", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T"),
    "MODE": (66, "Qc", "TimeUS,Level"),
}


def ardupilot_corrected(
    samples: Samples, parameters: Mapping[str, float] = ARDUPILOT
) -> tuple[np.ndarray, np.ndarray]:
    """Return what ArduPilot makes of raw readings: offset, scale, then half a turn of roll."""
    p = {k: float(np.float32(v)) for k, v in (ARDUPILOT | dict(parameters)).items()}
    acc = samples.acc - np.array([p[f"INS_ACCOFFS_{k}"] for k in "XYZ"])
    acc = acc * np.array([p[f"INS_ACCSCAL_{k}"] for k in "XYZ"]) * [1, -1, -1]
    gyr = (samples.gyr - np.array([p[f"INS_GYROFFS_{k}"] for k in "XYZ"])) * [1, -1, -1]
    return acc, gyr


def logged(name: str, *values: Any) -> bytes:
    """Return a message of a DataFlash log."""
    number, letters, _ = TYPES[name]
    codes = "<" + "".join({"N": "16s", "Z": "64s", "n": "4s", "c": "h"}.get(c, c) for c in letters)
    raw = [value.encode() if isinstance(value, str) else value for value in values]
    return b"\xa3\x95" + bytes([number]) + struct.pack(codes, *raw)


def dataflash_formats(types: Mapping[str, tuple[int, str, str]] = TYPES) -> bytes:
    return b"".join(
        logged("FMT", number, 3 + sum(SIZES[c] for c in letters), name, letters, columns)
        for name, (number, letters, columns) in types.items()
    )


def dataflash_bytes(
    samples: Samples, parameters: Mapping[str, float] = ARDUPILOT, after: bytes = b""
) -> bytes:
    """Return a DataFlash log of two IMUs; `after` comes between the samples."""
    out = bytearray(dataflash_formats())
    start = int(samples.ns[0] // 1000)
    for name, value in parameters.items():
        out += logged("PARM", start + 500, name, value)
    acc, gyr = ardupilot_corrected(samples, parameters)
    for k, ns in enumerate(samples.ns.tolist()):
        for instance in (0, 1):
            a, g = acc[k] + instance, gyr[k] + instance
            out += logged("IMU", ns // 1000, instance, *g, *a, 0, 0, samples.temperature[k])
        if k == len(samples.ns) // 2:
            out += after
    return bytes(out)


SAMPLES = six_positions()


def write_ardupilot(parameters: Mapping[str, float]) -> bytes:
    """Return a DataFlash log by a flight controller with some parameters changed."""
    return dataflash_bytes(SAMPLES, ARDUPILOT | dict(parameters))
