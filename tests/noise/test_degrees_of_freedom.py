"""Degrees of freedom at large averaging factors: a reduced sum against the whole one."""

import pytest

from inercal.noise import confidence


@pytest.mark.parametrize("kind", ["mdev", "oadev"])
@pytest.mark.parametrize("alpha", [2, 1, 0, -1, -2])
@pytest.mark.parametrize("m", [120, 200])
def test_a_reduced_sum_has_the_degrees_of_freedom_of_the_whole_one(
    monkeypatch: pytest.MonkeyPatch, kind: str, alpha: int, m: int
):
    reduced = confidence.degrees_of_freedom(kind, alpha, m, 4096)
    confidence._greenhall_riley.cache_clear()
    monkeypatch.setattr(confidence, "_J_MAX", 1 << 30)
    whole = confidence.degrees_of_freedom(kind, alpha, m, 4096)
    confidence._greenhall_riley.cache_clear()
    if (kind, alpha) == ("oadev", 1):  # by a formula that is cautious
        assert 0.8 * whole < reduced < 1.1 * whole
    else:
        assert reduced == pytest.approx(whole, rel=0.02)
