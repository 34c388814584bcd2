"""Temperatures of thermometers with a lag: coarse steps, interruptions, pauses between soaks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.pipeline import Outcome, apply, calibrate
from inercal.recordings import Finding, Recording, ahead_of_lag

LAG, RATE = 60.0, 20.0  # s, Hz
G = 9.8
FACES = {"x_p": 0, "x_a": 0, "y_p": 1, "y_a": 1, "z_p": 2, "z_a": 2}
BIAS, SLOPE = np.array([0.1, -0.15, 0.3]), np.array([1e-3, -1.5e-3, 2.5e-3])  # m/s², m/s²/K
RUN = """
[sensor.accelerometer]
unit = "m/s²"
[bench]
gravity = "9.8 m/s² ± 0.5 mm/s²"
tilt = "0.1 °"
[environment]
kind = "soaks"
temperature_sd = "0.2 K"
lag = "60 s ± 5 s"
[data]
file = "FILE"
time = "time"
label = "label"
marks = "labels"
accelerometer = ["ax", "ay", "az"]
temperature = "temp"
[method]
name = "six_position"
temperature_order = [1, 0, 0]
"""


def behind(kelvin: np.ndarray, first: float, step: float) -> np.ndarray:
    """Return the readings of a thermometer that starts at `first`, with steps in its readings."""
    keep = np.exp(-1 / RATE / LAG)
    reading = np.empty(kelvin.size)
    for k, one in enumerate(kelvin):
        first = one + (first - one) * keep
        reading[k] = first
    return np.round(reading / step) * step


def soak(celsius: float, number: int, step: float, rng: np.random.Generator) -> list[str]:
    """Return the rows of six faces at one temperature, which the case approaches slowly."""
    start = 1800.0 * (number - 1)
    face = int(20 * RATE)
    t = np.arange(6 * face) / RATE
    true = celsius - 0.8 * np.exp(-t / 200)
    read = behind(true, true[0] - 0.4, step)
    rows: list[str] = []
    for k, label in enumerate(FACES):
        force = np.zeros(3)
        force[FACES[label]] = G if label.endswith("p") else -G
        for i in range(k * face, (k + 1) * face):
            a = force + BIAS + SLOPE * (true[i] - 20) + 5e-3 * rng.standard_normal(3)
            place = label if number == 1 else f"{label} ({number})"
            rows.append(
                f"{start + t[i]:.2f},{a[0]:.5f},{a[1]:.5f},{a[2]:.5f},{read[i]:.2f},{place}"
            )
    return rows


def written(folder: Path, name: str, temperatures: list[float], step: float) -> Path:
    """Write a recording with half an hour between the soaks, and its run file."""
    rng = np.random.default_rng(5)
    rows = ["time,ax,ay,az,temp,label"]
    for k, celsius in enumerate(temperatures):
        rows += soak(celsius, k + 1, step, rng)
    (folder / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    path = folder / f"{name}.toml"
    path.write_text(RUN.replace("FILE", f"{name}.csv"), encoding="utf-8")
    return path


@pytest.fixture(scope="module", params=[0.5, 0.01])
def soaked(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("soaks")
    path = written(folder, "soaks", [-10, 10, 30, 50], request.param)
    return request.param, path, calibrate(path)


def test_soaks_with_pauses_between_them_give_the_coefficients(soaked: tuple[float, Path, Outcome]):
    found = soaked[2].calibration
    for k, axis in enumerate(("ax", "ay", "az")):
        for name, truth in (("k0", BIAS[k]), ("k0_dT", SLOPE[k])):
            error = found.value(f"{axis}.{name}") - truth
            assert abs(error) < 3 * found.uncertainty(f"{axis}.{name}")
        assert found.uncertainty(f"{axis}.k0_dT") < 0.02 * abs(SLOPE[k])


def test_the_calibrated_range_contains_only_temperatures_that_were_reached(
    soaked: tuple[float, Path, Outcome], tmp_path: Path
):
    step, path, outcome = soaked
    assert outcome.calibration.validity is not None
    low, high = np.array(outcome.calibration.validity.temperature) - ZERO_CELSIUS
    assert abs(low - -10.8) < 0.1 + 1.5 * step
    assert abs(high - 50.0) < 0.5 + 1.5 * step
    hot = written(tmp_path, "hot", [55], step)
    with refused(InputError, key="[data] temperature") as refusal:
        apply(outcome.calibration, hot)
    assert "[environment] lag = 60 s" in str(refusal.value)
    assert apply(outcome.calibration, path).data.shape[-1] == 3


def test_apply_corrects_a_stepped_thermometer_to_about_a_step(
    soaked: tuple[float, Path, Outcome], tmp_path: Path
):
    step, _, outcome = soaked
    corrected = apply(outcome.calibration, written(tmp_path, "new", [20, 40], step))
    t = np.arange(corrected.time.size // 2) / RATE
    true = np.concatenate([celsius - 0.8 * np.exp(-t / 200) for celsius in (20, 40)])
    assert corrected.temperature is not None
    error = corrected.temperature - ZERO_CELSIUS - true
    assert np.abs(error).max() < 0.05 + 1.5 * step


def at(time: np.ndarray, celsius: np.ndarray) -> Recording:
    return Recording(
        time, np.zeros((time.size, 1)), ("ax",), ("m/s²",), temperature=celsius + ZERO_CELSIUS
    )


@pytest.mark.parametrize("lag", [120.0, -120.0])
def test_a_rate_is_never_taken_across_an_interruption(lag: float):
    half = np.arange(0, 200, 0.1)
    time = np.concatenate([half, half + 2000])
    celsius = np.repeat([18.0, 38.0], half.size)
    celsius[0] += 0.01  # shows the resolution
    corrected = ahead_of_lag(at(time, celsius), lag)
    assert corrected.temperature is not None
    assert not corrected.findings
    assert np.abs(corrected.temperature - ZERO_CELSIUS - celsius).max() < 0.02


def test_a_part_too_short_for_a_coarse_thermometer_is_named_and_not_corrected():
    time = np.concatenate([np.arange(0, 400, 0.1), np.arange(1000, 1020, 0.1)])
    celsius = np.round(2 * (20 + 0.005 * time)) / 2
    corrected = ahead_of_lag(at(time, celsius), 120.0)
    assert corrected.temperature is not None
    short = time > 500
    assert (corrected.temperature[short] == celsius[short] + ZERO_CELSIUS).all()
    assert abs(np.mean(corrected.temperature[~short] - ZERO_CELSIUS - celsius[~short]) - 0.6) < 0.1
    (finding,) = corrected.findings
    assert (finding.severity, finding.what) == ("warning", "lag")
    assert "1000 to 1019.9 s, steps of 0.5 K" in finding.message


def test_files_placed_one_after_the_other_are_corrected_one_by_one():
    half = np.arange(0, 200, 0.1)
    time = np.concatenate([half, half + 201])
    celsius = np.repeat([18.0, 38.0], half.size)
    celsius[0] += 0.01
    unknown = Finding("note", "sections", "the true time between the files is unknown")
    joined = replace(
        at(time, celsius), labels=np.repeat(["x_p", "x_a"], half.size), findings=(unknown,)
    )
    corrected = ahead_of_lag(joined, 120.0)
    assert corrected.temperature is not None
    assert np.abs(corrected.temperature - ZERO_CELSIUS - celsius).max() < 0.02
