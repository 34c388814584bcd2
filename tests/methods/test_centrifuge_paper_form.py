"""D, S and b of Wang and Li 2021 from a calibration, and what `inercal show --as-paper` refuses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy.centrifuge import PAPER_G, Triad
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.files import save
from inercal.methods.centrifuge_norm.closed_formulas import paper_form
from inercal.physics.motion import Motion
from inercal.physics.sensors import Readout, triad

EXAMPLES = Path(__file__).parents[2] / "examples"
OFFSET = 0.7  # V


def paper_calibration(offset: float = 0.0) -> Calibration:
    """Return a calibration of the paper's accelerometers, with correlated coefficients."""
    device, scale = Triad(), 1.25 / PAPER_G
    k1 = device.scale / 1.25 - 1
    by_term = {
        "k0": (device.bias - offset) / scale,
        "k1": k1,
        "k2": device.bend * (1 + k1) / PAPER_G,
    }
    sensor = triad("paper", "f", "a", Readout(scale, offset, "V")).with_coefficients(*by_term)
    names = [name.split(".") for name in sensor.coefficients]
    values = np.array([by_term[term]["xyz".index(axis[-1])] for axis, term in names])
    sd = np.array([{"k0": 2e-4, "k1": 3e-5, "k2": 2e-8}[term] for _, term in names])
    mixed = np.random.default_rng(5).standard_normal((9, 20)) * sd[:, None] / 4
    return Calibration(sensor, values, mixed @ mixed.T, "centrifuge_norm", "ml")


@pytest.mark.parametrize("offset", [0.0, OFFSET])
def test_the_paper_form_has_the_paper_s_truth(offset: float):
    device, found = Triad(), paper_form(paper_calibration(offset))
    assert found.names == tuple(f"{letter}_a{axis}" for letter in "DSb" for axis in "xyz")
    assert found.units == (*["g/g²"] * 3, *["V/g"] * 3, *["V"] * 3)
    truth = np.concatenate([device.bend, device.scale, device.bias])
    np.testing.assert_allclose(found.values, truth, rtol=1e-13)


def test_the_paper_s_equation_gives_the_readings_of_the_model():
    calibration = paper_calibration(OFFSET)
    d, s, b = paper_form(calibration).values.reshape(3, 3)
    f = np.random.default_rng(1).uniform(-36, 36, (50, 3))  # g of the paper
    sensor = calibration.sensor
    reads = sensor.to_output(sensor.forward(Motion(f * PAPER_G), calibration.values))
    np.testing.assert_allclose(s * (f + d * f**2) + b, reads, rtol=1e-12)


def test_the_covariance_is_that_of_drawn_calibrations():
    calibration = paper_calibration()
    found = paper_form(calibration)
    draws = np.random.default_rng(2).multivariate_normal(
        calibration.values, calibration.covariance, 100_000
    )
    of = {name: draws[:, k] for k, name in enumerate(calibration.sensor.coefficients)}
    axes = ("ax", "ay", "az")
    drawn = np.array(
        [
            *(PAPER_G * of[f"{axis}.k2"] / (1 + of[f"{axis}.k1"]) for axis in axes),
            *(1.25 * (1 + of[f"{axis}.k1"]) for axis in axes),
            *(1.25 * of[f"{axis}.k0"] / PAPER_G for axis in axes),
        ]
    )
    size = np.outer(found.std, found.std)
    # a variance to 0.45 %, a correlation to 0.0032 (1 σ)
    np.testing.assert_allclose(np.cov(drawn) / size, found.covariance / size, atol=0.02)


def test_show_prints_the_form_and_refuses_other_calibrations(tmp_path: Path):
    calibration, path = paper_calibration(), tmp_path / "run.calibration.json"
    save(calibration, path)
    found = paper_form(calibration)
    content = json.loads(run_program("show", path, "--as-paper", "--json").output)
    assert content["g0_m_s2"] == PAPER_G
    rows = content["coefficients"]
    assert [(row["name"], row["unit"]) for row in rows] == list(
        zip(found.names, found.units, strict=True)
    )
    assert [row["value"] for row in rows] == pytest.approx(found.values, rel=1e-12)
    assert [row["std"] for row in rows] == pytest.approx(found.std, rel=1e-9)
    shown = run_program("show", path, "--as-paper")
    assert shown.status == 0
    assert all(name in shown.output for name in found.names)

    other = tmp_path / "other.calibration.json"
    save(replace(calibration, method="multi_position"), other)
    for arguments in (
        (other,),
        (EXAMPLES / "centrifuge" / "lab.toml",),
        (EXAMPLES / "centrifuge" / "lab.csv",),
        (path, "--at", "20 °C"),
    ):
        assert run_program("show", *arguments, "--as-paper").status == 2


def test_other_coefficients_than_those_of_the_form_are_named():
    calibration = paper_calibration()
    sensor = calibration.sensor.with_coefficients(*calibration.sensor.coefficients, "az.k3")
    more = Calibration(sensor, np.zeros(10), np.eye(10), "centrifuge_norm")
    with refused(InputError, names=("az.k3",)):
        paper_form(more)
    fewer = sensor.with_coefficients("k0", "k1")
    with refused(InputError, names=("ax.k2", "ay.k2", "az.k2")):
        paper_form(Calibration(fewer, np.zeros(6), np.eye(6), "centrifuge_norm"))
