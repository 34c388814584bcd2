"""Tumble tests over soaks: orders, soaks left out, and biases that come back from soak to soak."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.pipeline import calibrate
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples" / "dividing_head"
TUMBLE = (EXAMPLES / "tumble.toml").read_text(encoding="utf-8")


def tumbled_soaks(folder: Path, order: str, more: str = "", shift: float = 0.0) -> Path:
    """Write the tumble example at four temperatures, with a bias of 200 µg/K.

    In every other soak the bias is larger by `shift`, g.
    """
    name = "tumble.csv"
    header, *rows = (EXAMPLES / name).read_text().split()
    lines = [f"{header},temp"]
    for celsius, away in ((0, 0.0), (20, shift), (40, 0.0), (60, shift)):
        for angle, volts in (row.split(",") for row in rows):
            reading = float(volts) + 1.3 * (200e-6 * (celsius - 20) + away)
            lines.append(f"{angle},{reading:.9f},{celsius}")
    changes = {
        'file = "tumble.csv"': 'file = "tumble.csv"\ntemperature = "temp"',
        'name = "tumble"': f'name = "tumble"\ntemperature_order = {order}\n{more}',
    }
    text = TUMBLE
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    folder.mkdir(exist_ok=True)
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_tumble_over_soaks_finds_the_orders_that_it_has(tmp_path: Path):
    outcome = calibrate(tumbled_soaks(tmp_path, "[2, 0, 0]"))
    fit, found = outcome.temperature_fit, outcome.calibration
    assert fit is not None
    assert fit.orders == {"f": (2, 0, 0)}
    np.testing.assert_allclose(fit.soaks, np.array([0, 20, 40, 60]) + ZERO_CELSIUS)
    assert found.value("a.k0_dT") == pytest.approx(200e-6 * 9.80665, rel=1e-2)


@pytest.mark.parametrize("order", ["[3, 0, 0]", "[1, 2, 0]", "[1, 0, 1]"])
def test_an_order_that_the_method_has_only_in_part_is_refused(order: str, tmp_path: Path):
    with refused(InputError, key="[method] temperature_order"):
        read(tumbled_soaks(tmp_path, order))


@pytest.mark.slow
def test_a_tumble_over_soaks_tests_its_orders_and_predicts_each_soak(tmp_path: Path):
    outcome = calibrate(tumbled_soaks(tmp_path, '"auto"'))
    fit = outcome.temperature_fit
    assert fit is not None
    assert fit.orders["f"][0] == 1
    assert fit.orders["f"][2] == 0
    assert [one.components for one in fit.left_out] == [len(outcome.observations.labels) // 4] * 4


@pytest.mark.slow
def test_biases_that_come_back_within_what_is_stated_leave_chi2_and_u_alone(tmp_path: Path):
    repeats = '[environment]\naccelerometer_repeatability = "50 µg"\n'
    moved = calibrate(tumbled_soaks(tmp_path / "told", "[1, 0, 0]", repeats, 50e-6))
    assert moved.estimate.consistent
    assert moved.verdict.grade == "consistent"
    silent = calibrate(tumbled_soaks(tmp_path / "silent", "[1, 0, 0]", shift=50e-6))
    assert not silent.estimate.consistent
    steady = calibrate(tumbled_soaks(tmp_path / "steady", "[1, 0, 0]", repeats))
    for name in ("a.k0", "a.k0_dT", "a.k2"):
        u = moved.calibration.uncertainty(name)
        assert u == pytest.approx(steady.calibration.uncertainty(name), rel=1e-2)
    # Four soaks in steps of 20 K: 50 µg/√Σ(T − T̄)².
    stated = 50e-6 * 9.80665 / np.sqrt(2000.0)
    assert moved.calibration.uncertainty("a.k0_dT") == pytest.approx(stated, rel=0.02)
