"""Turntable with biases that flicker: a sample of `tests.evidence.turntables`, which has it all."""

import pytest
from tests.evidence.turntables import FLICKER, of_flicker


@pytest.mark.slow
@pytest.mark.parametrize("case", FLICKER)
def test_errors_under_flicker_are_as_large_as_stated(case: str):
    found = of_flicker(case, 12, seed=1)
    print(found)
    assert abs(found.whole - 1) <= found.band
