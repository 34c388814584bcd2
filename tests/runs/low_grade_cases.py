"""Runs of sensors as crude as the cheapest are delivered, for every method, by other generators.

One standard deviation: 8 % of scale, .05 of cross-axis, .15 g of bias. Gyros the same, with 2 °/s.
"""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import centrifuge, dividing_head, handheld, rate_table, tumble, turntable
from tests.accuracy.ferraris import DEGREE, G0, Handling, Imu, record

Array = NDArray[np.float64]
SCALE, CROSS, BIAS, GYRO_BIAS = 0.08, 0.05, 0.15, 2 * DEGREE  # 1, 1, g, rad/s
SENSOR = '[sensor]\nname = "crude"\n[sensor.accelerometer]\nunit = "m/s²"\n'
GYRO = '[sensor.gyro]\nunit = "rad/s"\n'


class LowGradeCase(NamedTuple):
    """A run file with its data beside it, and the truth by coefficient, SI."""

    path: Path
    truth: Mapping[str, float]


def matrix(rng: np.random.Generator) -> Array:
    made = CROSS * rng.standard_normal((3, 3))
    made[np.diag_indices(3)] = 1 + SCALE * rng.standard_normal(3)
    return made


def device(
    rng: np.random.Generator, white_a: float = 100e-6 * G0, white_g: float = 0.005 * DEGREE
) -> Imu:
    return Imu(
        matrix(rng),
        BIAS * G0 * rng.standard_normal(3),
        matrix(rng),
        GYRO_BIAS * rng.standard_normal(3),
        np.zeros((3, 3)),
        white_a=white_a,
        white_g=white_g,
    )


def affine_coefficients(matrix: Array, bias: Array) -> dict[str, float]:
    """Return accelerometers' coefficients of y = H f + b, b in m/s²."""
    zeros = np.zeros((3, 3))
    return Imu(matrix, bias, np.eye(3), np.zeros(3), zeros).coefficients()


def write_recording_run(
    folder: Path, text: str, truth: Mapping[str, float], **columns: object
) -> LowGradeCase:
    """Write a recording and its run file; columns by name."""
    arrays: dict[str, Any] = {name: np.asarray(c) for name, c in columns.items()}
    np.savez(folder / "data.npz", **arrays)
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return LowGradeCase(folder / "run.toml", truth)


def write_table_run(
    folder: Path, text: str, truth: Mapping[str, float], **columns: object
) -> LowGradeCase:
    """Write a table of means and its run file; columns by name."""
    rows = zip(*(np.asarray(c).tolist() for c in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    (folder / "data.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return LowGradeCase(folder / "run.toml", truth)


def channel_columns(data: Array) -> dict[str, Array]:
    return dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), data.T, strict=False))


HAND = """[bench]
gravity = "9.81 m/s² ± 0 m/s²"
tilt = "0.1 °"
{turning}[data]
file = "data.npz"
time = "time"
accelerometer = ["ax", "ay", "az"]
"""
TURNING = 'turn_angle = "0.5 °"\nturn_tilt = "0.3 °"\n'
HANDS = Handling(tilt=0.1 * DEGREE, turn_angle=0.5 * DEGREE, turn_tilt=0.3 * DEGREE)


def six_position_case(folder: Path, seed: int, method: str, *, marked: bool = True) -> LowGradeCase:
    """Return six positions, or six positions and three turns."""
    rng = np.random.default_rng([seed, 606])
    imu = device(rng)
    turning = method == "ferraris"
    turns: dict[str, Any] = {} if turning else {"turns": {}}
    made = record(imu, HANDS, rng, hold_seconds=6.0, turn_seconds=6.0, moves=True, **turns)
    text = (
        SENSOR
        + GYRO * turning
        + HAND.format(turning=TURNING * turning)
        + 'gyro = ["gx", "gy", "gz"]\n' * turning
    )
    text += 'label = "label"\nmarks = "labels"\n' * marked
    text += f'[method]\nname = "{method}"\n' + 'turn_seconds = "6 s"\n' * turning
    data = channel_columns(made.data[0][:, : 6 if turning else 3])
    return write_recording_run(
        folder, text, imu.coefficients(), time=made.time, label=made.labels(), **data
    )


