"""Bench estimates against the same fit with a prior of the parameter that says nothing."""

from pathlib import Path

import pytest

from inercal.calibration.files import load, save
from inercal.calibration.shared_errors import BenchEstimate
from inercal.pipeline import calibrate

EXAMPLE = Path(__file__).parents[2] / "examples" / "centrifuge"


def bench_estimates(path: Path) -> dict[str, BenchEstimate]:
    """Return the bench estimates of a run by name."""
    return {one.name: one for one in calibrate(path).calibration.bench_estimates or ()}


@pytest.fixture(scope="module")
def text() -> str:
    """Return the run file, with the path of its data."""
    found = (EXAMPLE / "lab.toml").read_text(encoding="utf-8")
    return found.replace('file = "lab.csv"', f'file = "{EXAMPLE / "lab.csv"}"')


@pytest.mark.slow
def test_a_bench_estimate_is_the_estimate_without_what_was_stated(text: str, tmp_path: Path):
    """A radius that is stated 1 mm larger with a u of 20 mm, instead of 20 µm, changes nothing."""
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8")
    stated = bench_estimates(path)["radius"]
    path.write_text(text.replace("1.5 m ± 20 µm", "1.501 m ± 20 mm"), encoding="utf-8")
    free = bench_estimates(path)["radius"]
    assert free.stated == pytest.approx(1.501)
    # The fit is not linear: 1 mm of the prior leaves 1e-3 of the radius of u.
    assert free.value == pytest.approx(stated.value, abs=0.05 * stated.std)
    assert free.std == pytest.approx(stated.std, rel=1e-2)
    assert free.own_std == pytest.approx(stated.own_std, rel=1e-2)


@pytest.mark.slow
def test_what_the_data_do_not_show_is_no_bench_estimate(text: str, tmp_path: Path):
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8")
    outcome = calibrate(path)
    found = outcome.calibration.bench_estimates or ()
    names = {one.name for one in found}
    assert "radius" in names
    assert not {"lean1", "lean2", "latitude"} & names
    assert all(one.own_std <= one.std for one in found)
    file = save(outcome.calibration, tmp_path / "run.calibration.json")
    assert load(file).bench_estimates == found
