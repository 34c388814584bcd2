"""The stored tables of temperature: within their bands, as the page shows, and a sample anew."""

import pytest
from tests.accuracy import ramps, soaks
from tests.evidence import temperature_ramps, temperature_soaks
from tests.evidence.stored_runs import page_text
from tests.evidence.temperature_table import HERE, SEED, Stored, page

# The method's note: rms of the joint fit; mg, ppm, mrad, µrad, K.
NOTE = {
    "k0": 0.040e-3 * soaks.G0,
    "k0_dT": 0.00157e-3 * soaks.G0,
    "k0_dT2": 1.9e-5 * 1e-3 * soaks.G0,
    "k0_dT3": 4.9e-7 * 1e-3 * soaks.G0,
    "k1": 18.3e-6,
    "k1_dT": 0.250e-6,
    "k1_dT2": 0.0069e-6,
    "delta_o": 0.62e-3,
    "delta_p": 0.62e-3,
    "delta_o_dT": 1.12e-6,
    "delta_p_dT": 1.12e-6,
}
LEFT_OUT = {-30: 0.083, -10: 0.055, 12: 0.023, 35: 0.018, 55: 0.048, 75: 0.079}  # mg
UP_AND_DOWN = "up and down, 2 × 30 min"


def test_the_page_shows_the_stored_numbers():
    assert page_text(HERE / "temperature.md") == page(Stored.read())


def test_stored_errors_over_soaks_are_within_the_bands():
    own = Stored.read().content["soaks"]
    assert own["trials"] == 400
    for term, (rms, coverage) in own["terms"].items():
        assert rms <= 1.1 * NOTE[term], term
        assert 0.93 <= coverage <= 0.97, term
    assert 0.95 <= own["nees"] <= 1.08
    assert own["true orders"] >= 0.75 * own["trials"]
    assert all(ratio > 100 for ratio in own["orders too low"].values())
    for celsius, rms, _ in own["changes"]:
        assert rms <= 1.15 * LEFT_OUT[celsius] * 1e-3 * soaks.G0
    assert 0.92 <= own["covered"] <= 0.98


def test_stored_errors_on_the_ramp_up_and_down_are_within_the_bands():
    row = Stored.read().content["ramps"][UP_AND_DOWN]
    assert row["runs"] == 300
    assert 0.75 < row["nees"] < 1.25
    assert row["rms"] <= 3.3
    assert 0.91 <= row["coverage"] <= 0.98
    assert abs(row["lag"] - ramps.LAG) + row["lag_scatter"] <= 1.5


@pytest.mark.slow
def test_a_third_of_the_ramps_agree_with_all_that_are_stored():
    stored = Stored.read().content["ramps"][UP_AND_DOWN]
    again = temperature_ramps.row(UP_AND_DOWN, ramps.PROFILES[UP_AND_DOWN], 100, SEED)
    assert again.rms == pytest.approx(stored["rms"], rel=0.2)
    assert again.lag == pytest.approx(stored["lag"], abs=0.2)


@pytest.mark.evidence
def test_all_soaks_are_as_stored():
    stored = Stored.read().content["soaks"]
    again = temperature_soaks.table(temperature_soaks.fits(SEED, stored["trials"]))
    assert again.nees == pytest.approx(stored["nees"], rel=1e-3)
    for row in again.rows:
        assert row.rms == pytest.approx(stored["terms"][row.term][0], rel=1e-3)
