"""The tumble test on an accelerometer and a dividing head simulated without inercal."""

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest
from tests.accuracy.tumble import Device, Scale, amplitudes
from tests.methods.tumble_cases import (
    ARCSEC,
    DEVICE,
    ESTIMATORS,
    EXACT,
    NOISE,
    SIX,
    Array,
    Estimator,
    G,
    angles,
    error,
    in_g,
    positions,
    run,
    seen,
    sensor,
    spread,
)
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.methods.tumble import METHOD, fourier, least_squares
from inercal.physics.plan import Index
from inercal.physics.sensors import G0, single

# Exactness


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("n", [7, 8, 9, 12, 24])
@pytest.mark.parametrize("start", [0.0, 0.3, -2.0])
def test_without_noise_all_six_are_exact(estimator: Estimator, n: int, start: float):
    made = sensor()
    found = run(estimator, positions(n, start), made)
    assert np.abs(error(found, made)).max() < 1e-12
    assert found.notes == ()


def test_formulas_and_least_squares_are_the_same_where_angles_are_exact():
    made, plan = sensor(), positions(9, 0.2, back=True)
    rng = np.random.default_rng(4)
    reading = DEVICE.reading(angles(plan), G) + NOISE * rng.standard_normal(18)
    one, other = (e(seen(plan, reading), made, EXACT, plan) for e in ESTIMATORS)
    assert np.abs(error(one, made) - error(other, made)).max() < 1e-14
    assert spread(one, made) == pytest.approx(spread(other, made), rel=1e-6, abs=1e-20)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("collimated", ["none", "every", "pairs"])
def test_what_is_known_beyond_even_angles_is_taken_out(estimator: Estimator, collimated: str):
    """By level, autocollimator and certificate; in pairs 180° and 270° follow 0° and 90°."""
    assert collimated in ("none", "every", "pairs")
    rng = np.random.default_rng(8)
    made, faces = sensor(), 30 * ARCSEC * rng.standard_normal(12)
    level, reading = 60 * ARCSEC * rng.standard_normal((2, 12))
    # Of a level, and of readings at every position, the mean is their own zero.
    level, reading = level - level.mean(), reading - reading.mean()
    plan = [
        replace(step, level=level[k], reading=reading[k]) for k, step in enumerate(positions(12))
    ]
    beyond = {"none": np.zeros(12), "every": reading + faces, "pairs": np.zeros(12)}[collimated]
    if collimated == "pairs":
        for k in (6, 9):
            beyond[k] = (reading + faces)[k] - (reading + faces)[k - 6]
    bench = replace(EXACT, collimated=collimated, polygon=tuple(faces))
    observed = seen(plan, DEVICE.reading(angles(plan) + level + beyond, G))
    assert np.abs(error(estimator(observed, made, bench, plan), made)).max() < 1e-12
    plain = estimator(observed, made, EXACT, positions(12))
    assert np.abs(error(plain, made)).max() > 1e-5


def test_formulas_move_no_reading_far():
    far = [replace(step, level=0.02 * (k == 3)) for k, step in enumerate(positions(12))]
    with refused(names=("p3",)):
        run(fourier, far, sensor())
    near = [replace(step, level=0.009 * (-1) ** k) for k, step in enumerate(positions(12))]
    true = angles(near) + [step.level for step in near]
    found = fourier(seen(near, DEVICE.reading(true, G)), sensor(), EXACT, near)
    assert np.abs(error(found, sensor())).max() < 1e-12


def test_the_method_takes_an_axis_of_any_name():
    plan = METHOD.plan(positions=12, reverse=True)
    observed = seen(plan, DEVICE.reading(angles(plan), G))
    for made in (single(), mounted_sensor(axes=("a",))):
        wanted = METHOD.prepare(replace(made, form="reference"))
        assert [name[2:] for name in wanted.coefficients] == [
            "k0",
            "k1",
            "delta_o",
            "k2",
            "k3",
            "kip",
        ]
        for name in METHOD.estimators:
            given = replace(observed, channels=made.channels)
            found = METHOD.estimator(name)(given, wanted, EXACT, plan)
            assert np.abs(error(found, wanted)).max() < 1e-12


def test_positions_anywhere_do_for_least_squares():
    plan = [Index(f"p{k}", radians(a)) for k, a in enumerate((0, 20, 70, 110, 200, 230, 300))]
    made = sensor()
    assert np.abs(error(run(least_squares, plan, made), made)).max() < 1e-12


