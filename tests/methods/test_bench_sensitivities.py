"""Estimates change with an error of the bench by their stated sensitivities.

Of a value that is stated, such as gravity, the statement is shifted and the same data calibrated
anew: the coefficients move by J times the shift. Of an error that is stated as none ± u, such as a
rate, the data are made with the error: the coefficients move by −J times it.
"""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import evidence
from tests.methods.bench_sensitivity_cases import BENCHES, STATED, Case, case

from inercal.benches import Bench, DividingHead
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.physics.sensors import G0

TABLE = ("g", "lean_x", "azimuth", "square_1", "square_2", "cos1[inner]")
ARM = ("g", "radius", "stretch", "rate", "tilt", "latitude")
ERRORS = {
    ("six_position", "ml"): ("g",),
    ("ferraris", "ml"): ("g", "earth_up", "timebase"),
    ("multi_position", "joint"): ("g",),
    ("multi_position", "sequential"): ("g",),
    ("centrifuge_norm", "ml"): ARM,
    ("ship_planar", "planar"): ("g", "radius", "rate"),
    ("ship_multi_angle", "joint"): ("g", "radius", "rate"),
    ("ship_multi_angle", "planar"): ("g", "radius", "rate"),
    ("ship_multi_angle", "planar_norm"): ("g", "radius", "rate"),
    ("ship_multi_angle", "damped"): ("g", "radius", "rate"),
    ("dual_orthogonal", "joint"): ("g", "base"),
    ("dual_orthogonal", "patent"): ("g", "base"),
    ("dual_orthogonal", "dual"): ("g", "base"),
    ("dual_orthogonal", "single"): ("g", "base"),
    ("tumble", "least_squares"): ("g", "base"),
    ("tumble", "fourier"): ("g", "base"),
    ("rates_and_poses", "ml"): ("g", "rate_scale", "rate_asymmetry"),
    ("turntable_discrete", "least_squares"): TABLE,
    ("turntable_kalman", "full"): TABLE,
    ("turntable_kalman", "drift"): ("g", "lean_x", "lean_y", "azimuth"),
    ("turntable_kalman", "paper"): ("g",),
    ("turntable_trajectory", "trajectory"): TABLE,
}
# In u of the coefficient, for an error of u. Norms have a second order; closed formulas
# evaluate the bench at the nominal sensor; filters neglect how a hold begins.
NEAR = {
    "damped": 3e-3,
    "global": 3e-3,
    "patent": 0.03,
    "single": 0.03,
    "trajectory": 1e-3,
    "full": 0.01,
    "drift": 0.01,
    "paper": 1e-3,
}
# A filter that reaches a hold before it knows the misalignments leaves their product with the lean
# of the table in the readings. It changes its sign with the coefficients, and the sensitivity does
# not: the mean over a sensor and its mirror image is free of it.
MIRRORED = ("full",)
EXACT = 1e-4  # differences of fits that end within their tolerance
# Their covariance is that of the readings alone: the bench is taken as certain.
CERTAIN = [
    ("six_position", "classical"),
    ("ferraris", "classical"),
    ("rates_and_poses", "ieee"),
    *(("centrifuge_norm", name) for name in ("series", "series_weighted", "paper")),
]
HEADS = {
    "none": DividingHead(BENCHES[2].gravity, (1e-5, 1e-5, 1e-5), 1e-6, collimated="none", base=5e-5)
}


def moved(given: Case, name: str, bench: Bench) -> NDArray[np.float64]:
    """Return how the coefficients move with what is stated of one error, (p,)."""
    one = moved_of_sensor(given, name, bench)
    if given.estimator not in MIRRORED:
        return one
    return (one + moved_of_sensor(given._replace(truth=-given.truth), name, bench)) / 2


def moved_of_sensor(given: Case, name: str, bench: Bench) -> NDArray[np.float64]:
    """Return how the coefficients of one sensor move, (p,)."""
    q = bench.nuisances(given.steps, given.sensor)[name]
    h, found = 0.3 * q.sd, list[NDArray[np.float64]]()
    for sign in (1, -1):
        if name in STATED:
            value = getattr(bench, STATED[name])
            shifted = replace(value, value=value.value + sign * h)
            other = replace(bench, **{STATED[name]: shifted})
            found.append(given.found(bench=other).value)
        else:
            found.append(-given.found({name: q.value + sign * h}).value)
    return (found[0] - found[1])[: len(given.truth)] / (2 * h)


one_case = cache(case)


@cache
def case_and_estimate(method: str, estimator: str, head: str = "") -> tuple[Case, Estimate]:
    """Return a case, on a head of `HEADS` if that is named, and the estimate as stated."""
    given = one_case(method, estimator)
    given = given._replace(bench=HEADS[head]) if head else given
    return given, given.found()


