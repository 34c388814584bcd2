"""Threshold, hysteresis, warm-up drift and the like, from a run file to the report and to JSON.

The readings are of a generator that imports nothing of inercal.
"""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.evidence import characteristic_devices as made
from tests.evidence import warm_up_devices as warm
from tests.program import run_program
from tests.refusals import refused

from inercal.benches.characteristics import BAND_NOTE
from inercal.benches.dividing_head.sheet import sheet
from inercal.methods.rates_and_poses import plan as rate_plan
from inercal.methods.tumble import plan as tumble_plan
from inercal.physics.plan import small_loop
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.design.plan_rehearsal import estimate_of_plan
from inercal.recordings.io.write import write_recordings
from inercal.report import write_report
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
EXAMPLE = {
    "gyro": ("rate_platform/small_rates", "gx"),
    "accelerometer": ("dividing_head/small_tilts", "a"),
}
UNIT = {"gyro": made.DEG_PER_H, "accelerometer": made.UG}


def run_file(folder: Path, sensor: str, *changes: tuple[str, str]) -> Path:
    """Return the run file of an example, with a table of means in place of its recording."""
    name, _ = EXAMPLE[sensor]
    text = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")
    lines = [one for one in text.splitlines() if not one.startswith(("rate = ", "marks", "white"))]
    data = f'[data]\nkind = "means"\nsd = {{ {sensor} = "{SD[sensor]}" }}\n'
    table = {"gyro": 'axis = "axis"\ntable_rate = "rate"\nseconds = "seconds"\n'}.get(sensor, "")
    text = "\n".join(one for one in lines if not one.startswith("label")) + "\n"
    text = text.replace(".npz", ".csv").replace("[data]\n", data + table)
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


SD = {"gyro": "1.2 °/h", "accelerometer": "0.3 µg"}