def six_means_case(folder: Path, seed: int) -> LowGradeCase:
    """Return six positions as a table of means."""
    rng = np.random.default_rng([seed, 607])
    imu = device(rng)
    made = record(imu, HANDS, rng, hold_seconds=6.0, turns={})
    data = np.array([made.data[0, a:b, :3].mean(axis=0) for a, b in made.marks.values()])
    text = SENSOR + HAND.format(turning="").replace('time = "time"\n', "").replace("npz", "csv")
    text += 'kind = "means"\nlabel = "label"\nsd.accelerometer = "41 µg"\n'
    text += '[method]\nname = "six_position"\n'
    return write_table_run(
        folder, text, imu.coefficients(), label=list(made.marks), **channel_columns(data)
    )


def multi_position_case(folder: Path, seed: int) -> LowGradeCase:
    """Return twenty-four attitudes by hand."""
    rng = np.random.default_rng([seed, 608])
    imu = handheld.triangular(device(rng))
    made = handheld.record(imu, handheld.Session(), rng)
    text = SENSOR + GYRO + HAND.format(turning="").replace('tilt = "0.1 °"\n', "")
    text += 'gyro = ["gx", "gy", "gz"]\n[method]\nname = "multi_position"\n'
    truth = imu.coefficients()
    return write_recording_run(folder, text, truth, time=made.time, **channel_columns(made.data[0]))


CENTRIFUGE = """[sensor]
name = "crude"
[sensor.accelerometer]
unit = "V"
scale = "1 V/g"
[bench]
kind = "centrifuge"
gravity = "9.80665 m/s² ± 0 m/s²"
latitude = "0 ° ± 0 °"
radius = "1 m ± 0 m"
tilt = "0 ″"
MORE
[data]
kind = "means"
file = "data.csv"
label = "position"
accelerometer = ["ax", "ay", "az"]
arm_rate = "rpm"
sd.accelerometer = "100 µV"
"""


def centrifuge_case(folder: Path, seed: int) -> LowGradeCase:
    """Return norms of a triad whose axes are not square."""
    rng = np.random.default_rng([seed, 609])
    # The frame of norms: x along the first input axis, y in the plane of the first two.
    imu = handheld.triangular(device(rng))
    places = [*centrifuge.full_circle(), *centrifuge.printed_attitudes()]
    force, rate = centrifuge.sensed_motion(places, centrifuge.RATES, gravity=G0)
    y = force * centrifuge.PAPER_G / G0 @ imu.M_a.T + imu.b_a / G0
    y = y + 1e-4 * rng.standard_normal(y.shape)
    names = [f"p{k:02d}" for k in range(len(places))] * len(centrifuge.RATES)
    text = CENTRIFUGE.replace("MORE\n", "")
    text += '[method]\nname = "centrifuge_norm"\nalso = ["nonorthogonality"]\n'
    return write_table_run(
        folder,
        text,
        imu.coefficients(),
        position=names,
        rpm=rate * 30 / np.pi,
        **channel_columns(y),
    )


def dividing_head_case(folder: Path, seed: int, method: str) -> LowGradeCase:
    """Return one accelerometer, or two, on a dividing head."""
    rng = np.random.default_rng([seed, 610])
    count = 2 if method == "dual_orthogonal" else 1
    psi = dividing_head.angles(12, reverse=True)
    parts = [
        tumble.Device(
            BIAS * rng.standard_normal(),
            SCALE * rng.standard_normal(),
            CROSS * rng.standard_normal(),
            turned=True,
        )
        for _ in range(count)
    ]
    off = np.radians(3 / 3600) * rng.standard_normal(12)
    true = psi + np.concatenate([off, off[::-1]])
    columns = {"AB"[k]: one.reading(true + k * np.pi / 2) for k, one in enumerate(parts)}
    columns = {n: 3 * (y + 1e-6 * rng.standard_normal(24)) for n, y in columns.items()}
    named = ", ".join(f'"{name}"' for name in columns)
    text = f"""[sensor]
name = "crude"
[sensor.accelerometer]
unit = "V"
scale = "3 V/g"
[bench]
kind = "dividing_head"
gravity = "9.80665 m/s² ± 0 m/s²"
harmonics = ["0 ″", "0 ″"]
division = "3 ″"
autocollimation = "none"
base = "5 ″"
pier = "0 ″"
lean = "0 ″"
drift = "0 µg"
[data]
file = "data.csv"
kind = "means"
accelerometer = [{named}]
angle = "angle"
sd.accelerometer = "1 µg"
[method]
name = "{method}"
"""
    if method == "dual_orthogonal":
        text += "[method.prior]\n" + "".join(
            f'"{a}.kip" = "0 ± 20 µg/g²"\n"{a}.k3" = "0 ± 5 µg/g³"\n' for a in "ab"
        )
    truth = {
        f"{name}.{term}": value
        for name, one in zip("ab", parts, strict=False)
        for term, value in (("k0", one.k0 * G0), ("k1", one.k1), ("delta_o", one.delta))
    }
    return write_table_run(folder, text, truth, angle=np.degrees(psi), **columns)


