"""Run files with a column of temperature: from tables and recordings to a calibration in use."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import ferraris
from tests.accuracy import temperature as thermal
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError, NotObserved
from inercal.calibration.files import save
from inercal.pipeline import Outcome, apply, calibrate
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.runfile import read

Array = NDArray[np.float64]
EXAMPLE = Path(__file__).parents[2] / "examples" / "six_position"
# What made soaks.csv, and its tilts of 0.1°: µg, ppm, µg/K, ppm/K.
TRUTH = {
    "k0": (4200, -8100, 11600), "k1": (1200, -2200, 3400),
    "k0_dT": (120, -260, 310), "k1_dT": (-85, -110, -70),
}  # fmt: skip
RECORDED = """
[sensor]
name = "imu"
[sensor.accelerometer]
unit = "m/s²"
bias_instability = "1 µg"
[bench]
gravity = "9.81 m/s² ± 0.1 mm/s²"
tilt = "0.03 °"
[data]
file = "recording.csv"
time = "time"
accelerometer = ["ax", "ay", "az"]
label = "label"
marks = "labels"
temperature = "temp"
[method]
name = "six_position"
also = ["k0_dT", "k1_dT"]
"""


def copy_example(folder: Path, changes: dict[str, str], table: str | None = None) -> Path:
    """Return a copy of the example's run file, with its text and its table changed."""
    text = (EXAMPLE / "soaks.toml").read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "soaks.toml").write_text(text, encoding="utf-8")
    rows = (EXAMPLE / "soaks.csv").read_text(encoding="utf-8") if table is None else table
    (folder / "soaks.csv").write_text(rows, encoding="utf-8")
    return folder / "soaks.toml"


@pytest.mark.slow
def test_the_example_recovers_the_truth_of_its_table(tmp_path: Path):
    outcome = calibrate(EXAMPLE / "soaks.toml")
    assert outcome.estimate.consistent
    assert outcome.verdict.word == "consistent"
    found = outcome.calibration
    for term, values in TRUTH.items():
        for axis, value in zip("xyz", values, strict=True):
            name = f"a{axis}.{term}"
            si = found.sensor.coefficient(name).si
            assert abs(found.value(name) / si - value) < 3 * found.uncertainty(name) / si, name
    assert outcome.observations.labels[:7] == ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a", "x_p (2)")
    assert found.conditions["temperature"] == "20.04 °C (61.01 K range)"
    assert found.validity is not None
    assert found.validity.temperature is not None
    coldest, warmest = found.validity.temperature
    assert warmest - coldest == pytest.approx(61.01, abs=0.005)
    page = inercal.write_report(outcome, tmp_path / "report.html")
    assert "k0_dT" in Path(page).read_text(encoding="utf-8")


def test_attitudes_in_the_report_are_those_at_the_rows_temperatures():
    outcome = calibrate(EXAMPLE / "soaks.toml")
    force = outcome.sensed_motion().f
    # Tilts of 0.1° turn gravity and leave its size.
    assert np.abs(np.linalg.norm(force, axis=1) / 9.80747 - 1).max() < 2e-4


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({'temperature = "temp"': ""}, "'x_a'"),
        ({'temperature = "temp"': 'temperature = "t"'}, "'t'"),
        ({'also = ["k0_dT", "k1_dT"]': 'estimator = "classical"'}, "position"),
        ({'also = ["k0_dT",': 'estimator = "classical"\nalso = ["k0_dT",'}, "k0_dT"),
    ],
)
def test_a_table_with_missing_data_gives_one_line(
    changes: dict[str, str], wrong: str, tmp_path: Path
):
    with refused(InputError) as refusal:
        calibrate(copy_example(tmp_path, changes))
    assert wrong in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_coefficients_without_a_column_name_the_key(tmp_path: Path):
    rows = (EXAMPLE / "soaks.csv").read_text(encoding="utf-8").splitlines()
    once = "\n".join(rows[2:9])
    with refused(InputError) as refusal:
        calibrate(copy_example(tmp_path, {'temperature = "temp"': ""}, once))
    assert "[data] temperature" in str(refusal.value)
    assert "ax.k0_dT" in str(refusal.value)


def test_one_temperature_names_the_null_direction_and_what_to_do(tmp_path: Path):
    rows = (EXAMPLE / "soaks.csv").read_text(encoding="utf-8").splitlines()
    alike = "\n".join([rows[2], *(row.rpartition(",")[0] + ",21.30" for row in rows[3:])])
    with refused(NotObserved, file="soaks.toml") as refusal:
        calibrate(copy_example(tmp_path, {}, alike))
    assert isinstance(refusal.value, NotObserved)
    assert any({"ax.k0_dT", "ax.k0"} <= set(free.split()) for free in refusal.value.directions)
    assert "21.30 to 21.30 °C" in str(refusal.value)


