"""Temperatures that are not possible are refused wherever they enter; jumps are found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.physics.sensors import Noise, Readout, triad
from inercal.recordings import Recording
from inercal.recordings.io.mean_tables import read_means
from inercal.recordings.io.read import read_recording
from inercal.recordings.io.table_recording import Columns
from inercal.recordings.temperature import temperature_readout

ROWS = 200


def log(path: Path, celsius: np.ndarray) -> Path:
    """Write a log of one axis with a temperature, 10 rows a second."""
    noise = np.random.default_rng(1).normal(size=celsius.size)
    lines = [
        f"{k / 10},{x:.6f},{t:.6g}" for k, (x, t) in enumerate(zip(noise, celsius, strict=True))
    ]
    path.write_text("t,ax,temp\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def columns(unit: str = "°C", **keys: object) -> Columns:
    readout = temperature_readout(unit, **keys)  # type: ignore[arg-type]
    return Columns((("ax", "ax", "m/s²"),), time="t", temperature="temp", thermometer=readout)


def read(path: Path, unit: str = "°C", **keys: object) -> Recording:
    return read_recording(path, columns(unit, **keys))


@pytest.mark.parametrize(
    ("value", "unit"), [(-1812.0, "°C"), (604.0, "°C"), (-120.0, "°C"), (25.0, "K"), (-3.0, "K")]
)
def test_an_impossible_temperature_is_refused_with_its_line(
    tmp_path: Path, value: float, unit: str
):
    celsius = np.full(ROWS, 300.0 if unit == "K" else 25.0)
    celsius[150] = value
    with refused(InputError, file="a.csv", names=("temp",)) as refusal:
        read(log(tmp_path / "a.csv", celsius), unit)
    assert "line 152" in str(refusal.value)


def test_a_slow_thermometer_is_held_but_a_hole_is_refused(tmp_path: Path):
    celsius = 20 + np.repeat(np.arange(10.0), 20)
    sparse = np.where(np.arange(ROWS) % 10 == 3, celsius, np.nan)
    read_temperature = read(log(tmp_path / "a.csv", sparse)).temperature
    assert read_temperature is not None
    late = np.abs(read_temperature - ZERO_CELSIUS - celsius)
    assert late.max() <= 1.0
    assert np.count_nonzero(late) <= ROWS / 4
    with refused(InputError, file="a.csv"):
        read(log(tmp_path / "a.csv", np.where(np.arange(ROWS) < 50, np.nan, celsius)))
    sparse[80:130] = np.nan
    with refused(InputError, file="a.csv"):
        read(log(tmp_path / "a.csv", sparse))


@pytest.mark.parametrize("value", [350.0, -150.0])
def test_what_is_outside_the_limits_is_accepted_on_demand_but_nothing_below_zero_kelvin(
    tmp_path: Path, value: float
):
    path = log(tmp_path / "a.csv", np.full(ROWS, value))
    found = read(path, allowed=True).temperature
    assert found is not None
    assert found[0] == pytest.approx(value + ZERO_CELSIUS)
    below = log(tmp_path / "b.csv", np.full(ROWS, -1812.0))
    with refused(InputError, names=("temp",)):
        read(below, allowed=True)


def test_counts_become_temperatures_by_scale_and_zero(tmp_path: Path):
    path = log(tmp_path / "a.csv", np.full(ROWS, -1812.0))
    found = read(path, "LSB", scale="340 LSB/K", zero="36.53 °C").temperature
    assert found is not None
    np.testing.assert_allclose(found, 36.53 - 1812 / 340 + ZERO_CELSIUS)


@pytest.mark.parametrize(
    ("unit", "scale", "zero", "key"),
    [
        ("LSB", None, "36.53 °C", "[data] temperature_scale"),
        ("LSB", "340 LSB/K", None, "[data] temperature_zero"),
        ("LSB", "340 g", "36.53 °C", "[data] temperature_scale"),
        ("LSB", "0 LSB/K", "36.53 °C", "[data] temperature_scale"),
        ("°C", "340 LSB/K", None, "[data] temperature_scale"),
    ],
)
def test_a_readout_that_is_not_complete_is_refused(
    unit: str, scale: str | None, zero: str | None, key: str
):
    with refused(InputError, key=key):
        temperature_readout(unit, scale, zero)


def test_means_are_checked_too(tmp_path: Path):
    path = tmp_path / "means.csv"
    path.write_text("p,ax,temp\nup,9.8,25\ndown,-9.8,604\n", encoding="utf-8")
    sensor = triad("accelerometer", "f", "a", Readout(1.0, 0.0, "m/s²", None), Noise(0, 0, 0))
    by = Columns((("ax", "ax", "m/s²"),), rate_hz=1.0, label="p", temperature="temp")
    with refused(InputError, file=path, names=("temp",)) as refusal:
        read_means(path, by, replace(sensor, axes=sensor.axes[:1]), {"f": 1e-3}, None)
    assert "line 3" in str(refusal.value)


def jumps(recording: Recording) -> list[tuple[int | None, int | None]]:
    return [(f.start, f.stop) for f in recording.findings if f.what == "temperature jump"]


def test_a_lost_decimal_point_is_found_as_a_jump(tmp_path: Path):
    celsius = 20.0 + 0.01 * np.arange(ROWS)
    celsius[80] /= 10
    found = read(log(tmp_path / "a.csv", celsius))
    assert jumps(found) in ([(79, 81)], [(80, 82)])
    (finding,) = (f for f in found.findings if f.what == "temperature jump")
    assert finding.severity == "warning"
    assert "2 times" in finding.message


@pytest.mark.parametrize("step", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("noise", [0.01, 0.5])
def test_noise_steps_and_a_fast_chamber_do_not_jump(tmp_path: Path, step: float, noise: float):
    rng = np.random.default_rng(2)
    celsius = np.linspace(-20, -20 + 0.5 * ROWS / 10, ROWS) + noise * rng.normal(size=ROWS)
    if step:
        celsius = step * np.round(celsius / step)
    assert not jumps(read(log(tmp_path / "a.csv", celsius)))


def test_kelvin_that_are_taken_as_celsius_are_a_warning(tmp_path: Path):
    found = read(log(tmp_path / "a.csv", np.full(ROWS, 295.0)))
    assert [f.severity for f in found.findings if f.what == "temperature unit"] == ["warning"]
    assert not any(
        f.what == "temperature unit"
        for f in read(log(tmp_path / "b.csv", np.full(ROWS, 85.0))).findings
    )