SHIP = """[sensor]
name = "crude"
[sensor.accelerometer]
unit = "g"
[bench]
kind = "rate_table"
gravity = "9.80665 m/s² ± 0 m/s²"
radius = "250 mm ± 0 mm"
seat = "0.5 mm"
pose = "0.2 °"
speed = "0.05 %"
[data]
kind = "means"
file = "data.csv"
mounting = "mounting"
arm_rate = "rpm"
accelerometer = ["ax", "ay", "az"]
sd.accelerometer = "0.3 mg"
[method]
name = "METHOD"
estimator = "ESTIMATOR"
"""
CRUDE = rate_table.Bench(scale=SCALE, cross=CROSS, bias=BIAS)


def rate_table_case(folder: Path, seed: int, method: str, estimator: str) -> LowGradeCase:
    """Return states of a rate table as a table of means."""
    level = method == "ship_planar"
    states = rate_table.PLANAR if level else rate_table.PLANAR + rate_table.TILTED
    made = rate_table.draw(seed, 1, CRUDE, states)
    names = [
        plane + (f" {first:g}" if first else "") + (f" + {second:g}" if second else "")
        for plane, first, second, _ in states
    ]
    return write_table_run(
        folder,
        SHIP.replace("METHOD", method).replace("ESTIMATOR", estimator),
        affine_coefficients(made.matrix[0], made.bias[0] * G0),
        mounting=names,
        rpm=[state[3] for state in states],
        **channel_columns(made.readings[0]),
    )


def ship_recording_case(folder: Path, seed: int) -> LowGradeCase:
    """Return a recording on a rate table: rests and dwells at two speeds in nine mountings."""
    rng = np.random.default_rng([seed, 611])
    mat, bias = matrix(rng), BIAS * rng.standard_normal(3)
    hz, still = 50.0, np.zeros(400)
    ramps = [np.linspace(a, b, 200) for a, b in ((0, 46), (46, 86), (86, 0))]
    rpm = np.concatenate([still, ramps[0], np.full(800, 46.0), ramps[1], np.full(800, 86.0),
                          ramps[2]])  # fmt: skip
    w = rpm * rate_table.RPM
    blocks: list[Array] = []
    names: list[str] = []
    for plane in rate_table.PLANES:
        for tilt in (0.0, 30.0, 135.0):
            place = rate_table.columns(plane, tilt, None, "azimuth")
            along = np.gradient(w, 1 / hz) * rate_table.RADIUS / rate_table.G
            table_force = np.stack([w**2 * rate_table.RADIUS / rate_table.G, along, 0 * w + 1])
            blocks.append((mat @ place @ table_force).T + bias)
            names += [plane + (f" {tilt:g}" if tilt else "")] * w.size
    y = np.concatenate(blocks)
    y = y + 3e-3 * rng.standard_normal(y.shape)
    text = SHIP.replace('kind = "means"\n', 'rate = "50 Hz"\n').replace("csv", "npz")
    text = text.replace("METHOD", "ship_multi_angle").replace("ESTIMATOR", "joint")
    text = text.replace('sd.accelerometer = "0.3 mg"\n', "")
    for old, new in (
        ('pose = "0.2 °"', 'pose = "0.01 °"'),
        ("0.5 mm", "0.01 mm"),
        ("0.05", "0.01"),
    ):
        text = text.replace(old, new)
    truth = affine_coefficients(mat, bias * G0)
    rates = np.tile(rpm, 9)
    return write_recording_run(
        folder, text, truth, mounting=np.array(names), rpm=rates, **channel_columns(y)
    )


