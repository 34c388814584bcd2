"""Deviations against NBS14 (NIST SP 1065, 12.4) and the variances of exact models."""

import numpy as np
import pytest
from tests.noise.generator import MEMS, draw

from inercal.basics.errors import InputError
from inercal.noise.confidence import degrees_of_freedom
from inercal.noise.deviations import (
    averaging_factors,
    cumulative_sum,
    deviations,
    sum_of_squared_differences,
    variance,
)

NBS14 = {  # SP 1065, table 31: 1000 points at averaging factors 1, 10, 100
    "adev": (2.922319e-1, 9.965736e-2, 3.897804e-2),
    "oadev": (2.922319e-1, 9.159953e-2, 3.241343e-2),
    "mdev": (2.922319e-1, 6.172376e-2, 2.170921e-2),
    "hdev": (2.943883e-1, 1.052754e-1, 3.910861e-2),
    "ohdev": (2.943883e-1, 9.581083e-2, 3.237638e-2),
    "tdev": (1.687202e-1, 3.563623e-1, 1.253382e-0),
    "totdev": (2.922319e-1, 9.134743e-2, 3.406530e-2),
    "htot": (2.943883e-1, 9.614787e-2, 3.058103e-2),
    "mtot": (2.418528e-1, 6.499161e-2, 2.287774e-2),
}


@pytest.fixture(scope="module")
def nbs14() -> np.ndarray:
    """Return the 1000 points: n ← 16807 n mod 2³¹−1, from 1234567890."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


@pytest.mark.parametrize("kind", NBS14)
def test_deviations_of_nbs14_agree_to_seven_digits(nbs14: np.ndarray, kind: str):
    found = deviations(nbs14, 1.0, kind, factors=[1, 10, 100]).value
    # htot at 10 is 9.614787501e-2, a hair above the middle; the table has 9.614787e-2.
    units = 0.502 if kind == "htot" else 0.5
    for value, printed in zip(found, NBS14[kind], strict=True):
        last_digit = 10.0 ** (np.floor(np.log10(printed)) - 6)
        assert abs(value - printed) <= units * last_digit


@pytest.mark.parametrize("kind", ["adev", "oadev", "mdev", "hdev", "ohdev", "tdev"])
def test_deviations_are_those_of_allantools(kind: str):
    import allantools

    y = np.cumsum(np.random.default_rng(7).standard_normal(5000)) * 0.01
    y += np.random.default_rng(8).standard_normal(5000)
    factors = [1, 3, 16, 100, 700]
    tau, theirs, _, _ = getattr(allantools, kind)(y, 50.0, "freq", np.array(factors) / 50.0)
    np.testing.assert_allclose(tau, np.array(factors) / 50.0)
    ours = deviations(y, 0.02, kind, factors=factors).value
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_mtot_of_nbs14_without_bias_correction(nbs14: np.ndarray):
    x = cumulative_sum(nbs14)
    found = [variance(x, m, "mtot")[0] ** 0.5 for m in (1, 10, 100)]
    assert np.allclose(found, (0.2066, 0.05553, 0.01955), atol=5e-5)


def test_white_noise_of_nbs14_has_the_name_white(nbs14: np.ndarray):
    assert deviations(nbs14, 1.0, factors=[1, 10]).label == ("white", "white")


@pytest.mark.parametrize(
    ("alpha", "edf"), [(0, 3205), (-1, 3669), (-2, 3124)], ids=["white", "flicker", "random walk"]
)
def test_degrees_of_freedom_are_those_of_greenhall_and_riley(alpha: int, edf: float):
    assert degrees_of_freedom("oadev", alpha, 1, 4096) == pytest.approx(edf, rel=2e-3)


def test_the_interval_covers_the_true_deviation_of_white_noise():
    rng, inside, total = np.random.default_rng(5), 0, 0
    for _ in range(200):
        found = deviations(rng.standard_normal(1024), 1.0)
        true = found.tau**-0.5
        inside += np.count_nonzero((found.low <= true) & (true <= found.high))
        total += true.size
    assert 0.93 < inside / total < 0.97


def test_a_ramp_does_not_change_the_hadamard_deviation_and_changes_the_allan_deviation():
    y = np.random.default_rng(1).standard_normal(4096)
    ramp = 0.01 * np.arange(4096)
    for kind, same in (("ohdev", True), ("oadev", False)):
        plain, with_ramp = (deviations(one, 1.0, kind).value for one in (y, y + ramp))
        assert np.allclose(plain, with_ramp, rtol=1e-6) is same


def test_strides_past_1024_change_a_long_deviation_by_less_than_its_scatter():
    x = cumulative_sum(draw(MEMS, 2)[0])
    for m in (2048, 4096):
        full, count = sum_of_squared_differences(x, m, (1, -2, 1), 1)
        strided, few = variance(x, m, "oadev")
        assert few < count / 50
        assert strided == pytest.approx(full / (2 * count * m**2), rel=0.01)


@pytest.mark.parametrize(("spacing", "count"), [("octave", 10), ("decade", 9), ("all", 512)])
def test_averaging_factors_end_at_half_of_the_recording(spacing: str, count: int):
    found = averaging_factors(1024, spacing)  # type: ignore[arg-type]
    assert len(found) == count
    assert found[-1] <= 512


def test_an_unknown_deviation_and_a_factor_that_is_too_large_are_refused():
    y = np.arange(100.0)
    with pytest.raises(InputError, match="oadev"):
        deviations(y, 1.0, "variance")
    with pytest.raises(InputError, match="1 to 50"):
        deviations(y, 1.0, factors=[51])
