"""The stored counts of magnetometers are as required; a sample of devices is worked out again."""

import json

import numpy as np
import pytest
from scipy.stats import binom
from tests.base_seeds import chosen
from tests.evidence import magnetometer
from tests.evidence.stored_runs import page_text

FOUND = json.loads(magnetometer.DATA.read_text(encoding="utf-8"))["rows"]
CALM = [name for name, row in magnetometer.ROWS.items() if not row.disturbed]
DETECTED = [name for name, row in magnetometer.ROWS.items() if row.eta]


@pytest.mark.parametrize("name", magnetometer.ROWS)
def test_every_row_counts_all_of_its_devices(name: str):
    tasks = magnetometer.tasks(name, magnetometer.DEVICES)
    assert FOUND[name]["devices"] == magnetometer.BATCH * len(tasks) >= 90


@pytest.mark.parametrize("name", [*CALM, "uneven"])
def test_errors_of_magnetometers_are_as_stated(name: str):
    assert magnetometer.within(FOUND[name]), FOUND[name]


@pytest.mark.parametrize("name", CALM)
def test_false_alarms_are_as_rare_as_the_level_of_the_tests(name: str):
    one = FOUND[name]
    level = magnetometer.SIGNIFICANCE_LEVEL
    assert one["devices"] - one["consistent"] <= binom.ppf(0.999, one["devices"], level)


@pytest.mark.parametrize("name", DETECTED)
def test_disturbances_of_the_stated_size_are_detected(name: str):
    one = FOUND[name]
    assert one["found"] >= binom.ppf(0.001, one["devices"], 0.95)


def test_a_large_step_is_never_called_consistent():
    assert FOUND["large step"]["consistent"] == 0
    assert FOUND["step"]["consistent"] <= 0.1 * FOUND["step"]["devices"]


def test_an_uneven_field_is_estimated():
    one = FOUND["uneven"]
    assert one["tau_percent"] == pytest.approx(100 * magnetometer.INHOMOGENEITY, rel=0.1)


def test_the_page_is_that_of_the_counts():
    stored = json.loads(magnetometer.DATA.read_text(encoding="utf-8"))
    assert page_text(magnetometer.PAGE) == magnetometer.page(stored)


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen([*CALM, "large step"], [CALM[0], CALM[-1], "large step"]))
def test_a_sample_of_magnetometers_is_as_stated_again(name: str):
    """Seeds that the stored counts do not use."""
    devices = [one for k in range(3) for one in magnetometer.batch((name, 17, k))]
    if name == "large step":
        assert not any(one.consistent for one in devices)
        assert sum(one.found for one in devices) >= len(devices) - 1
        return
    # Few devices do not tell how much they scatter: the stored bands of many do.
    wider = (FOUND[name]["devices"] / len(devices)) ** 0.5
    for values, expected, band in (
        ([one.nees for one in devices], 1.0, FOUND[name]["nees_band"]),
        ([one.inside for one in devices], magnetometer.EXPECTED, FOUND[name]["covered_band"]),
    ):
        assert abs(np.mean(values) - expected) < wider * (band[1] - band[0]) / 2
    assert sum(one.consistent for one in devices) >= len(devices) - 3
