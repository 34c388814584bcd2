"""Covariances of qualified parameters: what is refused, and what is only rounding."""

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.benches.qualification.result import require_covariance

SD = np.array([1e-7, 1e-6, 1e-8])


def covariance(correlation: float, asymmetry: float = 0.0) -> np.ndarray:
    of_one = np.eye(3)
    of_one[0, 2] = of_one[2, 0] = correlation
    of_one[0, 2] += asymmetry
    return of_one * np.outer(SD, SD)


def test_a_correlation_of_almost_zero_may_differ_by_its_rounding():
    require_covariance(covariance(1e-7, 1e-14), ("a", "b", "c"), "x")


@pytest.mark.parametrize(("correlation", "asymmetry"), [(0.1, 1e-3), (1.0, 0.0), (np.nan, 0.0)])
def test_what_is_no_covariance_is_refused(correlation: float, asymmetry: float):
    with pytest.raises(InputError) as caught:
        require_covariance(covariance(correlation, asymmetry), ("a", "b", "c"), "x")
    assert caught.value.key == "covariance"
