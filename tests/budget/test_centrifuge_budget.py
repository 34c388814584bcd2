"""Budgets on a centrifuge: derivatives against drawing, dense formulas and the method note."""

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.centrifuge import EARTH, PAPER_G, RATES, Triad
from tests.base_seeds import SEEDS, evidence
from tests.methods.test_centrifuge_norm import NOISE, NOMINAL, sensor
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.estimation import Gaussian
from inercal.methods.centrifuge_norm import ml, plan, series
from inercal.physics.plan import Spin
from inercal.pipeline.budget import (
    Budget,
    Experiment,
    budget,
    effect_shifts,
    first_order_contributions,
)

Array = NDArray[np.float64]
ARCSEC = pi / 648_000
PLACE = radians(39)
BENCH = Centrifuge(
    Measured(PAPER_G, 0.0),
    Measured(1.0, 1e-5),
    Measured(PLACE, radians(0.1)),
    rate=1e-6,
    tilt=2 * ARCSEC,
)
EXACT = Centrifuge(Measured(PAPER_G, 0.0), Measured(1.0, 0.0), Measured(PLACE, 0.0))
TRIAD = Triad()
SD = NOISE * PAPER_G / NOMINAL


def truth() -> dict[str, float]:
    found: dict[str, float] = {}
    for i, a in enumerate("xyz"):
        found[f"{a}.k0"] = TRIAD.bias[i] * PAPER_G / NOMINAL
        found[f"{a}.k1"] = TRIAD.scale[i] / NOMINAL - 1
        found[f"{a}.k2"] = TRIAD.bend[i] * TRIAD.scale[i] / NOMINAL / PAPER_G
    return found


def experiment(attitudes: str, bench: Centrifuge = BENCH, *also: str, **more: float) -> Experiment:
    steps = plan(attitudes)
    noise = np.broadcast_to(SD**2 * np.eye(3), (len(steps), 3, 3))
    return Experiment(sensor(*also), bench, steps, ml, noise, truth=truth() | more)


def every_other_dwell(made: Experiment) -> Experiment:
    """Return the experiment with every other dwell: quicker."""
    return replace(made, steps=made.steps[::2], noise=made.noise[::2])


def single_contribution(made: Experiment, name: str) -> Array:
    """Return the contribution of one imperfection to first order, without the others' work."""
    steps = np.eye(made.size)[made.draw_columns[name]]
    by_draw = (made(made.expansion_point + steps) - made(made.expansion_point - steps)) / 2
    return np.sqrt(np.sum(by_draw**2, axis=0))


def assert_agree(found: Budget, widest: float) -> None:
    """Where a contribution is not less than a thousandth of the total, and the total itself."""
    worst = 0.0
    for one, spread in found.contributions.items():
        counts = spread.first_order > 1e-3 * found.total.first_order
        assert counts.any() or one.name in ("lean", "latitude")
        off = spread.monte_carlo[counts] / spread.first_order[counts] - 1
        worst = max(worst, float(np.abs(off).max(initial=0)))
    total = np.abs(found.total.monte_carlo / found.total.first_order - 1).max()
    print(f"Monte Carlo against first order: alone {worst:.3f}, together {total:.3f}")
    assert max(worst, total) < widest


@pytest.mark.slow
@pytest.mark.parametrize("drawn", [40, evidence(120)])
def test_derivatives_of_a_leaning_arm_agree_with_some_drawn(drawn: int):
    made = experiment("full-circle", replace(BENCH, lean=1e-5))
    made = every_other_dwell(made)
    found = budget(made, drawn, seed=1)
    assert_agree(found, 4 / np.sqrt(2 * drawn))
    spin, lean = next((s, line) for line, s in found.contributions.items() if line.name == "lean")
    assert len(lean.draws) == 2
    assert np.all(spin.first_order < 1e-9 * found.total.first_order)
    assert np.all(spin.monte_carlo < 1e-9 * found.total.first_order)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("attitudes", ["full-circle", "half-circle"])
def test_derivatives_agree_with_four_thousand_drawn_within_five_per_cent(attitudes: str, seed: int):
    assert_agree(budget(experiment(attitudes), 4000, seed), 0.05)


