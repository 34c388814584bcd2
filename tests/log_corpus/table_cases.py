"""Tables of means: six positions, many poses, a dividing head, a rate table; and long soaks."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from tests.log_corpus.motion import FACE_TILT, FACES, G0, Array, coefficients, means, truth_of
from tests.log_corpus.text_forms import Written

NOISE = 2e-4 * G0  # m/s², of a mean
ARCSEC = np.radians(1 / 3600)
EARTH_HOUR = 15.041067  # °/h
LATITUDE = 48.1  # °


def _write(
    path: Path, head: Sequence[str], rows: Sequence[Sequence[str]], separator: str = ","
) -> Path:
    lines = [separator.join(row) for row in ([head] if head else []) + list(rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def table_of_means(
    count: int,
    names: Sequence[str] = (),
    head: Sequence[str] = (),
    unit: str = "g",
    separator: str = ",",
) -> Callable[[Path, int, float], Written]:
    """Return the writer of a table of poses, or of the six faces if `count` is 0.

    Parameters
    ----------
    count : int
    names : sequence of str
        Names of the rows; none without a first column of names.
    head : sequence of str
        Names of the columns; none without a header.
    unit : str
        "g", "mg", "m/s²", or a number of counts for 1 g.
    separator : str
    """

    def write(folder: Path, seed: int, gravity: float) -> Written:
        force, truth = means(seed, count, NOISE, gravity)
        size = {"g": G0, "mg": G0 / 1e3, "m/s²": 1.0}.get(unit)
        values = force / (size or G0 / float(unit))
        digits = 5 if unit in ("g", "m/s²") else 1
        order = np.arange(len(force)) if count else np.argsort([3, 0, 4, 1, 5, 2])
        cells = [[f"{one:.{digits}f}" for one in values[k]] for k in order]
        if names:
            cells = [[names[k], *row] for k, row in zip(order.tolist(), cells, strict=True)]
        path = _write(folder / "means.txt", head, cells, separator)
        first = 2 if names else 1
        places = (first, first + 1, first + 2)
        columns: tuple[object, ...] = tuple(head[p - 1] for p in places) if head else places
        units = {"accelerometer": unit if size else "LSB"}
        scales = {} if size else {"accelerometer": float(unit) / G0}
        return Written((path,), {"accelerometer": columns}, units, scales, truth)

    return write


def dividing_head(count: int, axes: str, unit: str = "g") -> Callable[[Path, int, float], Written]:
    """Return the writer of readings of one or two accelerometers on a dividing head.

    Its errors are those that a draft assumes: harmonics and graduations of 1″, a zero off by 10″,
    a lean of 20″ and a base that tilts by 0.1″.
    """

    def write(folder: Path, seed: int, gravity: float) -> Written:
        rng = np.random.default_rng(seed)
        angle = 2 * np.pi * np.arange(count) / count
        waves = rng.normal(0, ARCSEC, (2, 2))
        error = sum(
            a * np.cos(k * angle) + b * np.sin(k * angle) for k, (a, b) in enumerate(waves, 1)
        )
        error = error + rng.normal(0, ARCSEC, count) + rng.normal(0, 10 * ARCSEC)
        turned = angle + error + rng.normal(0, 0.1 * ARCSEC, count)
        lean = rng.normal(0, 20 * ARCSEC)
        along = gravity * np.cos(lean) * np.stack([np.sin(turned), np.cos(turned)], axis=-1)
        bias, scale = rng.normal(0, 0.02, 2), rng.normal(0, 2e-3, 2)
        read = along * (1 + scale) + bias + rng.normal(0, 2e-4, along.shape)
        values = read[:, : len(axes)] / (G0 if unit == "g" else 1.0)
        rows = [
            [f"{np.degrees(t):g}", *(f"{one:.7f}" for one in row)]
            for t, row in zip(angle, values, strict=True)
        ]
        path = _write(folder / "head.csv", ("angle", *axes), rows)
        truth: dict[str, float] = {}
        for k, axis in enumerate(axes):
            truth |= {f"{axis.lower()}.k0": bias[k], f"{axis.lower()}.k1": scale[k]}
        return Written((path,), {"accelerometer": tuple(axes)}, {"accelerometer": unit}, {}, truth)

    return write


def rate_table(
    speeds: Sequence[float], per_degree: float = 0.0, rate_unit: str = "°/s"
) -> Callable[[Path, int, float], Written]:
    """Return the writer of the means of three gyros on a rate table, with each axis up and down."""

    def write(folder: Path, seed: int, gravity: float) -> Written:
        rng = np.random.default_rng(seed)
        matrix = np.diag(rng.normal(0, 0.005, 3)) + (1 - np.eye(3)) * rng.normal(0, 0.003, (3, 3))
        bias = np.radians(rng.normal(0, 0.3, 3))
        shared, asymmetry = rng.normal(0, 500e-6), rng.normal(0, 100e-6)
        rows: list[list[str]] = []
        for axis, sense in FACES.values():
            up = np.eye(3)[axis] * sense
            tilt = rng.normal(0, np.radians(0.05), 2)
            side, other = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            up = up + tilt[0] * side + tilt[1] * other
            up /= np.linalg.norm(up)
            for speed in speeds:
                error = 1 + shared + asymmetry * np.sign(speed) + rng.normal(0, 100e-6)
                earth = EARTH_HOUR / 3600 * np.sin(np.radians(LATITUDE))
                rate = np.radians(speed * error + earth) * up
                read = rate + matrix @ rate + bias + rng.normal(0, np.radians(3e-4), 3)
                shown = np.degrees(read) * (per_degree or 1.0)
                digits = 1 if per_degree else 6
                named = speed / 6 if rate_unit == "rpm" else speed
                rows.append(
                    [f"{'-' if sense < 0 else '+'}{'xyz'[axis]}", f"{named:.8g}"]
                    + [f"{one:.{digits}f}" for one in shown]
                )
        head = ("axis", "rpm" if rate_unit == "rpm" else "rate", "gx", "gy", "gz")
        path = _write(folder / "rates.csv", head, rows)
        units = {"gyro": "LSB" if per_degree else "°/s"}
        scales = {"gyro": per_degree / np.radians(1)} if per_degree else {}
        truth = truth_of(matrix, bias, "g")
        return Written((path,), {"gyro": ("gx", "gy", "gz")}, units, scales, truth)

    return write


SLOPES = np.array([[2e-4, -1e-4, 3e-4], [40e-6, -25e-6, 30e-6]])  # of bias, m/s²/K, and scale, 1/K


def soaks(one_file: bool, named: bool = True) -> Callable[[Path, int, float], Written]:
    """Return the writer of six faces at each of three temperatures, in three files, or in one.

    One file may have a column that names the faces.
    """

    def write(folder: Path, seed: int, gravity: float) -> Written:
        rng = np.random.default_rng(seed)
        matrix, bias, _ = coefficients(rng)
        hz, files, rows, start = 25.0, [], [], 0.0
        for celsius in (-10.0, 20.0, 50.0):
            force, faces = _faces(rng, gravity, int(8 * hz), int(2 * hz))
            warm = celsius + 0.2 * np.sin(np.arange(len(force)) / hz / 50)
            dT = (warm - 20.0)[:, None]
            read = force + force @ matrix.T + bias + dT * SLOPES[0] + force * dT * SLOPES[1]
            read = read + rng.normal(0, 0.01, read.shape)
            time = start + np.arange(len(force)) / hz
            made = [
                [f"{t:.2f}", *(f"{one:.5f}" for one in x), f"{c + rng.normal(0, 0.02):.2f}"]
                for t, x, c in zip(time, read / G0, warm, strict=True)
            ]
            rows += [[*row, face] for row, face in zip(made, faces, strict=True)]
            start = float(time[-1]) + 3600.0  # of the chamber, without a record
            if not one_file:
                head = ("t", "ax", "ay", "az", "temp")
                files.append(_write(folder / f"soak_{celsius:+.0f}C.csv", head, made))
        if one_file:
            count = 6 if named else 5
            head = ("t", "ax", "ay", "az", "temp", "face")[:count]
            files = [_write(folder / "soaks.csv", head, [row[:count] for row in rows])]
        truth = truth_of(matrix, bias, "a")
        for k, x in enumerate("xyz"):
            truth |= {f"a{x}.k0_dT": SLOPES[0, k], f"a{x}.k1_dT": SLOPES[1, k]}
        columns = {"accelerometer": ("ax", "ay", "az")}
        return Written(tuple(files), columns, {"accelerometer": "g"}, {}, truth)

    return write


def _faces(
    rng: np.random.Generator, gravity: float, still: int, moving: int
) -> tuple[Array, list[str]]:
    """Return the force on six faces and their names, with a shaky quarter turn before each."""
    parts: list[Array] = []
    names: list[str] = []
    before = np.array([0.0, -1.0, 0.0])
    for name, (axis, sense) in FACES.items():
        up = np.eye(3)[axis] * sense
        up = up + np.delete(np.eye(3), axis, axis=0).T @ rng.normal(0, FACE_TILT, 2)
        up /= np.linalg.norm(up)
        share = (0.5 - 0.5 * np.cos(np.pi * (np.arange(moving) + 0.5) / moving))[:, None]
        path = before * np.cos(share * np.pi / 2) + up * np.sin(share * np.pi / 2)
        parts.append(gravity * path + rng.normal(0, 0.4, path.shape))
        parts.append(np.tile(gravity * up, (still, 1)))
        names += [""] * moving + [name] * still
        before = up
    return np.concatenate(parts), names


WORDS = ("x up", "y up", "z up", "x down", "y down", "z down")
TABLES: dict[str, Callable[[Path, int, float], Written]] = {
    "six positions": table_of_means(0, tuple(FACES), ("position", "ax", "ay", "az")),
    "six positions in words": table_of_means(0, WORDS, ("side", "X", "Y", "Z"), "m/s²"),
    "six positions without names": table_of_means(0, (), ("ax", "ay", "az"), "mg"),
    "six positions of counts": table_of_means(0, (), ("x", "y", "z"), "16384", "\t"),
    "magneto": table_of_means(24, (), (), "m/s²", "\t"),
    "magneto in mg": table_of_means(40, (), (), "mg", " "),
    "poses": table_of_means(30, tuple(f"p{k}" for k in range(30)), ("pose", "ax", "ay", "az")),
    "poses of counts": table_of_means(24, (), ("x", "y", "z"), "4096"),
    "dividing head": dividing_head(12, "AB"),
    "dividing head in m/s²": dividing_head(24, "AB", "m/s²"),
    "tumble": dividing_head(36, "A"),
    "soak files": soaks(one_file=False),
    "soaks with names": soaks(one_file=True),
    "soaks in one file": soaks(one_file=True, named=False),
}
RATES: dict[str, Callable[[Path, int, float], Written]] = {
    "rate table": rate_table((0, 50, -50, 100, -100, 200, -200)),
    "rate table of counts": rate_table((0, 20, -20, 80, -80, 160, -160), per_degree=65.5),
    "rate table in rpm": rate_table((0, 6, -6, 30, -30, 60, -60, 120, -120), rate_unit="rpm"),
}
