"""The example of one accelerometer on a centrifuge; its readings are made without inercal."""

import importlib.util
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inercal.benches.kind_definition import KINDS
from inercal.methods import METHODS
from inercal.pipeline import calibrate
from inercal.runfile import read

FOLDER = Path(__file__).parents[2] / "examples" / "one_axis_arm"
G0, GRAVITY, RADIUS = 9.80665, 9.81262, 1.5
BIAS, SCALE, SQUARE = 0.01 * G0, 0.002, 20e-6 / G0  # m/s², 1, 1/(m/s²)
EARTH = 7.292115e-5 * np.sin(np.radians(52.1))  # rad/s, along the spindle


@pytest.fixture
def run_file(tmp_path: Path) -> Iterator[Path]:
    spec = importlib.util.spec_from_file_location("one_axis_arm", FOLDER / "one_axis_arm.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in ("arm.toml", "arm.csv"):
        shutil.copy(FOLDER / name, tmp_path)
    with (
        KINDS.with_("one_axis_arm", module.KIND),
        METHODS.with_("centrifuge_axis", module.METHOD),
    ):
        yield tmp_path / "arm.toml"


def write_table(path: Path, seed: int) -> None:
    """Write the readings of the x axis, V, outward and inward and with gravity up and down."""
    rng, rows = np.random.default_rng(seed), ["position,psi,theta,rpm,ax"]
    tilt = rng.normal(0, np.radians(0.02), 4)  # of a position, about z
    for k, (psi, theta) in enumerate([(0, 0), (180, 0), (0, 180), (180, 180)]):
        outward = np.cos(np.radians(psi) + tilt[k]) * np.cos(np.radians(theta))
        for rpm in (40, 80, 120, 160):
            f = -RADIUS * (rpm * np.pi / 30 + EARTH) ** 2 * outward
            y = f + BIAS + SCALE * f + SQUARE * f**2
            rows.append(f"{k},{psi},{theta},{rpm},{0.1 * y / G0 + rng.normal(0, 1e-6):.7f}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_the_example_is_consistent(run_file: Path):
    assert calibrate(run_file).verdict.grade == "consistent"


@pytest.mark.parametrize("seed", range(3))
def test_bias_scale_factor_and_nonlinearity_are_recovered(run_file: Path, seed: int):
    write_table(run_file.with_name("arm.csv"), seed)
    found = calibrate(run_file).calibration
    for name, truth in (("ax.k0", BIAS), ("ax.k1", SCALE), ("ax.k2", SQUARE)):
        assert abs(found.value(name) - truth) < 3 * found.uncertainty(name)


def test_its_plan_determines_what_it_estimates(run_file: Path):
    steps = read(run_file).steps
    assert len({step.label for step in steps}) == len(steps) == 6
