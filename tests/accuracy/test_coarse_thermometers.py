"""Ramps whose thermometer reports whole or half degrees: lag, coefficients, and the refusals."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import warm_ups
from tests.accuracy.warm_ups import WarmUp
from tests.base_seeds import SEEDS
from tests.evidence.coarse_thermometers import (
    BAD,
    GOOD,
    errors,
    fitted,
    gyros,
    observed,
    row,
)
from tests.reports import report_file

import inercal
from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.methods.temperature_ramp import ramp, rest
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.methods.temperature_ramp.thermometer_steps import (
    find_crossings,
    is_one_exponential,
    thermometer_step,
)
from inercal.recordings.environment import Environment

DEG_H = np.pi / 180 / 3600


def blocks(warm: WarmUp) -> RampBlocks:
    track = observed(warm, (1, 0)).track
    assert track is not None
    return RampBlocks.from_track(track)


@pytest.mark.parametrize("step", [1.0, 0.5, 2.0, 0.1, 0.0625])
def test_the_step_of_a_thermometer_is_found(step: float):
    _, kelvin, _ = warm_ups.made(WarmUp(step=step), np.random.default_rng(1))
    assert thermometer_step(kelvin) == pytest.approx(step, rel=1e-6)


def test_sixteenths_that_were_written_with_two_decimals_are_still_steps():
    _, kelvin, _ = warm_ups.made(WarmUp(step=0.0625), np.random.default_rng(1))
    written = np.round(kelvin - warm_ups.ZERO, 2) + warm_ups.ZERO
    assert thermometer_step(written) == pytest.approx(0.0625, rel=0.01)


@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_an_unrounded_thermometer_has_no_step(noise: float):
    _, kelvin, _ = warm_ups.made(WarmUp(step=0.0, noise=noise), np.random.default_rng(1))
    assert thermometer_step(kelvin) is None


@pytest.mark.parametrize("back", [False, True])
def test_fine_thermometers_are_smoothed_and_coarse_ones_are_not(back: bool):
    assert blocks(WarmUp(step=0.0, back=back)).course is None
    assert blocks(WarmUp(step=0.01, back=back)).course is None
    assert blocks(WarmUp(step=1.0, back=back)).course is not None


@pytest.mark.slow
def test_whole_degrees_up_and_down_give_the_lag_to_a_second():
    warm = WarmUp(back=True, minutes=20.0, constant=300.0)
    off, u, terms = errors(fitted(warm, (1, 3)), warm)
    assert u < 0.5
    assert abs(off) < 3 * u
    assert (np.abs(terms) < 4).all()


@pytest.mark.parametrize("refreshed", [1.3, 5.0])
def test_crossings_lie_on_the_course_within_their_uncertainty(refreshed: float):
    warm = WarmUp(refreshed=refreshed)
    time, kelvin, _ = warm_ups.made(warm, np.random.default_rng(2))
    exact = warm_ups.made(WarmUp(step=0.0), np.random.default_rng(2))
    found = find_crossings(time, kelvin, 1.0)
    assert found.refreshed == pytest.approx(refreshed, rel=2e-3)
    off = (found.kelvin - np.interp(found.time, exact[0], exact[1])) / found.sd
    assert 0.5 < np.sqrt((off**2).mean()) < 1.5
    assert abs(off.mean()) < 3 / np.sqrt(off.size)


@pytest.mark.slow
def test_a_warm_up_that_has_become_one_exponential_is_known_as_such():
    for warm, expected in ((WarmUp(), False), (WarmUp(lost=300.0), True)):
        time, kelvin, _ = warm_ups.made(warm, np.random.default_rng(3))
        assert is_one_exponential(find_crossings(time, kelvin, 1.0)) == expected


@pytest.mark.slow
def test_whole_degrees_of_a_freezer_give_the_lag_and_the_coefficients(tmp_path: Path):
    for suffix in ("csv", "toml"):
        shutil.copy(report_file(f"05_freezer_whole_degrees.{suffix}"), tmp_path)
    outcome = inercal.calibrate(tmp_path / "05_freezer_whole_degrees.toml")
    found = outcome.calibration
    for name, right in (("gx.bias_dT", 72.0), ("gy.bias_dT", -54.0), ("gz.bias_dT", 18.0)):
        off = found.value(name) / DEG_H - right
        assert abs(off) < 2 * found.uncertainty(name) / DEG_H, name
        assert found.uncertainty(name) < 0.5 * DEG_H
    lag = outcome.estimate.names.index("lag")
    u = float(np.sqrt(outcome.estimate.covariance[lag, lag]))
    assert abs(outcome.estimate.value[lag] - 30.0) < 2 * u
    assert u < 4.0


@pytest.mark.parametrize("name", [pytest.param("first 300 s lost", marks=pytest.mark.slow), "5 K"])
def test_a_lag_that_the_data_do_not_determine_is_refused_by_name(name: str):
    with pytest.raises(NotObserved) as refusal:
        fitted(BAD[name], (1, 0))
    assert refusal.value.names == ("lag",)
    assert refusal.value.directions == ("lag",)
    assert ("single exponential" in str(refusal.value)) == (name == "first 300 s lost")


@pytest.mark.slow
def test_a_stated_lag_stands_where_the_data_do_not_determine_it():
    warm = BAD["first 300 s lost"]
    estimate = fitted(warm, (1, 1), Environment("ramp", 1e-9, lag=Measured(31.0, 2.0)))
    off, u, terms = errors(estimate, warm)
    assert off == pytest.approx(1.0)
    assert u == pytest.approx(2.0)
    assert (np.abs(terms) < 4).all()
    exact = fitted(warm, (1, 1), Environment("ramp", 1e-9, lag=Measured(31.0, 0.0)))
    assert "lag" not in exact.names
    assert (exact.std[:9] <= estimate.std[:9]).all()


@pytest.mark.slow
def test_a_term_of_the_rate_is_refused_one_way():
    seen, bench = observed(WarmUp(), (1, 0)), Hand(Measured(9.81, 1e-4))
    with pytest.raises(NotObserved) as refusal:
        ramp(seen, gyros(1.0, "bias_dTdt"), bench, rest())
    assert refusal.value.names == ("gx.bias_dTdt", "gy.bias_dTdt", "gz.bias_dTdt")


@pytest.mark.slow
def test_truncation_is_a_common_error_of_the_temperature_unless_it_is_known():
    unknown, known = (fitted(WarmUp(), (1, 2), one) for one in (None, Environment("ramp", 1e-9)))
    at = unknown.names.index("gx.bias")
    added = unknown.covariance[at, at] - known.covariance[at, at]
    assert added == pytest.approx((0.25 * known.value[at + 1]) ** 2, rel=1e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["1 K", "0.5 K"])
def test_errors_of_a_few_warm_ups_are_as_stated(name: str, seed: int):
    found = row(GOOD[name], 6, seed)
    assert found.refused <= 1
    assert found.rms < 2 * found.u
    assert found.coverage >= 0.5
    assert found.coefficients > 0.7


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "most"),
    # The note: rms of the lag, s, with room for the draws of 40 runs.
    [("1 K", 3.27), ("0.5 K", 2.41), ("1 K, 60 s of rest first", 1.34)],
)
def test_errors_of_many_warm_ups_are_those_of_the_note(name: str, most: float):
    found = row(GOOD[name], 40, 1)
    assert found.refused <= 2
    assert found.rms < 1.4 * most
    assert found.coverage >= 0.83  # 99.9 % band of .95
    assert found.coefficients >= 0.88
    assert 0.7 < found.nees < 1.5


@pytest.mark.evidence
@pytest.mark.parametrize("name", BAD)
def test_hardly_any_lag_is_stated_where_it_is_void(name: str):
    assert row(BAD[name], 8, 2).refused >= 7
