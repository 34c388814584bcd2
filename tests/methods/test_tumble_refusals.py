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
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.estimation import Gaussian
from inercal.methods.tumble import METHOD, fourier, least_squares
from inercal.methods.tumble_harmonics import folded_harmonics
from inercal.physics.plan import Index
from inercal.physics.sensors import single, triad


@pytest.mark.parametrize(
    ("n", "start", "named"),
    [
        (4, 0.0, {"k1", "k3", "kip"}),
        (4, pi / 4, {"k0", "k1", "k2", "k3"}),
        (5, 0.0, {"k1", "k3", "kip"}),
        (6, 0.0, {"k1", "k3"}),
    ],
)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_coefficients_whose_harmonics_fold_are_named(
    estimator: Estimator, n: int, start: float, named: set[str]
):
    with pytest.raises(NotObserved) as refusal:
        run(estimator, positions(n, start), sensor())
    assert {name[2:] for name in refusal.value.names} == named
    assert refusal.value.directions
    assert all(
        words in str(refusal.value) for words in folded_harmonics(angles(positions(n, start)))
    )


@pytest.mark.parametrize(
    ("n", "start", "folded"),
    [
        (4, 0.0, [(2, "sine"), (3, "harmonic 1")]),
        (4, pi / 4, [(2, "cosine"), (3, "harmonic 1")]),
        (5, 0.0, [(3, "harmonic 2")]),
        (6, 0.0, [(3, "sine")]),
        (7, 0.0, []),
    ],
)
def test_harmonics_fold_onto_n_less_their_number_or_lose_a_phase(
    n: int, start: float, folded: list[tuple[int, str]]
):
    words = folded_harmonics(angles(positions(n, start)))
    assert len(words) == len(folded)
    for text, (harmonic, onto) in zip(words, folded, strict=True):
        assert text.startswith(f"harmonic {harmonic} ")
        assert onto in text


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
        (("k0", "k2", "kpp"), ("i.k0", "i.k2", "i.kpp")),
        (("k0", "koo"), ("i.koo",)),
        (("delta_p",), ("i.delta_p",)),
    ],
)
def test_what_no_tumble_sees_is_named(terms: tuple[str, ...], named: tuple[str, ...]):
    with refused(NotObserved, names=named):
        run(least_squares, positions(12), sensor("k1", *terms))


def test_uneven_positions_are_refused_where_formulas_need_even_ones():
    plan = positions(12)
    gone = [p for p in plan if p.label != "p3"]
    for some in (gone, [*plan, Index("again", 2 * pi)]):
        with refused(key="steps"):
            run(fourier, some, sensor())
        assert np.abs(error(run(least_squares, some, sensor()), sensor())).max() < 1e-12


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_what_cannot_be_used_is_refused(estimator: Estimator):
    plan = positions(12)
    for some in (plan[:3], (*plan[:3], Index("p0_again", 0.0))):
        with refused(key="steps", names=()):
            run(estimator, some, sensor())
    for made in (triad().with_coefficients("k0"), single(measures="w").with_coefficients("bias")):
        with refused(key="[sensor]", names=made.channels):
            run(estimator, plan, made)
    with refused(key="observations", names=("j",)):
        estimator(replace(seen(plan, np.zeros(12)), channels=("j",)), sensor(), EXACT, plan)
    with refused(key="[method]"):
        run(estimator, plan, single())
    with refused(key="steps", names=("p0",)):
        run(estimator, (*plan, plan[0]), sensor())
    with refused(key="observations", names=("p0",)):
        estimator(seen(plan, DEVICE.reading(angles(plan)), 0.0), sensor(), EXACT, plan)
    for steps, names in (
        (plan[:11], ("p11",)),
        ((*plan, Index("more", 0.0)), ("more",)),
        ((plan[1], plan[0], *plan[2:]), ("p0", "p1")),
    ):
        with refused(key="steps", names=names):
            estimator(seen(plan, np.zeros(12)), sensor(), EXACT, steps)


def test_formulas_refuse_what_they_do_not_hold():
    plan, made = positions(12), sensor()
    turned = replace(mounted_sensor().axes[1], name="i")
    across = replace(mounted_sensor(), axes=(turned,), form="reference")
    across = across.with_coefficients("k0")
    with refused(key="[method] estimator", names=across.channels):
        run(fourier, plan, across)
    reading = DEVICE.reading(angles(plan), G)
    prior = Gaussian.independent(("i.k3",), [0.0], 1e-9)
    with refused(key="priors", names=("i.k3",)):
        fourier(seen(plan, reading), made, EXACT, plan, [prior])
    with refused(key="observations"):
        fourier(seen(plan, np.stack([reading, reading])), made, EXACT, plan)
    with refused(key="[sensor] form"):
        fourier(seen(plan, reading), replace(made, form="tilted"), EXACT, plan)
    with refused(key="[method]", names=("i.koq",)):
        fourier(seen(plan, reading), sensor("k0", "koq"), EXACT, plan)


def test_plans_and_positions_that_cannot_be_are_refused():
    with refused(key="positions"):
        METHOD.plan(positions=3)
    with pytest.raises(InputError):
        Index("p0", float("inf"))
    with pytest.raises(InputError):
        replace(EXACT, gravity=Measured(0.0, 0.0))
    with pytest.raises(InputError):
        replace(EXACT, pier=-1.0)
    with pytest.raises(InputError):
        replace(EXACT, harmonics=(0.0, float("nan")))


def test_a_plan_says_what_to_do_forth_and_back():
    assert METHOD.plan(positions=4)[1].describe() == "head at 90°, forward"
    assert [p.label for p in METHOD.plan(positions=4)][-2:] == ["r02", "r01"]