TURNTABLE = """[sensor]
name = "crude"
[sensor.accelerometer]
unit = "m/s²"
white = "60 µg/√Hz"
bias_instability = "15 µg"
[sensor.gyro]
unit = "rad/s"
white = "0.1 °/√h"
bias_instability = "0.5 °/h"
[bench]
kind = "turntable"
gravity = "9.80665 m/s² ± 0 m/s²"
latitude = "38 °"
azimuth = "0 ° ± 0.1 °"
lean = "5 ″"
square = "2 ″"
harmonics = ["1.4 ″", "0.7 ″"]
noise = "0.5 ″"
latency = "2 ms ± 0.1 ms"
[data]
file = "data.npz"
time = "time"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
table = ["outer", "middle", "inner"]
table_unit = "rad"
label = "step"
[method]
name = "METHOD"
path = "path.csv"
"""


def turntable_case(folder: Path, seed: int, method: str) -> LowGradeCase:
    """Return a short path of a three-axis turntable."""
    stands: list[turntable.Stand | turntable.Turn] = [("warm-up", (0, 0, 0), 30.0)]
    if method == "turntable_discrete":
        six = {"zp": (0, 0, 0), "yp": (0, 90, 0), "za": (0, 180, 0), "ya": (0, 270, 0),
               "xa": (0, 0, 90), "xp": (0, 0, -90)}  # fmt: skip
        for name, at in six.items():
            stands += [
                (name, at, 10.0),
                (f"{name}+", 0, 360.0, 30.0),
                (f"{name}-", 0, -360.0, 30.0),
            ]
    else:
        stands += [*turntable.positions(10.0), *turntable.turns(360.0, 30.0, back=True)]
    device = turntable.Device(GYRO_BIAS, BIAS * G0, SCALE, CROSS)
    made = turntable.draw(seed, 1, stands, device=device)
    lines = ["label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]"]
    for step in stands:
        if len(step) == 3:
            label, at, seconds = step
            lines.append(f"{label},position,{at[0]},{at[1]},{at[2]},{seconds:g},,,")
        else:
            label, axis, angle, rate = step
            lines.append(
                f"{label},rotation,,,,,{('outer', 'middle', 'inner')[axis]},{angle:g},{rate:g}"
            )
    (folder / "path.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    acc, gyro = made.acc[0], made.gyro[0]
    truth = Imu(
        np.eye(3) + acc[3:].reshape(3, 3),
        acc[:3],
        np.eye(3) + gyro[3:].reshape(3, 3),
        gyro[:3],
        np.zeros((3, 3)),
    ).coefficients()
    angles = dict(zip(("outer", "middle", "inner"), made.angles[0].T, strict=True))
    data = channel_columns(np.concatenate([made.forces[0], made.rates[0]], axis=1))
    text = TURNTABLE.replace("METHOD", method)
    return write_recording_run(
        folder, text, truth, time=made.time, step=made.labels, **data, **angles
    )


Maker = Callable[[Path, int], LowGradeCase]


@cache
def case_makers() -> Mapping[str, Maker]:
    """Return what makes a crude device's run, by method and kind of data."""
    made: dict[str, Maker] = {
        "six_position": lambda folder, seed: six_position_case(folder, seed, "six_position"),
        "six_position, rests found": lambda folder, seed: six_position_case(
            folder, seed, "six_position", marked=False
        ),
        "six_position, means": six_means_case,
        "ferraris": lambda folder, seed: six_position_case(folder, seed, "ferraris"),
        "multi_position": multi_position_case,
        "centrifuge_norm": centrifuge_case,
        "ship_multi_angle, recording": ship_recording_case,
        "ship_planar": lambda folder, seed: rate_table_case(folder, seed, "ship_planar", "planar"),
    }
    for method in ("dual_orthogonal", "tumble"):
        made[method] = lambda folder, seed, method=method: dividing_head_case(folder, seed, method)
    for name in ("joint", "planar_norm", "damped"):
        made[f"ship_multi_angle, {name}"] = lambda folder, seed, name=name: rate_table_case(
            folder, seed, "ship_multi_angle", name
        )
    for method in ("turntable_kalman", "turntable_discrete", "turntable_trajectory"):
        made[method] = lambda folder, seed, method=method: turntable_case(folder, seed, method)
    return made
