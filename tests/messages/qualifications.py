"""Families of messages of qualify: its input file, its measurements, its file, and its use."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from inercal.benches.qualification.input_file import qualify
from inercal.benches.qualification.measurements.arms import RadiusSensor, radius_by_sensor
from inercal.benches.qualification.result import drift_between, load, save
from inercal.laboratory.check_standard.bench_charts import bench_charts
from inercal.laboratory.store import Register
from inercal.laboratory.store.uses import calibrations_of_bench
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples" / "qualify"
HEAD = """
[qualification]
kind = "head_map"
bench = "dividing_head"
date = 2026-03-01
method = "polygon and autocollimator"

[measurement]
file = "head.csv"
autocollimator = "0.1 ″"
harmonics = 1
polygon = "polygon.csv"
polygon_sd = "0.05 ″"
"""
RUN = """
[sensor]
name = "A"
[sensor.accelerometer]
unit = "g"
[bench]
kind = "hand"
qualification = "{file}"
{more}
[data]
file = "positions.csv"
kind = "means"
label = "position"
accelerometer = ["x", "y", "z"]
[data.sd]
accelerometer = "30 µg"
[method]
name = "six_position"
"""


def described(folder: Path, *changes: tuple[str, str], rows: str = "", faces: str = "") -> None:
    """Qualify a head with a changed input file or changed tables."""
    text = HEAD
    for old, new in changes:
        text = text.replace(old, new)
    (folder / "head.toml").write_text(text, encoding="utf-8")
    at = "".join(f"{30 * k},{0.1 * k:g}\n" for k in range(12))
    (folder / "head.csv").write_text(rows or f"angle,reading\n{at}", encoding="utf-8")
    of = "".join(f"{k + 1},0\n" for k in range(12))
    (folder / "polygon.csv").write_text(faces or f"face,deviation\n{of}", encoding="utf-8")
    qualify(folder / "head.toml")


def used(folder: Path, file: str = "gravity.qualification.json", more: str = "") -> None:
    """Read a run file that names a qualification of gravity."""
    save(load(EXAMPLES / "gravity.qualification.json"), folder / "gravity.qualification.json")
    (folder / "run.toml").write_text(RUN.format(file=file, more=more), encoding="utf-8")
    read(folder / "run.toml")


def withdrawn_and_used(folder: Path) -> None:
    found = load(EXAMPLES / "gravity.qualification.json")
    save(replace(found, withdrawn="gravimeter broken"), folder / "old.json")
    used(folder, "old.json")


def head_on_a_hand(folder: Path) -> None:
    save(load(EXAMPLES / "head.qualification.json"), folder / "head.json")
    used(folder, "head.json")


def successive(_: Path) -> None:
    one = load(EXAMPLES / "rate.qualification.json")
    drift_between(one, one)


def bench_of_the_register(folder: Path) -> None:
    with Register(str(folder / "register.db")) as opened:
        calibrations_of_bench(opened.calibrations(), "arm 1")


def unknown_quadratic_term(_: Path) -> None:
    rate = np.array([5.0, 10.0, 15.0])
    radius_by_sensor(rate, 0.5 * rate**2, RadiusSensor(1e-4, 1e-5, None, 1e-6), stretch=True)


CASES: dict[str, Callable[[Path], object]] = {
    "kind of measurement that is none": lambda folder: described(folder, ("head_map", "map")),
    "kind of bench that is none": lambda folder: described(folder, ("dividing_head", "lathe")),
    "bench that the kind does not qualify": lambda folder: described(
        folder, ("dividing_head", "rate_table")
    ),
    "key that the measurement needs": lambda folder: described(
        folder, ('autocollimator = "0.1 ″"\n', "")
    ),
    "key that the measurement does not have": lambda folder: described(
        folder, ("harmonics = 1", "waves = 1")
    ),
    "expiry before its date": lambda folder: described(
        folder, ("date = 2026-03-01", "date = 2026-03-01\nvalid_until = 2025-03-01")
    ),
    "table that is not there": lambda folder: described(folder, ('"head.csv"', '"none.csv"')),
    "more harmonics than positions show": lambda folder: described(
        folder, ("harmonics = 1", "harmonics = 6")
    ),
    "positions that are not even": lambda folder: described(
        folder, rows="angle,reading\n0,0\n10,0\n30,0\n90,0\n"
    ),
    "polygon that is not known": lambda folder: described(
        folder, ('polygon = "polygon.csv"\npolygon_sd = "0.05 ″"\n', "")
    ),
    "quadratic term that is not known": unknown_quadratic_term,
    "file that is not there": lambda folder: load(folder / "none.qualification.json"),
    "key typed and qualified": lambda folder: used(folder, more='gravity = "9.8 m/s²"'),
    "qualification of another bench": head_on_a_hand,
    "qualification that was withdrawn": withdrawn_and_used,
    "two of one date": successive,
    "bench without calibrations": bench_of_the_register,
    "bench without estimates": lambda _: bench_charts("arm 1", []),
}