def test_a_lean_contributes_where_turns_are_not_whole():
    whole = experiment("full-circle", replace(BENCH, lean=1e-5))
    steps = tuple(
        replace(step, seconds=1.3 * 2 * pi / step.rate)
        for step in whole.steps
        if isinstance(step, Spin)
    )
    lean = single_contribution(replace(whole, steps=steps), "lean")
    assert np.all(single_contribution(whole, "lean") < 1e-9 * whole.stated())
    assert np.max(lean / whole.stated()) > 0.01


def dense_regression_contributions(attitudes: str, bench: Centrifuge) -> dict[str, Array]:
    """Return the contributions (S, b, D) by a dense regression, in output units and paper's g."""
    sds = {
        "radius": bench.radius.sd,
        "rate": bench.rate,
        "tilt": bench.tilt,
        "latitude": bench.latitude.sd if bench.latitude else 0.0,
    }
    sds = {name: sd for name, sd in sds.items() if sd}
    steps = [step for step in plan(attitudes)[::2] if isinstance(step, Spin)]
    w = np.array([step.rate for step in steps])

    def made(radius: float = 0, rate: float = 0, tilt: float = 0, latitude: float = 0) -> Array:
        turned = w * (1 + rate) + EARTH * np.sin(PLACE + latitude)
        a = (1 + radius) * turned**2 / PAPER_G
        return np.sqrt(a**2 + 2 * a * tilt + 1)

    a = made() ** 2 - 1
    out, up = (np.array([getattr(step.attitude, end) for step in steps]) for end in ("out", "up"))
    y = TRIAD.output(-np.sqrt(a)[:, None] * out + up)

    def sensed_motion(theta: Array) -> Array:
        s, b, d = theta.reshape(3, 3)
        u = (y - b) / s
        return 2 * u / (1 + np.sqrt(1 + 4 * d * u))

    at = np.concatenate([TRIAD.scale, TRIAD.bias, TRIAD.bend])
    step = np.repeat([1e-5, 1e-4, 1e-7], 3)
    n = np.linalg.norm(sensed_motion(at), axis=1)
    columns = [
        (
            np.linalg.norm(sensed_motion(at + row), axis=1)
            - np.linalg.norm(sensed_motion(at - row), axis=1)
        )
        / (2 * h)
        for row, h in zip(np.diag(step), step, strict=True)
    ]
    bench_columns = [(made(**{k: sd}) - made(**{k: -sd})) / 2 for k, sd in sds.items()]
    f = sensed_motion(at)
    along = f / n[:, None] / (TRIAD.scale * (1 + 2 * TRIAD.bend * f))
    sigma = NOISE * np.linalg.norm(along, axis=1)
    rows = np.stack([*columns, *(-c for c in bench_columns)], axis=1) / sigma[:, None]
    priors = np.zeros((len(sds), rows.shape[1]))
    priors[:, 9:] = np.eye(len(sds))
    whole = np.concatenate([rows, priors])
    size = np.linalg.norm(whole, axis=0)
    back = np.linalg.pinv(whole / size, rcond=1e-15) / size[:, None]
    gain = back[:9, : len(w)] / sigma
    found = {name: np.abs(gain @ c) for name, c in zip(sds, bench_columns, strict=True)}
    return found | {"noise": np.sqrt(((gain * sigma) ** 2).sum(axis=1))}


def in_printed_units(contribution: Array) -> Array:
    """Return standard deviations of S, b and D, (9,); that of D is for k2, at a fixed scale."""
    k0, k1, k2 = contribution.reshape(3, 3).T
    return np.concatenate([k1 * NOMINAL, k0 * NOMINAL / PAPER_G, k2])


@pytest.mark.parametrize("attitudes", ["full-circle", "half-circle"])
def test_first_order_is_that_of_a_dense_regression(attitudes: str):
    """S and b alone: k2 holds the scale factor too."""
    made = first_order_contributions(every_other_dwell(experiment(attitudes)))
    expected = dense_regression_contributions(attitudes, BENCH)
    assert set(made) == set(expected)
    total = np.sqrt(np.sum([x**2 for x in expected.values()], axis=0))
    for name, contribution in expected.items():
        counts = (contribution > 1e-3 * total)[:6]
        ratio = in_printed_units(made[name])[:6][counts] / contribution[:6][counts]
        assert ratio == pytest.approx(np.ones(counts.sum()), rel=2e-3), name


