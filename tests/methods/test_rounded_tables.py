"""Rounded readings in tables of means, in systematic calibration and on temperature ramps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.methods import systematic_table
from tests.methods.systematic_cases import errors_of, sensor_of, solved, table_of
from tests.methods.test_systematic import device
from tests.refusals import refused

from inercal.pipeline import Outcome, calibrate
from inercal.runfile import read

Array = NDArray[np.float64]
DEGREE = np.pi / 180
UPS = {"x_p": 0, "x_a": 0, "y_p": 1, "y_a": 1, "z_p": 2, "z_a": 2}


def table_of_means(
    folder: Path, digits: int, seed: int, sd: str = "0.2 mg"
) -> tuple[Outcome, Array]:
    """Return six positions of accelerometers written with some decimals of g, and their biases."""
    rng = np.random.default_rng(seed)
    k0, k1 = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.02, 0.02, 3)
    lines = ["position,ax,ay,az"]
    for name, axis in UPS.items():
        up = np.zeros(3)
        up[axis] = 1 if name.endswith("p") else -1
        mean = (1 + k1) * up + k0 + 2e-4 * rng.standard_normal(3)
        lines.append(f"{name},{','.join(f'{one:.{digits}f}' for one in mean)}")
    (folder / "means.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = folder / "run.toml"
    path.write_text(
        '[sensor.accelerometer]\nunit = "g"\n[bench]\ngravity = "1 g ± 1e-6 g"\ntilt = "0.01 °"\n'
        '[data]\nfile = "means.csv"\nkind = "means"\nlabel = "position"\n'
        f'accelerometer = ["ax", "ay", "az"]\nsd = {{accelerometer = "{sd}"}}\n'
        '[method]\nname = "six_position"\n',
        encoding="utf-8",
    )
    return calibrate(read(path)), k0


@pytest.mark.slow
@pytest.mark.parametrize("digits", [2, 3, 5])
def test_a_table_notices_its_own_decimals(digits: int, tmp_path: Path):
    z: list[float] = []
    sizes: list[float] = []
    for seed in range(6):
        outcome, k0 = table_of_means(tmp_path, digits, seed)
        found = outcome.calibration
        for axis, bias in zip("xyz", k0, strict=True):
            sd = found.uncertainty(f"a{axis}.k0") / 9.80665
            z.append((found.value(f"a{axis}.k0") / 9.80665 - bias) / sd)
            sizes.append(sd)
        assert found.verdict is not None
        assert bool(found.verdict.rounding) == (digits < 4)
    assert np.abs(z).max() < 3.5
    assert np.mean(np.square(z)) < 1.9
    if digits == 2:  # a tenth of a milli-g would be 30 times too small
        assert min(sizes) > 1e-3
    if digits == 5:
        assert max(sizes) < 1.5e-4


def test_whole_numbers_of_g_are_not_taken_for_steps(tmp_path: Path):
    """Nobody reads an accelerometer to a whole g: such a table is an example typed by hand."""
    lines = ["position,ax,ay,az"]
    for name, axis in UPS.items():
        row = ["0", "0", "0"]
        row[axis] = "1" if name.endswith("p") else "-1"
        lines.append(f"{name},{','.join(row)}")
    outcome, _ = table_of_means(tmp_path, 5, 0)
    (tmp_path / "means.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    outcome = calibrate(read(tmp_path / "run.toml"))
    assert outcome.calibration.uncertainty("ax.k0") < 1e-3 * 9.80665


def rounded(step: float, seed: int) -> systematic_table.Recorded:
    """Return a recording of tactical grade, its gyros in steps of °/s."""
    recorded = device("T", seed, rate_hz=50.0)
    reading = recorded.reading.copy()
    reading[:, 3:] = np.rint(reading[:, 3:] / (step * DEGREE)) * step * DEGREE
    return replace(recorded, reading=reading)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.004, 0.03])
def test_systematic_counts_the_rounding_of_gyros(step: float):
    grade = systematic_table.GRADES["T"]
    sensor, recorded = sensor_of(grade), rounded(step, 1)
    estimate = solved(recorded, sensor, table_of(systematic_table.Table()))
    error, covariance = errors_of(estimate, recorded, sensor)
    z = error / np.sqrt(np.diag(covariance))
    assert estimate.converged
    assert np.abs(z).max() < 4
    assert np.mean(z**2) < 1.7


@pytest.mark.parametrize("estimator", ["batch", "kalman"])
@pytest.mark.parametrize("step", [0.06, 0.5])
def test_systematic_refuses_gyros_whose_steps_hide_their_noise(step: float, estimator: str):
    sensor, recorded = sensor_of(systematic_table.GRADES["T"]), rounded(step, 1)
    with refused(names=("gx", "gy", "gz")):
        solved(recorded, sensor, table_of(systematic_table.Table()), estimator=estimator)
