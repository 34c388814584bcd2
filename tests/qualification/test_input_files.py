"""Every kind of measurement from its input file: units, names of the bench, values and signs."""

from collections.abc import Sequence
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.qualification import laboratory as lab

from inercal.benches.qualification import Qualification
from inercal.benches.qualification.input_file import qualify

Array = NDArray[np.float64]
ARC = lab.ARCSEC
HOUR = radians(1) / 3600  # rad/s


def made(
    folder: Path, kind: str, bench: str, keys: str, **columns: Sequence[float] | Array
) -> Qualification:
    """Qualify readings of these columns."""
    if columns:
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(f"{x:.10g}" for x in row) for row in rows)]
        (folder / "readings.csv").write_text("\n".join(lines), encoding="utf-8")
    named = f'bench = "{bench}"\n' if bench else ""
    file = 'file = "readings.csv"\n' if columns else ""
    path = folder / "input.toml"
    path.write_text(
        f'[qualification]\nkind = "{kind}"\n{named}date = 2026-03-01\nmethod = "m"\n\n'
        f"[measurement]\n{file}{keys}\n",
        encoding="utf-8",
    )
    return qualify(path)


def require_value(found: Qualification, name: str, true: float) -> None:
    k = found.names.index(name)
    assert abs(found.parameters[k].value - true) < 3.5 * found.std[k]
    assert not found.suspects


def test_the_readback_of_an_axis_is_ahead_of_it_by_its_harmonics(tmp_path: Path):
    rng, n = np.random.default_rng(1), 24
    readback = np.arange(n) * 2 * pi / n
    waves = ARC * np.array([[3.0, -1.0]])
    axis = readback - lab.head_error(readback, waves)  # readback = angle + harmonics
    reading = (axis - readback) / ARC + 0.1 * rng.normal(size=n)
    (tmp_path / "flat.csv").write_text(
        "face,deviation\n" + "\n".join(f"{k + 1},0" for k in range(n)), encoding="utf-8"
    )
    found = made(
        tmp_path, "head_map", "turntable",
        'autocollimator = "0.1 ″"\nharmonics = 1\naxis = "inner"\npolygon = "flat.csv"',
        angle=np.degrees(readback), reading=reading,
    )  # fmt: skip
    require_value(found, "sin1[inner]", 3 * ARC)
    require_value(found, "cos1[inner]", -1 * ARC)


def test_a_closure_counts_faces_from_one(tmp_path: Path):
    rng, n = np.random.default_rng(2), 8
    place, series = np.tile(np.arange(n), n), np.repeat(np.arange(n), n)
    face = (place + series) % n
    theta, polygon = place * 2 * pi / n, ARC * rng.normal(0, 3, n)
    waves = ARC * np.array([[2.0, 1.0], [0.5, -0.5]])
    reading = lab.collimated(rng, theta, waves, polygon[face], 0.1 * ARC, 0) / ARC
    found = made(
        tmp_path, "head_map", "dividing_head",
        'autocollimator = "0.1 ″"\nface = "face"\nseries = "series"',
        angle=np.degrees(theta), reading=reading, face=(face + 1).tolist(), series=series.tolist(),
    )  # fmt: skip
    require_value(found, "sin1", 2 * ARC)
    require_value(found, "cos2", -0.5 * ARC)


def test_leans_and_right_angles_of_a_turntable(tmp_path: Path):
    rng = np.random.default_rng(21)
    theta = np.arange(12) * pi / 6
    reading = lab.level_on_table(
        rng, theta, (4 * ARC, -7 * ARC), radians(30), 9 * ARC, np.zeros((0, 2)), 0.2 * ARC
    )
    tilts = made(
        tmp_path, "table_tilt", "turntable", 'level = "0.2 ″"\nazimuth = "30 °"',
        angle=np.degrees(theta), reading=reading / ARC,
    )  # fmt: skip
    require_value(tilts, "lean_x", 4 * ARC)
    require_value(tilts, "lean_y", -7 * ARC)
    twice, sense = np.tile(theta, 2), np.repeat([1.0, -1.0], 12)
    reading = lab.level_on_axis(rng, twice, sense, 6 * ARC, (4 * ARC, -7 * ARC), 0, 0.2 * ARC)
    square = made(
        tmp_path, "right_angle", "turntable", 'level = "0.2 ″"\naxes = "zxy"',
        angle=np.degrees(twice), sense=sense, reading=reading / ARC,
    )  # fmt: skip
    require_value(square, "square_1", 6 * ARC)


