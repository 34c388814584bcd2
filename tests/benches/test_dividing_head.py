"""The dividing head: what acts on which position, and its slopes."""

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import (
    DividingHead,
    mounted_sensor,
    position_plan,
    sensed_motion,
)
from inercal.benches.dividing_head.passes import drift_ramps, missing_cardinal_angles, pass_numbers

BENCH = DividingHead(Measured(9.8, 1e-5), (1e-5, 1e-5), 1e-5, 5e-7, base=1e-5, pier=1e-7, lean=1e-4)


def test_x_is_level_then_up_then_level_then_down():
    f = sensed_motion(BENCH, position_plan(4), {}).f
    assert f / 9.8 == pytest.approx(
        np.array([[0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]], dtype=float), abs=1e-15
    )
    a, b = mounted_sensor().axes
    assert a.frame[2].tolist() == b.frame[2].tolist() == [0, 0, 1]


@pytest.mark.parametrize("collimated", ["pairs", "every", "none"])
def test_slopes_are_those_of_the_force(collimated: str):
    assert collimated in ("pairs", "every", "none")
    bench = DividingHead(
        Measured(9.8, 1e-5),
        (1e-5, 2e-5, 1e-6),
        1e-5,
        5e-7,
        collimated,
        certificate=1e-6,
        base=1e-5,
        pier=1e-7,
        creep=1e-6,
        lean=1e-4,
    )
    steps = position_plan(8, reverse=True)
    rng = np.random.default_rng(2)
    declared = bench.acting_parameters(steps)
    q = {n: np.array(p.value + 0.01 * rng.standard_normal()) for n, p in declared.items()}
    made = sensed_motion(bench, steps, q)
    assert set(made.df) == set(declared)
    for name in declared:
        near, far = (sensed_motion(bench, steps, q | {name: q[name] + h}).f for h in (-1e-5, 1e-5))
        assert made.df[name] == pytest.approx((far - near) / 2e-5, abs=1e-8)


def test_a_pair_shares_the_head_and_differs_by_the_trim():
    made = sensed_motion(BENCH, position_plan(12), {})
    turned = {name: np.hypot(*by[:, :2].T) / 9.8 for name, by in made.df.items()}
    assert np.flatnonzero(turned["division[f01]"]).tolist() == [0, 6]
    assert np.flatnonzero(turned["division[f04]"]).tolist() == [3, 9]
    assert np.flatnonzero(turned["trim[f07]"]).tolist() == [6]
    assert "division[f07]" not in made.df
    assert turned["cos1"][6] == pytest.approx(1)
    assert BENCH.acting_parameters(position_plan(12))["trim[f10]"].sd == pytest.approx(
        np.sqrt(2) * 5e-7
    )


def test_a_graduation_errs_alike_in_both_passes_and_each_pass_has_its_trim():
    declared = BENCH.acting_parameters(position_plan(12, reverse=True))
    assert sum(name.startswith("division") for name in declared) == 10
    assert [n for n in declared if n.startswith("trim")] == [
        "trim[f07]",
        "trim[f10]",
        "trim[r10]",
        "trim[r07]",
    ]


def test_a_level_on_the_base_tells_its_tilt():
    steps = position_plan(4)
    tilts = (1e-6, 3e-6, -2e-6, 0.0)
    told = [replace(s, level=tilt) for s, tilt in zip(steps, tilts, strict=True)]
    # Its zero is not the plumb line's: from its mean on.
    pier = {f"pier[{s.label}]": np.array(t - 0.5e-6) for s, t in zip(steps, tilts, strict=True)}
    assert sensed_motion(BENCH, told, {}).f == pytest.approx(
        sensed_motion(BENCH, steps, pier).f, abs=1e-14
    )


def test_what_the_autocollimator_reads_takes_the_heads_place():
    steps = [replace(s, reading=1e-6 * k) for k, s in enumerate(position_plan(4), start=1)]
    faces = (0.0, 5e-6, -3e-6, 2e-6, 7e-6, 0.0, 0.0, 0.0)  # read at 0°, 45°, 90°, …
    every = replace(BENCH, collimated="every", polygon=faces)
    assert angle(sensed_motion(every, steps, {}).f) == pytest.approx(
        np.array([-1.5e-6, -0.5e-6 - 3e-6, 0.5e-6 + 7e-6, 1.5e-6]), abs=1e-14
    )
    pairs = replace(BENCH, collimated="pairs", polygon=faces)
    assert angle(sensed_motion(pairs, steps, {}).f) == pytest.approx(
        np.array([0.0, 0.0, 2e-6 + 7e-6, 2e-6 + 3e-6]), abs=1e-14
    )
    assert np.array_equal(
        angle(sensed_motion(replace(BENCH, collimated="none"), steps, {}).f), np.zeros(4)
    )


@pytest.mark.parametrize("collimated", ["pairs", "every"])
def test_how_angles_of_collimated_positions_were_rounded_does_not_count(collimated: str):
    assert collimated in ("pairs", "every")
    steps = position_plan(4, reverse=True)
    rounded = [replace(s, angle=round(s.angle, 4)) for s in steps]
    bench = replace(BENCH, collimated=collimated)
    made, exact = (sensed_motion(bench, some, {}) for some in (rounded, steps))
    assert made.df.keys() == exact.df.keys()
    off = np.abs(made.f - exact.f).max(axis=-1) / 9.8
    trimmed = [2, 5] if collimated == "pairs" else range(8)
    assert off[trimmed].max() < 1e-15
    plain = sensed_motion(replace(BENCH, collimated="none"), rounded, {})
    assert plain.df.keys() == sensed_motion(replace(BENCH, collimated="none"), steps, {}).df.keys()