def require_alike(given: Case, estimate: Estimate, name: str) -> None:
    p = len(given.truth)
    q = given.bench.nuisances(given.steps, given.sensor)[name]
    by = estimate.sensitivity(name, q.sd)
    assert by is not None
    expected = moved(given, name, given.bench) * q.sd
    u = np.sqrt(np.diagonal(estimate.covariance))[:p]
    off = np.abs(by[:p] * q.sd - expected)
    # No shared error contributes more than the uncertainty of the coefficient.
    assert (np.abs(by[:p]) * q.sd <= u * (1 + 1e-6)).all()
    assert (off <= NEAR.get(given.estimator, EXACT) * u + 1e-3 * np.abs(expected) + 1e-15).all()


QUICK = {"full": ("g",), "trajectory": ("g",)}  # the others take seconds each
CASES = [
    pytest.param(*key, name, marks=pytest.mark.slow)
    if name not in QUICK.get(key[1], names)
    else (*key, name)
    for key, names in ERRORS.items()
    for name in names
]


@pytest.mark.parametrize(("method", "estimator", "name"), CASES)
def test_coefficients_move_with_an_error_of_the_bench_as_is_said(
    method: str, estimator: str, name: str
):
    require_alike(*case_and_estimate(method, estimator), name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lean_x", "square_1"])
def test_a_filter_neglects_no_more_than_products_of_misalignments_and_the_table(name: str):
    given, estimate = case_and_estimate("turntable_kalman", "full")
    q = given.bench.nuisances(given.steps, given.sensor)[name]
    mirrored = given._replace(truth=-given.truth)
    one, other = (moved_of_sensor(each, name, given.bench) for each in (given, mirrored))
    names = given.sensor.coefficients
    neglected = np.abs(one - other)[[n.endswith(".k0") for n in names]] / 2
    angles = [t for n, t in zip(names, given.truth, strict=True) if "delta" in n and n[0] == "a"]
    assert neglected.max() <= np.abs(angles).max() * G0
    u = np.sqrt(np.diagonal(estimate.covariance))[: len(names)]
    assert neglected.max() * q.sd > 0.01 * u[0]  # of a sensor as quiet as this, it is seen


@pytest.mark.parametrize(
    ("method", "estimator", "name"),
    [
        *product(["tumble"], ["least_squares", "fourier"], ["sin1", "cos1", "sin2", "cos3"]),
        *product(["dual_orthogonal"], ["joint", "single", "patent"], ["sin1", "cos2", "sin3"]),
    ],
)
def test_coefficients_move_with_the_head_as_is_said(method: str, estimator: str, name: str):
    require_alike(*case_and_estimate(method, estimator, "none"), name)


@pytest.mark.parametrize(
    ("estimator", "name"),
    [
        ("damped", "g"),
        ("damped", "radius"),
        pytest.param("global", "radius", marks=pytest.mark.slow),
        evidence("global", "g"),
    ],
)
def test_norms_in_the_stated_frame_move_as_is_said(estimator: str, name: str):
    given = one_case("ship_multi_angle", estimator)
    given = given._replace(sensor=replace(given.sensor, frame="symmetric"))
    require_alike(given, given.found(), name)


@pytest.mark.parametrize(("method", "estimator"), CERTAIN)
def test_what_takes_the_bench_as_certain_says_nothing_of_it(method: str, estimator: str):
    given, estimate = case_and_estimate(method, estimator)
    for name, q in given.bench.nuisances(given.steps, given.sensor).items():
        assert estimate.sensitivity(name, max(q.sd, 1e-9)) is None, name


def test_every_estimator_is_in_one_of_the_lists():
    every = {(name, one) for name, method in METHODS.items() for one in method.estimators}
    assert every == {
        *ERRORS,
        *CERTAIN,
        ("ship_multi_angle", "global"),
        ("field_and_rates", "gls"),  # uses no error of a bench
        ("temperature_ramp", "gls"),  # uses no error of a bench
        ("systematic", "batch"),  # by tests/methods/test_systematic.py
        ("systematic", "kalman"),  # by tests/methods/test_systematic_filter.py
    }


def test_a_choice_of_coefficients_keeps_how_they_move():
    _, estimate = case_and_estimate("tumble", "fourier")
    chosen = estimate.select(estimate.names[1:3])
    by, whole = chosen.sensitivity("g", 1.0), estimate.sensitivity("g", 1.0)
    assert by is not None
    assert whole is not None
    assert by.tolist() == whole[1:3].tolist()
