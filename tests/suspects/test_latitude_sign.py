"""The sign of a latitude: what all gyros have in common, and advice that names it."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.runfile.key_sweep import example, toml

from inercal import calibrate
from inercal.basics.arrays import Array
from inercal.calibration.detectability import wrong_latitude_sign
from inercal.estimation import Estimate
from inercal.physics.sensors import triad
from inercal.pipeline.run_calibration import calibrate_run
from inercal.report import write_report
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
SENSOR = triad("t", "w", "g").with_coefficients("g_i", "g_p", "g_o")
EARTH, G = 7.292115e-5, 9.80665


def warned(values: Array, latitude: float, sd: float | Array = 1e-8) -> bool:
    made = SimpleNamespace(value=values, covariance=np.eye(len(values)) * np.square(sd))
    return any(wrong_latitude_sign(cast("Estimate", made), SENSOR, np.radians(latitude)))


def test_a_common_sensitivity_of_twice_the_vertical_earth_rate_is_a_wrong_sign():
    along = np.array([1.0, 0.0, 0.0] * 3)
    shift = 2 * EARTH * np.sin(np.radians(50)) / G
    own = 0.2 * shift * np.array([1.0, -0.8, 0.5, -0.7, 0.6, 0.1, 0.6, 0.3, -1.1])
    assert warned(own + shift * along, -50.0)
    assert not warned(own + shift * along, 50.0)
    assert not warned(own, -50.0)
    assert not warned(own + shift * along, -2.0)
    assert not warned(own + shift * along, -50.0, sd=shift)
    rng = np.random.default_rng(1)
    alarms = [warned(shift * rng.standard_normal(9), -50.0) for _ in range(1000)]
    assert np.mean(alarms) < 3e-3


def test_a_shared_part_of_six_standard_uncertainties_is_a_wrong_sign():
    """All nine sensitivities are 0, as with a phone; those across are known less well."""
    along = np.array([1.0, 0.0, 0.0] * 3)
    shift = 2 * EARTH * np.sin(np.radians(48)) / G
    sd = shift * np.where(along > 0, 0.2, 0.3)
    noise = sd * np.random.default_rng(2).standard_normal((200, 9))
    found = [warned(shift * along + one, -48.0, sd) for one in noise]
    assert np.mean(found) > 0.8
    own = np.random.default_rng(3).standard_normal((800, 9))
    own *= shift * np.geomspace(0.01, 3, 800)[:, np.newaxis]
    noise = sd * np.random.default_rng(4).standard_normal((800, 9))
    assert sum(warned(one, -48.0, sd) for one in own + noise) <= 1


@pytest.mark.slow
def test_a_wrong_sign_of_the_latitude_of_a_rate_test_is_found(tmp_path: Path):
    name, changes = "rate_platform/imu.toml", (("method", "also", ["g"]), ("bench", "arm", "5 mm"))
    data = ("data", "file", str(EXAMPLES / "rate_platform/imu.csv"))
    grades = {}
    for latitude in (50, -50):
        path = tmp_path / "run.toml"
        stated = ("bench", "latitude", f"{latitude} °")
        path.write_text(toml(example(name, *changes, data, stated)), encoding="utf-8")
        outcome = calibrate_run(read(path), advise=False)
        grades[latitude] = (outcome.verdict.grade, "latitude" in outcome.verdict.warned)
    assert grades == {50: ("consistent", False), -50: ("reservations", True)}


@pytest.mark.slow
def test_a_reversed_sense_is_reported_with_the_latitude_beside_it(tmp_path: Path):
    data = ("data", "file", str(EXAMPLES / "centrifuge/lab.csv"))
    stated = ("bench", "latitude", "-52.1 ° ± 0.1 °")
    path = tmp_path / "run.toml"
    path.write_text(toml(example("centrifuge/lab.toml", data, stated)), encoding="utf-8")
    outcome = calibrate(path)
    assert outcome.verdict.suspect is not None
    assert "latitude" in outcome.verdict.suspect.indistinguishable
    (step,) = [line for line in outcome.verdict.lines if line.startswith("Next")]
    assert "latitude" in step
    assert "sense" in step
    assert write_report(outcome, tmp_path / "report.html").stat().st_size > 0
