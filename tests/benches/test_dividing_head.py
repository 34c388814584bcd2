"""The dividing head: what acts on which position, and its slopes."""

from math import pi

import numpy as np
import pytest

from inercal.benches.dividing_head import DividingHead, felt, mounted, positions
from inercal.errors import InputError
from inercal.units import Measured

BENCH = DividingHead(Measured(9.8, 1e-5), (1e-5, 1e-5), 1e-5, 5e-7, base=1e-5, pier=1e-7, lean=1e-4)


def test_x_is_level_then_up_then_level_then_down():
    f = felt(BENCH, positions(4), {}).f
    assert f / 9.8 == pytest.approx(
        np.array([[0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]], dtype=float), abs=1e-15
    )
    a, b = mounted().axes
    assert a.frame[2].tolist() == b.frame[2].tolist() == [0, 0, 1]


@pytest.mark.parametrize("collimated", ["pairs", "every", "none"])
def test_slopes_are_those_of_the_force(collimated: str):
    assert collimated in ("pairs", "every", "none")
    bench = DividingHead(
        Measured(9.8, 1e-5), (1e-5, 2e-5), 1e-5, 5e-7, collimated, 1e-5, 1e-7, 1e-4
    )
    steps = positions(8, reverse=True)
    rng = np.random.default_rng(2)
    declared = bench.nuisances(steps)
    q = {n: np.array(p.value + 0.01 * rng.standard_normal()) for n, p in declared.items()}
    made = felt(bench, steps, q)
    assert set(made.by) == set(declared)
    for name in declared:
        near, far = (felt(bench, steps, q | {name: q[name] + h}).f for h in (-1e-5, 1e-5))
        assert made.by[name] == pytest.approx((far - near) / 2e-5, abs=1e-8)


def test_a_pair_shares_the_head_and_differs_by_the_trim():
    made = felt(BENCH, positions(12), {})
    turned = {name: np.hypot(*by[:, :2].T) / 9.8 for name, by in made.by.items()}
    assert np.flatnonzero(turned["division[f01]"]).tolist() == [0, 6]
    assert np.flatnonzero(turned["division[f04]"]).tolist() == [3, 9]
    assert np.flatnonzero(turned["trim[f07]"]).tolist() == [6]
    assert "division[f07]" not in made.by
    assert turned["cos1"][6] == pytest.approx(1)
    assert BENCH.nuisances(positions(12))["trim[f10]"].sd == pytest.approx(np.sqrt(2) * 5e-7)


def test_a_graduation_errs_alike_in_both_passes_and_each_pass_has_its_trim():
    declared = BENCH.nuisances(positions(12, reverse=True))
    assert sum(name.startswith("division") for name in declared) == 10
    assert [n for n in declared if n.startswith("trim")] == [
        "trim[f07]",
        "trim[f10]",
        "trim[r10]",
        "trim[r07]",
    ]


def test_a_level_on_the_base_tells_its_tilt():
    steps = positions(4)
    told = tuple(type(s)(s.label, s.angle, s.sense, 1e-6) for s in steps)
    pier = {f"pier[{s.label}]": np.array(1e-6) for s in steps}
    assert np.array_equal(felt(BENCH, told, {}).f, felt(BENCH, steps, pier).f)


def test_words_and_refusals():
    forward, *_, last = positions(12, reverse=True)
    assert forward.in_words() == "head at 0°, forward"
    assert last.in_words() == "head at 0°, reverse"
    assert positions(12)[1].angle == pytest.approx(pi / 6)
    with pytest.raises(InputError, match="0 positions"):
        positions(0)
