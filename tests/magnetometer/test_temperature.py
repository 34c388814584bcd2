"""Magnetometers in soaks: their temperature coefficients are true, and their orders are chosen."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from tests.base_seeds import evidence
from tests.magnetometer import generator as sim
from tests.magnetometer.recorded import labels, table
from tests.program import run_program

from inercal.pipeline import Outcome, calibrate

SOAKS = (5.0, 25.0, 45.0)  # °C
OFFSET = np.array([40e-9, -60e-9, 25e-9])  # T/K
GAIN = np.array([300e-6, -200e-6, 250e-6])  # 1/K, of each axis along itself
SLOPES = {f"m{a}.bias_dT": OFFSET[k] for k, a in enumerate("xyz")} | {
    f"m{a}.scale_dT": GAIN[k] for k, a in enumerate("xyz")
}


def soaks(folder: Path, method: str, keys: str, *seed: int, gain: bool = True) -> Path:
    """Write means in three soaks: of faces at two azimuths each, or of 12 free rests each."""
    rng = np.random.default_rng(seed)
    own = sim.device(rng)
    once = [sim.six_faces(rng, 2, 0.005) if method == "six_position" else sim.scattered(rng, 12)
            for _ in SOAKS]  # fmt: skip
    attitude = np.concatenate(once)
    celsius = np.repeat(SOAKS, 12)
    warm = (celsius - 20)[:, None]
    h = np.einsum("kji,j->ki", attitude, own.field)
    data = sim.rests(rng, attitude, own, drift=warm * (OFFSET + gain * GAIN * h))
    path = table(folder, data, attitude, rng, method=method, field="50 µT", hemisphere="north")
    means = folder / "means.csv"
    header, *rows = means.read_text(encoding="utf-8").splitlines()
    if method == "six_position":  # the visits are numbered by the program
        rows = [f"{one.partition(' (')[0]},{row.partition(',')[2]}"
                for one, row in zip(labels(attitude, method), rows, strict=True)]  # fmt: skip
    rows = [f"{row},{t:g}" for row, t in zip(rows, celsius.tolist(), strict=True)]
    means.write_text("\n".join([f"{header},T", *rows]) + "\n", encoding="utf-8")
    text = path.read_text(encoding="utf-8")
    text = text.replace("[data]\n", '[data]\ntemperature = "T"\n')
    path.write_text(text.replace("[method]\n", f"[method]\n{keys}\n"), encoding="utf-8")
    return path


def squares(outcome: Outcome) -> float:
    """Return (error)ᵀ covariance⁻¹ (error) of the six slopes."""
    found = outcome.calibration
    at = [found.sensor.coefficients.index(name) for name in SLOPES]
    z = found.values[at] - np.array([*SLOPES.values()])
    sd = found.std[at]
    covariance = found.covariance[np.ix_(at, at)] / np.outer(sd, sd)
    return float(z / sd @ np.linalg.solve(covariance, z / sd))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "keys", "count"),
    [
        ("multi_position", 'also = ["temperature"]', 2),
        evidence("multi_position", 'also = ["temperature"]', 6),
        ("six_position", "temperature_order = [1, 1, 0]", 1),
        evidence("six_position", "temperature_order = [1, 1, 0]", 2),
    ],
)
def test_errors_of_temperature_coefficients_agree_with_their_covariance(
    method: str, keys: str, count: int, tmp_path: Path
):
    """The strength is exact here, so scales are not relative to the field."""
    total = 0.0
    for k in range(count):
        outcome = calibrate(soaks(tmp_path, method, keys, 5, k))
        total += squares(outcome)
        assert outcome.verdict.grade == "consistent"
    assert chi2(6 * count).ppf(0.0005) < total < chi2(6 * count).ppf(0.9995)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [True, False])
def test_orders_that_the_data_need_are_chosen(gain: bool, tmp_path: Path):
    outcome = calibrate(soaks(tmp_path, "six_position", 'temperature_order = "auto"', 6, gain=gain))
    fit = outcome.temperature_fit
    assert fit is not None
    assert fit.orders["m"] == (1, int(gain), 0)
    assert {one.orders for one in fit.tests if one.kind == "m"} == {
        (a, b, 0) for a in (0, 1) for b in (0, 1)
    }
    names = set(outcome.sensor.coefficients)
    assert {n for n in SLOPES if n in names} == {n for n in SLOPES if gain or "bias" in n}
    for name in names & set(SLOPES):
        error = outcome.calibration.value(name) - SLOPES[name]
        assert abs(error) < 4 * outcome.calibration.uncertainty(name)


@pytest.mark.slow
def test_temperature_terms_that_are_left_out_are_seen(tmp_path: Path):
    outcome = calibrate(soaks(tmp_path, "six_position", "", 7))
    assert outcome.verdict.grade != "consistent"


def test_errors_common_to_a_soak_are_refused_in_one_line(tmp_path: Path):
    path = soaks(tmp_path, "six_position", "temperature_order = [1, 1, 0]", 8)
    text = path.read_text(encoding="utf-8")
    path.write_text(f'{text}\n[environment]\ntemperature_sd = "0.5 K"\n', encoding="utf-8")
    ended = run_program("calibrate", path)
    assert ended.status == 2
    assert ended.error.count("\n") <= 1
    assert "[environment]" in ended.error
    assert "magnetometers" in ended.error