def test_a_turned_case_is_exact_in_the_tilted_form_and_off_by_half_its_square_in_the_reference():
    device = replace(DEVICE, delta=300 * ARCSEC, kip=0.0, turned=True)
    terms = ("k0", "k1", "delta_o", "k2", "k3")
    tilted = replace(sensor(*terms), form="tilted")
    found = run(least_squares, positions(12), tilted, device)
    assert np.abs(error(found, tilted, device)).max() < 1e-12
    for estimator in ESTIMATORS:
        made = sensor(*terms)
        errors = error(run(estimator, positions(12), made, device), made, device)
        off = dict(zip(terms, errors, strict=True))
        print(estimator.__name__, off)
        size = device.delta**2
        assert off["k1"] == pytest.approx(-size / 2, rel=0.02)
        assert off["delta_o"] == pytest.approx(device.k1 * device.delta, rel=0.05)
        # Products of three small numbers are left.
        assert max(abs(off[name]) for name in ("k0", "k2", "k3")) < 5e-11


def test_kip_of_a_turned_case_reaches_others_by_its_product_with_the_angle():
    device = replace(DEVICE, turned=True)
    made = replace(sensor(), form="tilted")
    off = error(run(least_squares, positions(12), made, device), made, device)
    assert 1e-10 < np.abs(off).max() < 1.2 * device.kip * device.delta


# What one tumble sees


def test_harmonics_hold_the_combinations_that_the_docstring_states():
    d = DEVICE
    sine, cosine = amplitudes(d.reading(2 * pi * np.arange(16) / 16), 4)
    assert cosine[0] == pytest.approx(d.k0 + d.k2 / 2, abs=1e-15)
    assert sine[1] == pytest.approx(1 + d.k1 + 0.75 * d.k3, abs=1e-15)
    assert cosine[1] == pytest.approx(d.delta, abs=1e-15)
    assert (sine[2], cosine[2]) == pytest.approx((d.kip / 2, -d.k2 / 2), abs=1e-15)
    assert (sine[3], cosine[3]) == pytest.approx((-d.k3 / 4, 0), abs=1e-15)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_what_is_left_out_goes_where_the_docstring_says(estimator: Estimator):
    d, plan = DEVICE, positions(12)
    full = dict(zip(SIX, list(vars(d).values())[:6], strict=True))

    def without(term: str) -> dict[str, Array]:
        made = sensor(*(name for name in SIX if name != term))
        found = in_g(run(estimator, plan, made), made)
        return {n: v - full[n] for n, v in found.items() if abs(v - full[n]) > 1e-12}

    assert without("kip") == {}
    assert without("k2") == {"k0": pytest.approx(d.k2 * G**2 / 2, abs=1e-12)}
    assert without("k3") == {"k1": pytest.approx(0.75 * d.k3 * G**2, abs=1e-12)}


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_four_cardinal_positions_see_k1_and_k3_as_one(estimator: Estimator):
    made = sensor("k0", "k1", "delta_o", "k2")
    found = run(estimator, positions(4), made)
    value = in_g(found, made)
    assert value["k1"] == pytest.approx(DEVICE.k1 + DEVICE.k3 * G**2, abs=1e-12)
    assert value["k0"] == pytest.approx(DEVICE.k0, abs=1e-12)
    assert value["k2"] == pytest.approx(DEVICE.k2, abs=1e-12)
    assert "harmonic 3 folds onto harmonic 1" in found.notes[0]


# Columns: harmonic, sine or cosine, what it does to which coefficient (in g) per radian
HEAD_ERRORS = [
    (0, "cos", {"delta_o": 1.0}),
    (1, "sin", {"kip": 1.0}),
    (1, "cos", {"k0": 1.0, "k2": -1.0}),
    (2, "sin", {"k1": 2.0, "k3": -2.0}),
    (2, "cos", {"delta_o": 0.5}),
    (3, "sin", {"kip": 1.0}),
    (3, "cos", {"k0": 0.5, "k2": -1.0}),
    (4, "sin", {"k1": 1.5, "k3": -2.0}),
    (4, "cos", {}),
    (5, "sin", {}),
    (6, "cos", {}),
]


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(("h", "phase", "does"), HEAD_ERRORS)
def test_harmonics_of_the_head_do_what_the_docstring_says(
    estimator: Estimator, h: int, phase: str, does: dict[str, float]
):
    size = 1e-6
    head = Scale(**{phase: {h: size}})
    made, plan = sensor(), positions(12)
    reading = Device().reading(head.true(angles(plan)))
    found = estimator(seen(plan, reading), made, replace(EXACT, gravity=Measured(G0, 0.0)), plan)
    expected = np.array([does.get(name[2:], 0.0) * size for name in made.coefficients])
    assert error(found, made, Device()) == pytest.approx(expected, abs=5e-12)  # 2nd order: 1e-12
    if estimator is least_squares:
        shows = np.abs(found.residual).max() / G0 > 1e-10
        assert shows == ((h, phase) == (2, "cos") or h > 2)


def test_a_head_error_of_high_order_folds_onto_a_low_one():
    """By 12 positions the eleventh harmonic of the head is its first."""
    made, plan = sensor(), positions(12)
    folded = run(fourier, plan, made, head=Scale(cos={11: 1e-6}))
    first = run(fourier, plan, made, head=Scale(cos={1: 1e-6}))
    assert error(folded, made) == pytest.approx(error(first, made), abs=1e-15)
