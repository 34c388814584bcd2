"""What the tumble test refuses: harmonics that fold, what it does not see, what cannot be used."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from tests.methods.tumble_cases import (
    DEVICE,
    ESTIMATORS,
    EXACT,
    Estimator,
    G,
    angles,
    error,
    positions,
    run,
    seen,
    sensor,
)

from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.errors import InputError, NotObserved
from inercal.estimate import Gaussian
from inercal.methods.tumble import METHOD, fourier, least_squares
from inercal.plan import Index
from inercal.sensors import single, triad
from inercal.units import Measured


@pytest.mark.parametrize(
    ("n", "start", "named", "folded"),
    [
        (4, 0.0, {"k1", "k3", "kip"}, "harmonic 3 folds onto harmonic 1"),
        (4, 0.0, {"k1", "k3", "kip"}, "harmonic 2 folds onto itself: its sine is not seen"),
        (4, pi / 4, {"k0", "k1", "k2", "k3"}, "itself: its cosine is not seen"),
        (5, 0.0, {"k1", "k3", "kip"}, "harmonic 3 folds onto harmonic 2"),
        (6, 0.0, {"k1", "k3"}, "harmonic 3 folds onto itself: its sine is not seen"),
    ],
)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_harmonics_that_fold_are_named(
    estimator: Estimator, n: int, start: float, named: set[str], folded: str
):
    with pytest.raises(NotObserved) as refusal:
        run(estimator, positions(n, start), sensor())
    text = str(refusal.value)
    assert folded in text
    listed = text.split("not observed: ")[1].split(" (")[0].split(", ")
    assert {name[2:] for name in listed} == named
    assert refusal.value.directions


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_six_positions_that_include_no_level_one_see_the_third_harmonic(estimator: Estimator):
    made = sensor()
    assert np.abs(error(run(estimator, positions(6, pi / 6), made), made)).max() < 1e-12


def test_a_prior_tells_what_folds_apart():
    made, plan = sensor(), positions(4)
    size = dict(zip(made.coefficients, made.unit_scale, strict=True))
    known = [
        Gaussian.independent((f"i.{name}",), [getattr(DEVICE, name) * size[f"i.{name}"]], sd)
        for name, sd in (("k3", 1e-7 * size["i.k3"]), ("kip", 1e-6 * size["i.kip"]))
    ]
    reading = DEVICE.reading(angles(plan), G)
    found = least_squares(seen(plan, reading), made, EXACT, plan, known)
    assert np.abs(error(found, made)).max() < 1e-12


@pytest.mark.parametrize(
    ("terms", "named"),
    [
        (("k0", "k2", "kpp"), "i.k0, i.k2, i.kpp"),
        (("k0", "koo"), "i.koo"),
        (("delta_p",), "i.delta_p"),
    ],
)
def test_what_no_tumble_sees_is_named(terms: tuple[str, ...], named: str):
    with pytest.raises(NotObserved, match=f"not observed: {named} \\("):
        run(least_squares, positions(12), sensor("k1", *terms))


def test_uneven_positions_are_refused_where_formulas_need_even_ones():
    plan = positions(12)
    gone = [p for p in plan if p.label != "p3"]
    for some, words in (
        (gone, "after 60° the next is 60° away, where 11 positions would be 32.7273° apart"),
        ([*plan, Index("again", 2 * pi)], "0° was visited 2 times, 30° 1 times"),
    ):
        with pytest.raises(InputError, match=words):
            run(fourier, some, sensor())
        assert np.abs(error(run(least_squares, some, sensor()), sensor())).max() < 1e-12


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_what_cannot_be_used_is_refused_in_one_line(estimator: Estimator):
    plan = positions(12)
    for some in (plan[:3], (*plan[:3], Index("p0_again", 0.0))):
        with pytest.raises(InputError, match="3 different positions; a tumble test needs 4"):
            run(estimator, some, sensor())
    for made in (triad().with_coefficients("k0"), single(measures="w").with_coefficients("bias")):
        with pytest.raises(InputError, match="takes one accelerometer"):
            run(estimator, plan, made)
    with pytest.raises(InputError, match="readings are of j, the sensor has i"):
        estimator(replace(seen(plan, np.zeros(12)), channels=("j",)), sensor(), EXACT, plan)
    with pytest.raises(InputError, match="has no coefficients to find"):
        run(estimator, plan, single())
    with pytest.raises(InputError, match="two steps have one label"):
        run(estimator, (*plan, plan[0]), sensor())
    across = replace(mounted_sensor(), axes=mounted_sensor().axes[1:]).with_coefficients("k0")
    with pytest.raises(InputError, match="on the head they are x and y"):
        run(estimator, plan, across)
    with pytest.raises(InputError, match="a reading is stated without noise"):
        estimator(seen(plan, DEVICE.reading(angles(plan)), 0.0), sensor(), EXACT, plan)
    for steps, words in (
        (plan[:11], "row p11 has step None"),
        ((*plan, Index("more", 0.0)), "row None has step more"),
        ((plan[1], plan[0], *plan[2:]), "row p0 has step p1; give the step of each row, in order"),
    ):
        with pytest.raises(InputError, match=words):
            estimator(seen(plan, np.zeros(12)), sensor(), EXACT, steps)


def test_formulas_refuse_what_they_do_not_hold():
    plan, made = positions(12), sensor()
    reading = DEVICE.reading(angles(plan), G)
    prior = Gaussian.independent(("i.k3",), [0.0], 1e-9)
    with pytest.raises(InputError, match="takes no priors"):
        fourier(seen(plan, reading), made, EXACT, plan, [prior])
    with pytest.raises(InputError, match="one recording at a time"):
        fourier(seen(plan, np.stack([reading, reading])), made, EXACT, plan)
    with pytest.raises(InputError, match="finds the reference form"):
        fourier(seen(plan, reading), replace(made, form="tilted"), EXACT, plan)
    with pytest.raises(InputError, match="not koq"):
        fourier(seen(plan, reading), sensor("k0", "koq"), EXACT, plan)


def test_plans_and_positions_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="3 positions; a tumble needs 4 or more"):
        METHOD.plan(positions=3)
    with pytest.raises(InputError, match="position p0: its angle is inf"):
        Index("p0", float("inf"))
    with pytest.raises(InputError, match="gravity is 0"):
        replace(EXACT, gravity=Measured(0.0, 0.0))
    with pytest.raises(InputError, match="deviation of pier is -1"):
        replace(EXACT, pier=-1.0)
    with pytest.raises(InputError, match="deviation of harmonic 2 is nan"):
        replace(EXACT, harmonics=(0.0, float("nan")))


def test_a_plan_says_what_to_do_forth_and_back():
    assert METHOD.plan(positions=4)[1].describe() == "head at 90°, forward"
    assert [p.label for p in METHOD.plan(positions=4)][-2:] == ["r02", "r01"]