def test_a_radius_by_a_machine_and_by_a_sensor(tmp_path: Path):
    rng = np.random.default_rng(4)
    machine = made(
        tmp_path, "radius", "rate_table",
        'by = "machine"\nreading_unit = "mm"\nreading_sd = "2 µm"\nmachine = "3 µm"',
        reading=250 + 0.002 * rng.normal(size=5),
    )  # fmt: skip
    assert machine.std[0] == pytest.approx(np.hypot(3e-6, 2e-6 / 5**0.5), rel=0.01)
    require_value(machine, "radius", 0.25)
    rpm = np.array([60.0, 60, 120, 120, 180, 180])
    reading = lab.arm_readings(
        rng, rpm * pi / 30, radius=0.25, stretch=0, scale=0, k2=0, rate_error=0, g_ratio=1,
        sd=3e-4,
    )  # fmt: skip
    sensor = made(
        tmp_path, "radius", "rate_table",
        'by = "sensor"\nreading_unit = "m/s²"\nreading_sd = "300 µm/s²"\nscale = "10 ppm"\n'
        'k2 = "0 µg/g² ± 1 µg/g²"\nrate_error = "2 ppm"',
        rate=rpm, reading=reading,
    )  # fmt: skip
    assert sensor.names == ("radius",)
    require_value(sensor, "radius", 0.25)


def test_rates_by_a_counter(tmp_path: Path):
    rng = np.random.default_rng(5)
    rate = np.array([50.0, 200, -50, -200])
    error = 100e-6 + 30e-6 * np.sign(rate)
    seconds = lab.count_times(rng, np.radians(rate), np.full(4, 10.0), error, 10e-6, 0)
    keys = 'timer = "10 µs"\nrate_unit = "°/s"'
    columns = {"rate": rate, "turns": np.full(4, 10.0), "seconds": seconds}
    platform = made(tmp_path, "rate", "rate_platform", keys, **columns)
    require_value(platform, "rate_scale", 100e-6)
    require_value(platform, "rate_asymmetry", 30e-6)
    one = made(tmp_path, "rate", "centrifuge", keys, **columns)
    assert one.suspects
    steady = np.full(10, 60.0)
    seconds = lab.count_times(
        rng, steady * pi / 30, np.full(10, 20.0), 5e-6 * rng.normal(size=10), 5e-6, 0
    )
    for bench, name in (
        ("centrifuge", "dwell_rate"), ("rate_platform", "rate_stability"), ("rate_table", "speed"),
    ):  # fmt: skip
        found = made(
            tmp_path, "rate_stability", bench, 'timer = "5 µs"',
            rate=steady, turns=np.full(10, 20.0), seconds=seconds,
        )  # fmt: skip
        assert found.names == (name,)
        assert found.parameters[0].value == 0
        assert 2e-6 < found.std[0] < 10e-6


def test_gravity_absolute_and_computed(tmp_path: Path):
    absolute = made(
        tmp_path, "gravity", "",
        'by = "absolute"\ngravity = "9.8012 m/s² ± 10 µGal"\nabove = "1 m"\ntide = "corrected"',
    )  # fmt: skip
    assert absolute.parameters[0].value == pytest.approx(9.8012 - 3.086e-6, abs=1e-12)
    assert absolute.std[0] == pytest.approx(np.hypot(1e-7, 3.086e-7), rel=1e-6)
    computed = made(tmp_path, "gravity", "", 'by = "computed"\nlatitude = "45 °"\nheight = "0 m"')
    assert computed.parameters[0].value == pytest.approx(9.80620, abs=1e-5)  # GRS 80
    assert computed.std[0] == pytest.approx(40e-5, rel=0.01)


def test_an_azimuth_by_the_earths_rate(tmp_path: Path):
    rng = np.random.default_rng(6)
    theta = np.arange(8) * pi / 4
    reading = lab.gyro_at(rng, theta, radians(92.3), 1e-3, radians(48), 2 * HOUR, 0.01 * HOUR)
    found = made(
        tmp_path, "azimuth", "turntable",
        'reading_sd = "0.01 °/h"\nlatitude = "48 °"\noffset = "0.001 rad ± 0.0001 rad"',
        angle=np.degrees(theta), reading=reading / HOUR,
    )  # fmt: skip
    require_value(found, "azimuth", radians(92.3))
    level = 15.041 * np.cos(radians(48))
    assert found.std[0] == pytest.approx(np.hypot(0.01 * 0.5 / level, 1e-4), rel=1e-3)