def test_a_face_is_looked_for_where_the_autocollimator_is_read_alone():
    four = replace(BENCH, polygon=(0.0,) * 4)
    assert sensed_motion(four, position_plan(12), {}).f.shape == (12, 3)
    with refused(key="polygon", names=("f02",)):
        sensed_motion(replace(four, collimated="every"), position_plan(12), {})


def test_orders_of_visit():
    turn = list(position_plan(12))
    back = list(position_plan(12, reverse=True))[12:]
    closing = replace(turn[0], label="end", angle=2 * pi)
    assert pass_numbers([*turn, closing]) == [0] * 13
    assert pass_numbers([*turn, closing, *back]) == [0] * 12 + [1] * 13
    again = replace(turn[6], label="again")
    assert pass_numbers([*turn, again]) == [0] * 13
    shuffled = [turn[k] for k in np.random.default_rng(1).permutation(12)]
    assert pass_numbers([*shuffled, *back]) == [0] * 12 + [1] * 12
    couples = [turn[k] for pair in zip(range(6), range(6, 12), strict=True) for k in pair]
    assert pass_numbers(couples) == [0] * 12
    assert missing_cardinal_angles([*turn[:6], *turn[7:], *back]) == {"pass 1": [pytest.approx(pi)]}
    assert missing_cardinal_angles([*turn[:6], *turn[7:], again, *back]) == {}


def angle(f: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much the head stood beyond 0°, 90°, 180°, 270°."""
    away = np.arctan2(f[:, 0], f[:, 1]) - pi / 2 * np.arange(4)
    return np.asarray((away + pi) % (2 * pi) - pi, dtype=np.float64)


def test_a_face_errs_alike_in_both_passes_and_in_both_members_of_a_pair():
    bench = replace(BENCH, certificate=5e-7)
    forth = position_plan(4, reverse=True)
    made = sensed_motion(replace(bench, collimated="every"), forth, {})
    weights = {
        name: np.round((by[:, :2] * [[0, -1]] + by[:, :2] * [[1, 0]]).sum(-1) / 9.8, 9)
        for name, by in made.df.items()
    }
    assert np.flatnonzero(weights["polygon[f02]"]).tolist() == [1, 6]
    assert "division[f01]" not in made.df
    pairs = sensed_motion(bench, forth, {})
    turned = {name: np.hypot(*by[:, :2].T) / 9.8 for name, by in pairs.df.items()}
    assert np.flatnonzero(turned["polygon[f01]"]).tolist() == [2, 5]
    assert np.array_equal(pairs.df["polygon[f01]"], -pairs.df["polygon[f03]"])


def test_drifts_go_on_from_pass_to_pass_about_the_mean():
    made = drift_ramps(position_plan(4, reverse=True))
    assert made.shape == (2, 8)
    assert made.sum(axis=1) == pytest.approx(0, abs=1e-15)
    assert np.diff(made, axis=1)[:, 2] == pytest.approx([0.25, 0])
    assert np.diff(made, axis=1)[:, 3] == pytest.approx([0.25, 0])
    assert np.diff(made, axis=1)[:, 4] == pytest.approx([0, 0.25])
    assert pass_numbers(
        [*position_plan(3), *position_plan(3), *position_plan(3, reverse=True)]
    ) == ([0] * 3 + [1] * 3 + [2] * 3 + [3] * 3)
    declared = replace(BENCH, drift=1e-5).acting_parameters(
        position_plan(4, reverse=True), ("a", "b")
    )
    assert [name for name in declared if name.startswith("drift")] == [
        "drift_a[pass 1]",
        "drift_a[pass 2]",
        "drift_b[pass 1]",
        "drift_b[pass 2]",
    ]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"gravity": Measured(0.0, 0.0)}, "gravity"),
        ({"gravity": Measured(9.8, -1.0)}, "gravity"),
        ({"division": -1.0}, "division"),
        ({"harmonics": (0.0, float("nan"))}, "harmonic 2"),
        ({"drift": float("inf")}, "drift"),
        ({"polygon": (0.0, float("nan"))}, "polygon"),
    ],
)
def test_a_bench_that_cannot_be_is_refused(change: dict[str, Any], key: str):
    with refused(key=key):
        replace(BENCH, **change)


def test_a_polygon_of_other_faces_is_refused():
    bench = replace(BENCH, collimated="every", polygon=(0.0,) * 8)
    with refused(key="polygon", names=("f02",)):
        sensed_motion(bench, position_plan(12), {})


def test_words_and_refusals():
    forward, *_, last = position_plan(12, reverse=True)
    assert forward.describe() == "head at 0°, forward"
    assert last.describe() == "head at 0°, reverse"
    assert position_plan(12)[1].angle == pytest.approx(pi / 6)
    with refused(key="n"):
        position_plan(0)
    with refused(key="axes"):
        mounted_sensor(axes=("a", "b", "c"))
    with refused(key="reading", names=(forward.label,)):
        replace(forward, reading=float("nan"))


def test_a_simulation_draws_gravity_by_what_was_stated_and_an_estimator_adds_the_lean():
    steps = position_plan(12)
    drawn, estimated = BENCH.simulated_parameters(steps)["g"], BENCH.acting_parameters(steps)["g"]
    assert drawn.sd == BENCH.gravity.sd
    # The lean, normal with sd s, lowers the force by g λ²/2: mean square 3/4 (g s²)².
    lowered = 9.8 * (1 - np.cos(1e-4 * np.random.default_rng(1).standard_normal(100_000)))
    assert estimated.sd**2 - drawn.sd**2 == pytest.approx(np.mean(lowered**2), rel=0.05)
