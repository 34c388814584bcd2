"""Temperatures that are not possible: of data in memory, of a simulation, of a noise analysis."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused
from tests.runs.test_environment_runs import RAMP, written

import inercal
from inercal.basics.errors import InputError
from inercal.pipeline.drafts.rest_recording import read_rest_recording
from inercal.pipeline.temperature_fit import LEAST_SPAN
from inercal.recordings.data import DataSection
from inercal.recordings.temperature import TEMPERATURE_UNIT
from inercal.runfile import read


def means(*celsius: float, order: Any = None, **keys: Any) -> inercal.Outcome:
    """Calibrate six positions of means at these temperatures."""
    face = np.concatenate([np.eye(3), -np.eye(3)]) + 1e-4
    table = {"p": ["x_p", "y_p", "z_p", "x_a", "y_a", "z_a"], "temp": list(celsius)}
    table |= {f"a{axis}": face[:, k] for k, axis in enumerate("xyz")}
    return inercal.calibrate(
        table,
        method={"name": "six_position", **(order or {})},
        sensor={"accelerometer": {"unit": "g"}},
        bench={"gravity": "9.80665 m/s² ± 0.001 m/s²", "tilt": "0.1 °"},
        kind="means",
        label="p",
        accelerometer=["ax", "ay", "az"],
        temperature="temp",
        sd={"accelerometer": "0.2 mg"},
        **keys,
    )


def test_data_in_memory_are_checked():
    assert means(*[25.0] * 6)
    with refused(InputError, names=("temp",)):
        means(*[25.0] * 5, 604.0)
    assert means(*[25.0] * 5, 604.0, allow_temperature=True)
    with refused(InputError, names=("temp",)):
        means(*[25.0] * 6, temperature_unit="K")
    with refused(InputError, names=("temp",)):
        means(*[-1812.0] * 6, allow_temperature=True)


def test_keys_without_a_column_of_temperature_are_refused(tmp_path: Path):
    for line in ("allow_temperature = true", 'temperature_scale = "340 LSB/K"'):
        text = RAMP.replace('temperature = "temp"\n', f"{line}\n")
        with pytest.raises(InputError):
            read(written(tmp_path, text))


@pytest.mark.parametrize("celsius", ["604 °C", "-300 °C"])
def test_temperatures_of_a_simulated_chamber_are_checked(tmp_path: Path, celsius: str):
    path = written(tmp_path, RAMP, {'"60 °C"': f'"{celsius}"'})
    with refused(InputError, key="[environment] temperatures"):
        read(path)


def test_a_noise_analysis_leaves_out_raw_counts_that_nobody_named(tmp_path: Path):
    rng = np.random.default_rng(1)
    rows = np.column_stack(
        [0.01 * np.arange(400), rng.normal([0, 0, 9.8], 0.01, (400, 3)), np.full(400, -1812.0)]
    )
    path = tmp_path / "a.csv"
    np.savetxt(path, rows, "%.6g", ",", header="t,ax,ay,az,temp", comments="")
    assert read_rest_recording(path, {}).temperature is None
    with refused(InputError, names=("temp",)):
        read_rest_recording(path, {"data.temperature": "temp"})
    counts = {"data.temperature_unit": "LSB", "data.temperature_scale": "340 LSB/K"}
    found = read_rest_recording(path, {**counts, "data.temperature_zero": "36.53 °C"})
    assert found.temperature is not None


@pytest.mark.parametrize(
    ("column", "unit", "kelvin"),
    [
        ("temp_F", None, 298.15),
        ("T [°F]", None, 298.15),
        ("temp", "°F", 298.15),
        ("T (K)", None, 77),
    ],
)
def test_the_name_of_a_column_states_its_unit(column: str, unit: str | None, kelvin: float):
    keys = {"temperature": column} | ({"temperature_unit": unit} if unit else {})
    read = DataSection.model_validate(
        {"file": "a.csv", "accelerometer": ["a"], **keys}
    ).thermometer.kelvin
    assert read(np.array([77.0])) == pytest.approx(kelvin)


def test_every_reader_converts_fahrenheit(tmp_path: Path):
    time = np.arange(400) / 10
    force = np.random.default_rng(1).normal([0, 0, 1], 1e-3, (400, 3))
    table = {"t_s": time, **{f"a{k}_g": force[:, j] for j, k in enumerate("xyz")}}
    table["temp_F"] = np.linspace(68.0, 86.0, 400)
    rows = np.column_stack(list(table.values()))
    np.savetxt(tmp_path / "a.csv", rows, "%.6g", ",", header=",".join(table), comments="")
    kelvin = read_rest_recording(tmp_path / "a.csv", {}).temperature
    assert kelvin is not None
    assert kelvin[[0, -1]] == pytest.approx([293.15, 303.15])


@pytest.mark.parametrize("text", ["0.2 °C", "0.2 K", "0.36 °F"])
def test_an_uncertainty_of_temperature_is_a_difference(tmp_path: Path, text: str):
    added = f'[environment]\ntemperature_sd = "{text}"\n'
    environment = read(written(tmp_path, RAMP, {"[environment]\n": added})).environment
    assert environment is not None
    assert environment.temperature_sd == pytest.approx(0.2)


def test_a_deviation_of_means_in_a_wrong_unit_names_both_possible_units():
    table = {"p": ["x_p"], "ax": [8192.0], "ay": [1.0], "az": [2.0]}
    with refused(InputError, key="[data.sd] accelerometer") as error:
        inercal.calibrate(
            table,
            method="six_position",
            sensor={"accelerometer": {"unit": "LSB", "scale": "8192 LSB/g"}},
            bench={"gravity": "9.80665 m/s² ± 0.001 m/s²"},
            kind="means",
            label="p",
            accelerometer=["ax", "ay", "az"],
            sd={"accelerometer": "0.3 °/h"},
        )
    assert all(unit in str(error.value) for unit in ("m/s²", "LSB"))


@pytest.mark.parametrize(
    ("readings", "unit", "room", "doubted"),
    [
        (73.4, None, "23.0 °C ± 0.5 °C", True),  # °F
        (73.4, "°C", "23.0 °C ± 0.5 °C", False),  # a heated sensor, as stated
        (296.2, None, "23.0 °C", True),  # K
        (31.0, None, "23.0 °C", False),
        (45.0, None, "23.0 °C", False),  # a heated sensor: 45 °F is colder than the room
        (-20.0, None, "23.0 °C", False),  # a chamber
        (73.4, None, "not measured", False),
        (73.4, None, None, False),
    ],
)
def test_temperatures_that_fit_the_room_only_in_another_unit_are_doubted(
    readings: float, unit: str | None, room: str | None, doubted: bool
):
    keys = {"temperature_unit": unit} if unit else {}
    job = {"job": {"ambient_temperature": room}} if room else {}
    outcome = means(*[readings] * 6, **keys, **job)
    assert doubted == any(one.what == TEMPERATURE_UNIT for one in outcome.findings)


def test_a_span_just_below_the_limit_is_not_printed_as_the_limit():
    with pytest.raises(InputError) as error:
        means(*[20.0] * 5, 29.997, order={"temperature_order": "auto"})
    span = re.search(r"span of ([\d.]+) K", str(error.value))
    assert span is not None
    assert float(span[1]) < LEAST_SPAN
