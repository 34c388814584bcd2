"""Limits judged by the uncertainty of the next use."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm, t
from tests.repeatability.example import repeat_example

import inercal
from inercal.basics.errors import InputError
from inercal.calibration.files import load, save

LIMITS = '[specification]\nuncertainty = "next_use"\nrepeatability = "{}"\n'
LIMIT = '[specification.limits]\nbias = "± 12 mg"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the example's folder with four calibrations and their repeatability."""
    repeat_example(tmp_path)
    return tmp_path


def with_limits(folder: Path, text: str) -> Path:
    run = folder / "limits.toml"
    run.write_text((folder / "session_4.toml").read_text() + text)
    return run


@pytest.mark.slow
def test_u_of_the_next_use_holds_session_and_scatter(folder: Path):
    run = with_limits(folder, LIMITS.format("TRIAD-7.repeatability.json") + LIMIT)
    found = inercal.calibrate(run).calibration
    conformity, scatter = found.conformity, load_scatter(folder)
    assert conformity is not None
    assert conformity.uncertainty == "next_use"
    names = list(found.sensor.coefficients)
    for one in conformity.limits:
        k = names.index(one.name)
        factor = t.ppf(norm.cdf(2.0), 9) / 2  # of 3 like axes and 4 sessions
        expected = found.covariance[k, k] + 2 * factor**2 * scatter[k, k]
        assert one.std == pytest.approx(np.sqrt(expected), rel=1e-9)
        assert one.guard == pytest.approx(2 * one.std, rel=1e-9)
    path = save(found, folder / "limits.calibration.json")
    assert load(path).conformity == conformity


def load_scatter(folder: Path) -> np.ndarray:
    from inercal.calibration.specification import load_next_use

    return load_next_use(folder / "TRIAD-7.repeatability.json").covariance


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[specification]\nuncertainty = "next_use"\n', "inercal repeat"),
        ('[specification]\nrepeatability = "TRIAD-7.repeatability.json"\n', "next_use"),
        (LIMITS.format("absent.json"), "absent.json"),
        (LIMITS.format("session_1.calibration.json"), "inercal repeat"),
    ],
)
def test_wrong_keys_are_refused(folder: Path, text: str, words: str):
    with pytest.raises(InputError, match=r"\[specification\]") as caught:
        inercal.calibrate(with_limits(folder, text + LIMIT))
    assert words in str(caught.value)


@pytest.mark.slow
def test_the_calibration_of_the_next_use_corrects_readings(folder: Path):
    found = load(folder / "TRIAD-7.next_use.calibration.json")
    last = load(folder / "session_4.calibration.json")
    assert found.sensor.coefficients == last.sensor.coefficients
    assert np.all(found.std[:2] > last.std[:2])
    readings = np.array([[0.1, -0.2, 1.0]])
    np.testing.assert_allclose(found.correct(readings).f, last.correct(readings).f, atol=0.05)
