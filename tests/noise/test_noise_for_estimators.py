"""Noise blocks of VINS-Fusion and FAST-LIO: what their filters make of the written numbers."""

import re
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.arrays import Array
from inercal.noise.noise_files import fast_lio_text, vins_text
from inercal.noise.sensor_noise import SensorNoise, TriadNoise
from inercal.physics.quantities import SensorKind

WHITE = {"accelerometer": 2e-3, "gyro": 1.5e-4}  # N, m/s²/√Hz and rad/s/√Hz
WALK = {"accelerometer": 3e-4, "gyro": 2e-5}  # K
SHORT = {"accelerometer": "acc", "gyro": "gyr"}
SENSORS: tuple[SensorKind, ...] = ("accelerometer", "gyro")
SPAN = 2.0  # s
RATES = (100.0, 400.0)


def noise(rate: float) -> SensorNoise:
    triads: dict[SensorKind, TriadNoise] = {
        quantity: TriadNoise(
            quantity,
            ({"N": WHITE[quantity], "K": WALK[quantity]},) * 3,
            {"N": (WHITE[quantity], None), "K": (WALK[quantity], None)},
            (),
            rate,
        )
        for quantity in SENSORS
    }
    return SensorNoise("log.csv", 3600.0, triads)


def keys(text: str) -> dict[str, float]:
    return {name: float(x) for name, x in re.findall(r"^ *(\w+): ([-\d.e+]+)", text, re.MULTILINE)}


def propagated(step: Array, added: Array, steps: int) -> Array:
    """Return P after some steps of P = F P Fᵀ + V Q Vᵀ, with V Q Vᵀ given."""
    p = np.zeros((2, 2))
    for _ in range(steps):
        p = step @ p @ step.T + added
    return p


@pytest.mark.parametrize("quantity", SHORT)
@pytest.mark.parametrize("rate", RATES)
def test_the_covariance_of_vins_fusion_is_that_of_the_sensor(rate: float, quantity: str):
    one = keys(vins_text(noise(rate)))
    n, w = (one[f"{SHORT[quantity]}_{letter}"] for letter in "nw")
    dt = 1 / rate
    # The velocity and the bias of one axis at rest: midPointIntegration with rotations of 1.
    v = np.array([[dt / 2, dt / 2, 0], [0, 0, dt]])
    p = propagated(
        np.array([[1, -dt], [0, 1]]), v @ np.diag([n**2, n**2, w**2]) @ v.T, int(SPAN * rate)
    )
    check(p, quantity, rate)


@pytest.mark.parametrize("quantity", SHORT)
@pytest.mark.parametrize("rate", RATES)
def test_the_covariance_of_fast_lio_is_that_of_the_sensor(rate: float, quantity: str):
    one = keys(fast_lio_text(noise(rate)))
    n, w = one[f"{SHORT[quantity]}_cov"], one[f"b_{SHORT[quantity]}_cov"]
    dt = 1 / rate
    p = propagated(np.array([[1, -dt], [0, 1]]), dt * np.diag([n, w]) * dt, int(SPAN * rate))
    check(p, quantity, rate)


def check(p: Array, quantity: str, rate: float) -> None:
    """Compare with the integrals of white noise and of its random walk over the span."""
    white, walk = WHITE[quantity], WALK[quantity]
    assert p[0, 0] == pytest.approx(white**2 * SPAN + walk**2 * SPAN**3 / 3, rel=2 / (SPAN * rate))
    assert p[1, 1] == pytest.approx(walk**2 * SPAN, rel=1e-5)


def test_10_000_simulated_integrals_scatter_as_both_programs_expect():
    """Means of two samples, summed as both programs do; samples scatter by N √rate."""
    rate, runs, steps = 100.0, 10_000, 100
    rng = np.random.default_rng(2)
    samples = rng.normal(size=(runs, steps + 1)) * WHITE["accelerometer"] * np.sqrt(rate)
    velocity = (0.5 * (samples[:, 1:] + samples[:, :-1])).sum(axis=1) / rate
    n = keys(vins_text(noise(rate)))["acc_n"]
    covariance = keys(fast_lio_text(noise(rate)))["acc_cov"]
    # A variance of 10 000 runs is known to 1.4 % (1 σ).
    for expected in (steps * 0.5 * (n / rate) ** 2, steps * covariance / rate**2):
        assert velocity.var() == pytest.approx(expected, rel=0.05)


def test_a_data_sheet_writes_both_blocks_and_names_what_is_missing(tmp_path: Path):
    sheet = tmp_path / "sheet.toml"
    gyro = '[datasheet.gyro]\nwhite = "0.15 °/√h"\nwhite_kind = "random walk"\n'
    head = '[datasheet]\nname = "IMU"\nrate = "200 Hz"\n'
    sheet.write_text(f'{head}{gyro}random_walk = "2 °/h/√h"\n', encoding="utf-8")
    to = ("--to", "vins_fusion", "--to", "fast_lio", "--out", tmp_path)
    done = run_program("noise", "--datasheet", sheet, *to)
    assert done.status == 0, done.error
    white = np.radians(0.15) / 60
    texts = [
        (tmp_path / f"sheet.{name}.yaml").read_text(encoding="utf-8")
        for name in ("vins_fusion", "fast_lio")
    ]
    assert keys(texts[0])["gyr_n"] == pytest.approx(white * 20, rel=1e-6)
    assert keys(texts[1])["gyr_cov"] == pytest.approx(white**2 * 200, rel=1e-6)
    assert all("# accelerometer: not stated" in text for text in texts)
    assert not any("acc_n" in text or "acc_cov" in text for text in texts)
    edited = tmp_path / "sheet.fast_lio.yaml"
    edited.write_text(f"{texts[1]}mine: 1\n", encoding="utf-8")
    assert run_program("noise", "--datasheet", sheet, *to).status == 2
    assert edited.read_text(encoding="utf-8").endswith("mine: 1\n")
    assert run_program("noise", "--datasheet", sheet, *to, "--force").status == 0
    assert edited.read_text(encoding="utf-8") == texts[1]
    sheet.write_text(head + gyro, encoding="utf-8")
    done = run_program("noise", "--datasheet", sheet, *to, "--force")
    assert done.status == 2
    assert "random_walk" in done.error


def test_a_block_without_axes_is_refused():
    for write in (vins_text, fast_lio_text):
        with refused():
            write(SensorNoise("log.csv", 1.0, {}))
