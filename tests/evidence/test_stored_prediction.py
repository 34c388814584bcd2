"""The stored coverages of predictions are as stated; a sample of devices is worked out again."""

import json

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.evidence import prediction
from tests.evidence.stored_runs import page_text

from inercal.methods import METHODS

FOUND = json.loads(prediction.DATA.read_text(encoding="utf-8"))
SAMPLE = ("six_position", "ferraris", "centrifuge_norm", "tumble", "ship_planar", "rates_and_poses")


def test_every_method_has_a_case():
    found = {name.partition(",")[0] for name in FOUND["methods"]}
    assert found >= set(METHODS)


@pytest.mark.parametrize("method", FOUND["methods"])
def test_u_covers_the_error_of_corrected_values_as_often_as_stated(method: str):
    one = FOUND["methods"][method]
    expected = len(FOUND["seeds"]) * prediction.DEVICES
    assert one["devices"] + one["refused"] == expected
    assert one["refused"] <= 0.01 * expected
    assert prediction.within(one), one


def test_the_page_is_that_of_the_counts():
    assert page_text(prediction.PAGE) == prediction.page(FOUND)


@pytest.mark.slow
def test_a_small_sample_of_devices_is_covered_again():
    found = [prediction.covered(method, 1, k) for method in SAMPLE for k in range(6)]
    shares = np.array([one for one in found if one is not None]).mean(axis=1)
    # The shares of 36 devices scatter by at most the 0.21 of devices that are covered or not.
    assert abs(shares.mean() - 0.9545) < 4 * 0.21 / len(found) ** 0.5


@pytest.mark.slow
@pytest.mark.parametrize("method", chosen(prediction.SLOW, ["turntable_kalman", "field_and_rates"]))
def test_a_sample_of_recordings_is_covered_again(method: str):
    found = [prediction.covered(method, 1, k) for k in range(8)]
    shares = np.array([one for one in found if one is not None]).mean(axis=1)
    assert abs(shares.mean() - 0.9545) < 4 * 0.21 / len(found) ** 0.5