def test_a_relative_error_of_the_radius_is_one_of_scale_and_bending():
    """ΔS = S ε, ΔD = D ε by the note, of an estimator that takes the bench as exact."""
    bench = replace(EXACT, radius=Measured(1.0, 1e-5))
    steps = plan("full-circle")
    noise = np.broadcast_to(SD**2 * np.eye(3), (len(steps), 3, 3))
    taken = Experiment(sensor(), bench, steps, series, noise, truth=truth())
    s, _, k2 = np.split(in_printed_units(single_contribution(taken, "radius")), 3)
    assert s == pytest.approx(1e-5 * TRIAD.scale, rel=0.02)
    # Bending as printed is k2 over the scale factor: both have ε, and k2 twice.
    d = TRIAD.bend * TRIAD.scale / NOMINAL / PAPER_G
    assert k2 == pytest.approx(2e-5 * d, rel=0.05)
    # Gravity beside it gives a part of the radius away to maximum likelihood.
    absorbed = single_contribution(replace(taken, estimator=ml), "radius")
    assert np.all(in_printed_units(absorbed)[:3] < 0.5 * s)


@pytest.mark.slow
def test_the_sum_of_squares_is_what_maximum_likelihood_states():
    """With priors on lever arms too: all that is unknown is drawn as it is believed."""
    made = replace(
        experiment("full-circle", BENCH, "x.arm_i", "y.arm_i"),
        priors=(Gaussian.independent(("x.arm_i", "y.arm_i"), 0.0, [1e-4, 1e-4]),),
    )
    made = every_other_dwell(made)
    found = first_order_contributions(made)
    assert "prior of x.arm_i, y.arm_i" in found
    total = np.sqrt(np.sum([x**2 for x in found.values()], axis=0))
    assert total == pytest.approx(made.stated(), rel=2e-3)


def test_earth_rate_left_uncorrected_shifts_as_the_note_says():
    (only,) = effect_shifts(experiment("half-circle", EXACT))
    assert only.name == "earth's rate"
    k0, k1, _ = only.shift.reshape(3, 3).T
    assert k1[0] * NOMINAL == pytest.approx(7e-6, rel=0.05)
    assert k0[1] * NOMINAL / PAPER_G == pytest.approx(-6.8e-5, rel=0.01)


def test_stretch_left_uncorrected_is_a_shift_and_with_the_earth_there_is_a_sum():
    bench = replace(EXACT, stretch=Measured(1e-7, 0.0))
    earth, stretch, both = effect_shifts(experiment("full-circle", bench))
    assert (stretch.name, both.name) == ("stretch of the arm", "all of these")
    assert stretch.value == "0.9807 ppm/g"
    assert both.shift == pytest.approx(
        earth.shift + stretch.shift, rel=1e-2, abs=1e-3 * np.abs(both.shift[0])
    )
    assert stretch.shift[1] > 0


def test_a_misalignment_that_is_not_estimated_shifts_the_bias():
    """By the note −5.4 g/rad of the sum of the symmetric pair: −2.2e-3 g of 2e-4 rad each."""
    made = experiment("half-circle", EXACT, **{"x.delta_o": 2e-4, "y.delta_p": -2e-4})
    *_, first, second, whole = effect_shifts(made)
    assert first.name == "x.delta_o"
    earth = effect_shifts(experiment("half-circle", EXACT))[0]
    bias = (whole.shift - earth.shift)[0] * NOMINAL / PAPER_G
    print("bias by misalignment", bias, second.shift[0] * NOMINAL / PAPER_G)
    assert bias == pytest.approx(-2.2e-3, rel=0.05)


def test_unknown_attitudes_are_refused():
    spins = tuple(Spin(f"d{k}", rate) for k, rate in enumerate(RATES))
    with refused(key="[method] attitudes"):
        Experiment(sensor(), BENCH, spins, ml, np.broadcast_to(np.eye(3), (3, 3, 3)))


def test_indexing_is_one_line_of_sixty_draws_without_effect_on_the_norms():
    made = experiment("full-circle", replace(BENCH, mounting=1e-4))
    mounting = next(one for one in made.imperfections if one.name == "mounting")
    assert mounting.draws == ("mount_x", "mount_y", "mount_z")
    # The noise about which it is worked out is turned a little against the force.
    assert np.all(single_contribution(made, "mounting") < 1e-3 * made.stated())
    known = experiment("full-circle", replace(BENCH, indexing=1e-3))
    indexing = next(one for one in known.imperfections if one.name == "indexing")
    assert len(indexing.draws) == 60
    assert indexing.stated == "206 ″"