def test_a_cell_without_a_temperature_is_refused_with_its_line(tmp_path: Path):
    rows = (EXAMPLE / "soaks.csv").read_text(encoding="utf-8").splitlines()
    rows[4] = rows[4].rpartition(",")[0] + ","
    with refused(InputError) as refusal:
        calibrate(copy_example(tmp_path, {}, "\n".join(rows)))
    assert "line 5: column 'temp'" in str(refusal.value)


def recorded(folder: Path) -> tuple[Path, ferraris.Imu, thermal.TemperatureSensitivity]:
    """Write a recording of six faces at three temperatures, and its run file."""
    rng = np.random.default_rng(12)
    faces = {f"{name}{k}": up for k in range(3) for name, up in ferraris.POSITIONS.items()}
    device = ferraris.mems(rng)
    hands = ferraris.Handling(gravity=9.81, tilt=5e-4)
    made = ferraris.record(device, hands, rng, rate_hz=50.0, faces=faces, turns={})
    n = made.time.size
    temperature, warm = thermal.soak_temperatures(n, (-10, 20, 50)), thermal.draw(rng, 1)
    data = thermal.warm_imu_readings(device, made.data, warm, temperature)[0, :, :3]
    labels = np.array([label[:-1] for label in made.labels()])
    rows = zip(made.time, *data.T, labels, temperature - thermal.ZERO, strict=True)
    lines = [f"{t:.4f},{x:.7f},{y:.7f},{z:.7f},{w},{k:.3f}" for t, x, y, z, w, k in rows]
    text = "\n".join(["time,ax,ay,az,label,temp", *lines])
    (folder / "recording.csv").write_text(text, encoding="utf-8")
    (folder / "run.toml").write_text(RECORDED, encoding="utf-8")
    return folder / "run.toml", device, warm


@pytest.mark.slow
def test_a_recording_of_soaks_is_calibrated_and_corrected_at_its_temperatures(tmp_path: Path):
    run, device, warm = recorded(tmp_path)
    outcome = calibrate(run)
    found = outcome.calibration
    named = device.coefficients()
    truth = [
        float(warm.of(name)[0]) if name.endswith("_dT") else named[name]
        for name in found.sensor.coefficients
    ]
    error = found.values - truth
    nees = error @ np.linalg.solve(found.covariance, error)
    assert 4.9 < nees < 42.4  # 0.1 and 99.9 % points of χ² of 18
    assert outcome.observations.labels[:4] == ("x_p", "x_p (2)", "x_p (3)", "x_a")
    corrected = apply(found, run)
    held = [corrected.data[mark.start : mark.stop].mean(axis=0) for mark in outcome.marks]
    assert np.linalg.norm(held, axis=1) == pytest.approx(np.full(18, 9.81), abs=5e-4)
    plain = calibrate_plain(run)
    assert plain.verdict.word == "not to be relied on"
    assert any("k0_dT" in line for line in plain.calibration.notes)


def calibrate_plain(run: Path) -> Outcome:
    """Return what comes out without coefficients of temperature."""
    other = run.with_name("plain.toml")
    text = run.read_text(encoding="utf-8")
    other.write_text(text.replace('also = ["k0_dT", "k1_dT"]', ""), encoding="utf-8")
    return calibrate(other)


def test_a_budget_of_a_plan_has_no_temperatures(tmp_path: Path):
    run = copy_example(tmp_path, {})
    with refused(InputError) as refusal:
        experiment_from_run(read(run))
    assert "ax.k0_dT" in str(refusal.value)


@pytest.mark.parametrize("apart", [False, True])
def test_temperature_coefficients_from_a_prior_are_valid_over_the_temperatures_of_its_data(
    tmp_path: Path, apart: bool
):
    text, rows = (
        (EXAMPLE / name).read_text().splitlines(keepends=True)
        for name in ("soaks.toml", "soaks.csv")
    )
    (tmp_path / "soaks.csv").write_text("".join(rows))
    (tmp_path / "soaks.toml").write_text("".join(text))
    soaks = calibrate(tmp_path / "soaks.toml").calibration
    assert soaks.validity is not None
    if apart:
        soaks = replace(soaks, validity=replace(soaks.validity, temperature=(262.0, 264.0)))
    save(soaks, tmp_path / "soaks.calibration.json")
    taken = [name for name in soaks.sensor.coefficients if name.endswith("_dT")]
    section = "".join(f'"{name}" = "{name}"\n' for name in taken)
    (tmp_path / "room.csv").write_text("".join([*rows[:3], *rows[9:15]]))
    (tmp_path / "room.toml").write_text(
        "".join(text).replace("soaks.csv", "room.csv")
        + f'[method.prior_from."soaks.calibration.json"]\n{section}'
    )
    found = calibrate(tmp_path / "room.toml").calibration.validity
    assert found is not None
    assert found.temperature is not None
    expected = [19.78, 20.22] if apart else [-10.49, 50.52]
    assert np.subtract(found.temperature, 273.15) == pytest.approx(expected)
