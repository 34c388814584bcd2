"""Turntable with flicker of the biases: a sample of `tests.evidence.turntable_errors`."""

import pytest
from tests.base_seeds import chosen
from tests.evidence.turntable_errors import FLICKER, flicker_nees


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", chosen(FLICKER, ["navigation grade", "tactical grade, holds of 10 s"])
)
def test_errors_under_flicker_are_as_large_as_stated(case: str):
    found = flicker_nees(case, 6, seed=1)
    print(found)
    assert abs(found.whole - 1) <= found.band
