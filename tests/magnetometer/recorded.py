"""Run files with readings of the independent generator: tables of means, and recordings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tests.magnetometer import generator as sim
from tests.magnetometer.calibrations import FACES, LATITUDE

RATE_HZ, STILL, MOVING = 20.0, 4.0, 1.5  # of a recording; duration of a rest and of a turn, s
UNITS = {"µT": 1e6, "G": 1e4, "mG": 1e7, "LSB": 6.67e6}  # per T


def table(
    folder: Path,
    data: sim.Data,
    attitude: np.ndarray,
    rng: np.random.Generator,
    *,
    unit: str = "µT",
    stated: str | None = None,
    method: str = "multi_position",
    sensor: Sequence[str] = (),
    **bench: str,
) -> Path:
    """Write means and a run file that states `bench`, and return the path of the run file.

    The columns are in `unit`, which the run file states too, unless it states another.
    """
    f = sim.G * attitude[:, 2] + sim.SIGMA_F * rng.standard_normal((len(attitude), 3))
    rows = np.hstack([f, data.reading * UNITS[unit]])
    lines = ["position,ax,ay,az,mx,my,mz"]
    for name, row in zip(labels(attitude, method), rows, strict=True):
        lines.append(f"{name},{','.join(f'{x:.9g}' for x in row)}")
    (folder / "means.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    keys = (
        'kind = "means"\nlabel = "position"\n'
        f'sd = {{accelerometer = "{sim.SIGMA_F} m/s²", magnetometer = "{sim.SIGMA_M * 1e9} nT"}}'
    )
    return run_file(folder, "means.csv", keys, stated or unit, method, sensor, bench)


def labels(attitude: np.ndarray, method: str) -> list[str]:
    """Return the name of each rest: a face with the number of the visit, or a number."""
    if method == "multi_position":
        return [f"r{k + 1}" for k in range(len(attitude))]
    faces = [FACES[tuple(up)] for up in np.rint(attitude[:, 2]).astype(int).tolist()]
    return [
        face + (f" ({n})" if (n := 1 + faces[:k].count(face)) > 1 else "")
        for k, face in enumerate(faces)
    ]


def recording(
    folder: Path,
    attitude: np.ndarray,
    own: sim.Device,
    rng: np.random.Generator,
    *,
    every: int = 1,
    full_scale: float = np.inf,
    constant: Sequence[int] = (),
    disturbance: np.ndarray | None = None,
    sensor: Sequence[str] = (),
    **bench: str,
) -> Path:
    """Write a recording of rests and turns between them, without gyros, and its run file.

    The magnetometer has a new value at every sample number that `every` divides, is limited to
    `full_scale` (T), and the axes `constant` read 0. `disturbance` (n, 3) is added to the field
    (north, west, up) from the start of each rest.
    """
    still, moving = int(STILL * RATE_HZ), int(MOVING * RATE_HZ)
    part = np.arange(1, moving + 1) / (moving + 1)
    angle = part - np.sin(2 * np.pi * part) / (2 * np.pi)
    way, change = list[np.ndarray](), list[np.ndarray]()
    extra = np.zeros((len(attitude), 3)) if disturbance is None else disturbance
    for k, one in enumerate(attitude):
        way.append(np.tile(one, (still, 1, 1)))
        if k < len(attitude) - 1:
            vector = sim.turns_between(attitude[k : k + 2])[0]
            way.append(one @ sim.rotation(angle[:, None] * vector))
        change.append(np.tile(extra[k], (len(np.concatenate(way)) - sum(map(len, change)), 1)))
    path = np.concatenate(way)
    data = sim.rests(
        rng,
        path,
        own,
        sigma_m=sim.SIGMA_M * np.sqrt(still),
        disturbance=np.concatenate(change),
    )
    m = np.clip(data.reading, -full_scale, full_scale)
    m = m[np.arange(len(m)) // every * every]
    m[:, list(constant)] = 0.0
    f = sim.G * path[:, 2] + sim.SIGMA_F * np.sqrt(still) * rng.standard_normal((len(path), 3))
    t = np.arange(len(path)) / RATE_HZ
    text = "\n".join(
        ",".join(f"{x:.9g}" for x in row) for row in np.column_stack([t, f, 1e6 * m]).tolist()
    )
    (folder / "recording.csv").write_text(f"t,ax,ay,az,mx,my,mz\n{text}\n", encoding="utf-8")
    keys = f'rate = "{RATE_HZ} Hz"\ntime = "t"'
    return run_file(folder, "recording.csv", keys, "µT", "multi_position", sensor, bench)


def run_file(
    folder: Path,
    data: str,
    keys: str,
    unit: str,
    method: str,
    sensor: Sequence[str],
    bench: dict[str, str],
) -> Path:
    """Write a run file for accelerometers and magnetometers, and return its path."""
    stated = {"gravity": f"{sim.G} m/s² ± 0.0001 m/s²", **bench}
    if method == "six_position":
        stated["tilt"] = "0.5°"
    if "hemisphere" not in stated and "dip" not in stated:
        stated["latitude"] = f"{np.degrees(LATITUDE)}°"
    text = [
        '[sensor]\nname = "unit"\n[sensor.accelerometer]\nunit = "m/s²"',
        "[sensor.magnetometer]",
        f'unit = "{unit}"',
        *sensor,
        "[bench]",
        *(f'{key} = "{value}"' for key, value in stated.items()),
        f'[data]\nfile = "{data}"\n{keys}',
        'accelerometer = ["ax", "ay", "az"]\nmagnetometer = ["mx", "my", "mz"]',
        f'[method]\nname = "{method}"\n',
    ]
    path = folder / "run.toml"
    path.write_text("\n".join(text), encoding="utf-8")
    return path