def write_table(folder: Path, sensor: str, effects: made.Effects) -> None:
    """Write the readings of one device as the table that the run file names."""
    device = made.SENSORS[sensor](effects, 1, np.random.default_rng(5))
    read = device.reading[0]
    if sensor == "gyro":
        rows = ["axis,rate,seconds,gx,gy,gz"]
        rows += [
            f"x,{np.degrees(rate):.9g},{seconds:.9g},{np.degrees(y):.9f},0,0"
            for rate, seconds, y in zip(device.at, device.sense, read, strict=True)
        ]
        # The other gyros are not tested, but each axis needs rates of its own.
        for k, axis in enumerate("yz", start=1):
            for rate in (0, 50, -50, 100, -100):
                y = [0.0, 0.0, 0.0]
                y[k] = float(rate)
                rows.append(f"{axis},{rate},36," + ",".join(f"{one:.9f}" for one in y))
        (folder / "small_rates.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        return
    rows = ["angle,a"]
    rows += [
        f"{np.degrees(angle):.10f},{y / 9.80665:.10f}"
        for angle, y in zip(device.at, read, strict=True)
    ]
    (folder / "small_tilts.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


CHANGES = {
    "gyro": [('latitude = "50 °"', 'latitude = "0 °"')],
    "accelerometer": [("9.80123", "9.81")],
}
WIDTH = {"gyro": 14.4, "accelerometer": 10.0}
LOOP = {"gyro": 30.0, "accelerometer": 20.0}


@pytest.mark.slow
@pytest.mark.parametrize("sensor", EXAMPLE)
def test_effects_of_a_device_are_in_the_outcome_the_report_and_json(sensor: str, tmp_path: Path):
    unit, axis = UNIT[sensor], EXAMPLE[sensor][1]
    width, loop = unit * WIDTH[sensor], unit * LOOP[sensor]
    write_table(tmp_path, sensor, made.Effects(loop, width, width))
    path = run_file(tmp_path, sensor, *CHANGES[sensor])
    outcome = calibrate(path)
    found = {one.name: one for one in outcome.characteristics if one.axis == axis}
    true = {
        "hysteresis": loop,
        "threshold": 2 * width,
        "dead band": width,
        "resolution": 2 * width,
    }
    for name, value in true.items():
        assert found[name].figure.detected
        assert abs(found[name].figure.value - value) < 3.3 * found[name].figure.u, name
    page = tmp_path / "report.html"
    write_report(outcome, page, None)
    shown = page.read_text(encoding="utf-8")
    section = shown[shown.index('id="characteristics"') :]
    assert all(found[name].text in section for name in true)
    done = run_program("calibrate", path, "--json", "--out", tmp_path / "out")
    assert done.status == 3  # the model has no dead band
    printed = {
        (one["axis"], one["name"]): one for one in json.loads(done.output)["characteristics"]
    }
    for name in true:
        assert printed[axis, name]["value"] == pytest.approx(found[name].figure.value, rel=1e-9)
        assert printed[axis, name]["detected"] is True


@pytest.mark.parametrize("sensor", [pytest.param("gyro", marks=pytest.mark.slow), "accelerometer"])
def test_the_simulated_example_has_no_effect(sensor: str, tmp_path: Path):
    name, axis = EXAMPLE[sensor]
    path = tmp_path / "run.toml"
    shutil.copy(EXAMPLES / f"{name}.toml", path)
    run = read(path)
    write_recordings({run.file(file): one for file, one in simulate_files(run).items()})
    outcome = calibrate(run)
    assert outcome.verdict.grade == "consistent"
    found = {one.name: one for one in outcome.characteristics if one.axis == axis}
    for effect in ("hysteresis", "threshold", "dead band", "resolution"):
        assert not found[effect].figure.detected
        assert found[effect].text.startswith("not detected")
        assert 0 < found[effect].figure.bound < 1e4 * UNIT[sensor]
    if sensor == "accelerometer":
        # The repeated readings do not enter the fit, and are simulated with the drift of a pass.
        assert len(outcome.observations.labels) == len(run.steps) - 30
        assert {"warm-up drift", "short-term stability"} <= set(found)
        assert not found["short-term stability"].figure.detected


@pytest.mark.slow
def test_the_backlash_of_the_head_is_uncertainty_of_the_hysteresis(tmp_path: Path):
    write_table(tmp_path, "accelerometer", made.Effects())
    u: list[float] = []
    for backlash in ("0 ″", "0.1 ″", "1 ″"):
        change = ('backlash = "0.1 ″"', f'backlash = "{backlash}"')
        path = run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"], change)
        (found,) = [c for c in calibrate(path).characteristics if c.name == "hysteresis"]
        u.append(found.figure.u)
    assert u[0] < u[1] < u[2]
    # The loop of the backlash, |cos|, is similar to that of the hysteresis, cos².
    assert u[2] > 3 * u[0]


@pytest.mark.slow
@pytest.mark.parametrize("key", ["rate_hysteresis", "settling"])
def test_order_errors_of_the_table_are_uncertainty_of_the_hysteresis(key: str, tmp_path: Path):
    write_table(tmp_path, "gyro", made.Effects())
    u: list[float] = []
    for size in ("0.3", "30"):
        change = (f'{key} = "0.3 ', f'{key} = "{size} ')
        path = run_file(tmp_path, "gyro", *CHANGES["gyro"], change)
        (found,) = [
            c for c in calibrate(path).characteristics if (c.axis, c.name) == ("gx", "hysteresis")
        ]
        u.append(found.figure.u)
    # Rests still show the hysteresis of the gyro, because the table does not turn.
    assert u[1] > 1.4 * u[0]


@pytest.mark.parametrize(("law", "grade"), [("jump", "consistent"), ("lock-in", "unreliable")])
def test_small_tilts_of_a_sensor_with_a_band_leave_the_fit(law: str, grade: str, tmp_path: Path):
    width = WIDTH["accelerometer"] * UNIT["accelerometer"]
    write_table(tmp_path, "accelerometer", made.Effects(0.0, width, width, law))
    outcome = calibrate(run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"]))
    assert all(c.figure.detected for c in outcome.characteristics if c.rows)
    assert len(outcome.observations.labels) == len(outcome.steps) == 24
    assert BAND_NOTE in outcome.estimate.notes
    # Lock-in also changes the readings where the input axis is level, which remain.
    assert outcome.verdict.grade == grade


def test_small_tilts_of_a_sensor_without_a_band_stay_in_the_fit(tmp_path: Path):
    write_table(tmp_path, "accelerometer", made.Effects())
    outcome = calibrate(run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"]))
    assert len(outcome.observations.labels) > 24
    assert BAND_NOTE not in outcome.estimate.notes


def write_warm_up(folder: Path, effects: warm.Effects) -> None:
    """Write the readings of one accelerometer after turn-on as the table that a run file names."""
    device = warm.accelerometers(effects, 1, np.random.default_rng(3))
    rows = ["minute,angle,a"]
    rows += [
        f"{t / 60:.6f},{np.degrees(angle):.10f},{y / 9.80665:.10f}"
        for t, angle, y in zip(device.time, device.angle, device.reading[0], strict=True)
    ]
    (folder / "small_tilts.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


TIMES = ("angle = ", 'time = "minute"\ntime_unit = "min"\nangle = ')
PIER = ('pier = "0.02 ″"', 'pier = "0.05 ″"')
DRIFTING = warm.Effects(-60 * warm.UG, 300.0, 2 * warm.UG)


@pytest.mark.slow
def test_a_warm_up_is_in_the_outcome_and_the_report_but_not_in_the_fit(tmp_path: Path):
    write_warm_up(tmp_path, DRIFTING)
    path = run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"], TIMES, PIER)
    outcome = calibrate(path)
    found = {one.name: one for one in outcome.characteristics}
    for name, true in warm.true_values(DRIFTING, 2 * warm.UG).items():
        assert abs(found[name].figure.value - true) < 3.3 * found[name].figure.u, name
        assert found[name].figure.detected
    assert len(outcome.observations.labels) == 24
    assert outcome.verdict.grade == "consistent"
    page = tmp_path / "report.html"
    write_report(outcome, page, None)
    section = page.read_text(encoding="utf-8").partition('id="characteristics"')[2]
    assert all(one.text in section for one in found.values() if one.figure.detected)


def test_a_warm_up_changes_no_coefficient_of_two_accelerometers(tmp_path: Path):
    folder = EXAMPLES / "dividing_head"
    for name in ("lab.toml", "polygon.csv", "centrifuge.calibration.json"):
        shutil.copy(folder / name, tmp_path)
    head, *rows = (folder / "lab.csv").read_text(encoding="utf-8").splitlines()
    column = head.split(",").index("autocollimator")
    (tmp_path / "lab.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    expected = calibrate(tmp_path / "lab.toml").calibration
    cells = rows[0].split(",")
    cells[column] = ""  # the autocollimator is not read during a warm-up
    repeats = [",".join([f"w{k}", *cells[1:]]) for k in range(12)]
    (tmp_path / "lab.csv").write_text("\n".join([head, *repeats, *rows]) + "\n", encoding="utf-8")
    outcome = calibrate(tmp_path / "lab.toml")
    assert {c.axis for c in outcome.characteristics if c.name == "warm-up drift"} == {"a", "b"}
    assert outcome.calibration.values == pytest.approx(expected.values, rel=1e-12)
    assert outcome.calibration.covariance == pytest.approx(expected.covariance, rel=1e-9)


def test_a_warm_up_without_times_has_a_drift_but_no_times(tmp_path: Path):
    write_warm_up(tmp_path, DRIFTING)
    outcome = calibrate(run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"], PIER))
    found = {one.name for one in outcome.characteristics}
    assert found == {"warm-up drift", "short-term stability", "hysteresis"}


def test_times_of_a_warm_up_that_do_not_rise_are_refused(tmp_path: Path):
    write_warm_up(tmp_path, DRIFTING)
    table = tmp_path / "small_tilts.csv"
    head, first, second, *others = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join([head, second, first, *others]) + "\n", encoding="utf-8")
    with refused(key="[data] time"):
        calibrate(run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"], TIMES))


def test_a_warm_up_in_a_plan_has_a_column_of_times_and_changes_no_expected_uncertainty():
    run = read(EXAMPLES / "dividing_head" / "small_tilts.toml")
    plan: Any = run.plan
    without = replace(run, plan=partial(tumble_plan, 12, True, 20.0, plan.keywords["small_tilts"]))
    assert len(run.steps) == len(without.steps) + 30
    first: Any = run.steps[:31]
    assert [step.angle for step in first] == [0.0] * 31
    one, other = (estimate_of_plan(r, "positions").covariance for r in (run, without))
    assert np.array_equal(one, other)
    timed = replace(run, data=run.data.model_copy(update={"time": "minute"}))
    assert "minute" in [box.column for box in sheet(timed).boxes]


def test_a_warm_up_of_few_readings_is_refused(tmp_path: Path):
    text = (EXAMPLES / "dividing_head" / "small_tilts.toml").read_text(encoding="utf-8")
    path = tmp_path / "run.toml"
    path.write_text(text.replace("warm_up = 30", "warm_up = 11"), encoding="utf-8")
    with refused(key="[method] warm_up"):
        read(path)


def test_small_inputs_of_a_plan_form_loops():
    assert small_loop([2.0, 1.0]) == [0, 1, 2, 1, 0, -1, -2, -1, 0]
    steps = rate_plan(rates=(0.5, 1.0), positions=3, small_rates=(0.001, 0.002))
    rates = [step.rate for step in steps if step.label.startswith("x ")]  # type: ignore[union-attr]
    loop = [0, 0.001, 0.002, 0.001, 0, -0.001, -0.002, -0.001, 0]
    assert rates[6:15] == pytest.approx(loop)
    assert rates[15:] == pytest.approx([0.5 + change for change in loop])
    tilted = tumble_plan(small_tilts=(1e-5, 2e-5))
    assert [step.sense for step in tilted[-9:]] == [1, 1, 1, -1, -1, -1, -1, 1, 1]
    assert len({step.label for step in tilted}) == len(tilted) == 24 + 18


def test_a_plan_seeks_the_resolution_about_a_rate_above_the_small_ones():
    small = (np.radians(0.3), np.radians(0.6))
    steps = rate_plan(rates=tuple(np.radians([0.5, 4, 7])), positions=3, small_rates=small)
    rates = [step.rate for step in steps if step.label.startswith("x ")]  # type: ignore[union-attr]
    assert np.degrees(rates[-9:]) == pytest.approx(7 + np.array(small_loop([0.3, 0.6])))


@pytest.mark.slow
def test_a_resolution_is_about_the_rate_of_the_table(tmp_path: Path):
    write_table(tmp_path, "gyro", made.Effects())
    found = calibrate(run_file(tmp_path, "gyro")).characteristics
    (about,) = [one.about for one in found if one.name == "resolution"]
    assert about == pytest.approx(np.radians(5), rel=1e-9)


def test_a_missing_resolution_is_explained(tmp_path: Path):
    write_table(tmp_path, "gyro", made.Effects())
    path, table = run_file(tmp_path, "gyro"), tmp_path / "small_rates.csv"
    kept = [row for row in table.read_text().splitlines() if not row.startswith(("x,5", "x,4.9"))]
    table.write_text("\n".join(kept) + "\n")
    outcome = calibrate(path)
    assert "resolution" not in {one.name for one in outcome.characteristics}
    assert any(note.startswith("A resolution needs") for note in outcome.calibration.notes)


def test_impossible_small_inputs_are_refused():
    for rate in (-0.1, np.radians(2.1)):
        with refused(key="[method] small_rates"):
            rate_plan(small_rates=(rate,))
    for tilts in ((1e-5,), (1e-5, -2e-5), (1e-5, 0.1)):
        with refused(key="[method] small_tilts"):
            tumble_plan(small_tilts=tilts)


def test_fourier_refuses_small_tilts(tmp_path: Path):
    write_table(tmp_path, "accelerometer", made.Effects())
    change = ('name = "tumble"', 'name = "tumble"\nestimator = "fourier"')
    form = ('name = "QA 12"', 'name = "QA 12"\nform = "reference"')
    with refused():
        calibrate(run_file(tmp_path, "accelerometer", *CHANGES["accelerometer"], change, form))
