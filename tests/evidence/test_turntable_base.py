"""A few devices of the base cases of turntables: errors, χ² and verdicts are as stated."""

import numpy as np
import pytest
from scipy import stats
from tests.evidence.turntable_base import METHODS, calibrate_device


@pytest.mark.evidence
@pytest.mark.parametrize("method", METHODS)
def test_devices_on_random_paths_are_as_stated(method: str):
    # All of both grades and three rates; .02 °/√h at 50 Hz is the first.
    devices = [calibrate_device(method, k) for k in range(6)]
    nees = sum(one.nees for one in devices) * 24
    assert 1e-4 < stats.chi2.sf(nees, 24 * len(devices)) < 1 - 1e-4
    for p in zip(*(one.p_values for one in devices), strict=True):
        # Fisher's sum of both tails: neither too large nor too small on the whole
        for tail in (np.array(p), 1 - np.array(p)):
            assert stats.chi2.sf(-2 * np.sum(np.log(tail)), 2 * len(p)) > 1e-4
    assert sum(one.grade != "consistent" for one in devices) <= 1
