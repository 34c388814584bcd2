"""`centrifuge_norm` against its method note: what each estimator reaches on the paper's design.

Numbers of the note were computed apart from this project; data by `tests.accuracy.centrifuge`.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.centrifuge import (
    PAPER_G,
    RATES,
    Triad,
    full_circle,
    printed_attitudes,
    sensed_motion,
)
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.estimation import Estimate, Gaussian
from inercal.methods.centrifuge_norm import (
    ClosedFormulas,
    closed_formulas,
    ml,
    paper,
    series,
    series_weighted,
)
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, Form, Readout, Sensor, triad
from inercal.recordings import Observations

Array = NDArray[np.float64]
TRUTH = Triad()
AT_THE_EQUATOR = Measured(0.0, 0.0)  # where the earth does not turn about the spindle
BENCH = Centrifuge(Measured(PAPER_G, 0.0), Measured(1.0, 0.0), AT_THE_EQUATOR)
NOMINAL, NOISE = 1.25, 1e-5  # output units per g, output units


def sensor(*also: str) -> Sensor:
    readout = Readout(NOMINAL / PAPER_G, 0.0, "V")
    made = triad("triad", "f", "", readout).with_coefficients("k0", "k1", "k2", *also)
    return replace(made, form="tilted")


def table(output: Array, rates: Array, *also: str) -> tuple[Observations, Sensor, list[Spin]]:
    made, r = sensor(*also), output.shape[-2]
    sd = NOISE * PAPER_G / NOMINAL
    labels = tuple(f"d{k:02d}" for k in range(r))
    seen = Observations(
        labels,
        made.to_si(output),
        np.broadcast_to(sd**2 * np.eye(3), (r, 3, 3)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        made.channels,
    )
    return seen, made, [Spin(name, w) for name, w in zip(labels, rates.tolist(), strict=True)]


def as_printed(value: Array) -> Array:
    """Return S, b and D of the axes in output units and the paper's g, (..., 3, 3)."""
    k0, k1, k2 = np.moveaxis(value[..., :9].reshape(*value.shape[:-1], 3, 3), -1, 0)
    scale = NOMINAL * (1 + k1)
    return np.stack([scale, k0 * NOMINAL / PAPER_G, k2 / (1 + k1) * PAPER_G], axis=-2)


def off(value: Array) -> Array:
    """Return how far S, b and D are from the truth, (..., 3, 3)."""
    return as_printed(value) - np.stack([TRUTH.scale, TRUTH.bias, TRUTH.bend])


def printed_design() -> tuple[Array, Array]:
    return sensed_motion(printed_attitudes(), RATES)


@pytest.fixture
def corrected(data_dir: Path) -> Array:
    path = data_dir / "centrifuge_table1" / "table1_corrected.csv"
    if not path.exists():
        pytest.skip(f"{path} is missing")
    return np.loadtxt(path, delimiter=",", skiprows=1)[:, 3:]


def test_the_design_gives_the_printed_table_but_for_its_last_digit(corrected: Array):
    f, _ = printed_design()
    assert np.abs(TRUTH.output(f) - corrected).max() < 6.0e-7


def test_paper_takes_what_is_cut_off_for_bending():
    f, rates = printed_design()
    error = off(paper(*table(TRUTH.output(f), rates)[:2], BENCH, table(f, rates)[2]).value)
    assert error[2] == pytest.approx([6.0e-10, 1.06e-7, -2.8e-9], rel=0.05)
    assert np.abs(error[0]).max() < 2e-7
    assert np.abs(error[1]).max() < 7e-7


def with_noise(seen: Observations, noise: float) -> Observations:
    """Return observations with another noise stated, output units."""
    return replace(seen, covariance=seen.covariance * (noise / NOISE) ** 2)


@pytest.mark.slow
def test_the_equations_of_the_source_run_on_its_own_table(corrected: Array):
    """(16) to (22) on Table 1, whose only noise is the rounding of the last digit."""
    _, rates = printed_design()
    seen, made, spins = table(corrected, rates)
    for noise in (1e-12, 1e-9, 3e-7):
        estimate = paper(with_noise(seen, noise), made, BENCH, spins)
        assert np.isfinite(estimate.covariance).all()
        assert np.abs(off(estimate.value)[:2]).max() < 1e-5
        assert estimate.std == pytest.approx(
            paper(with_noise(seen, 2 * noise), made, BENCH, spins).std / 2
        )
    # At 10 µV a fourth-power coefficient is within 2 u of zero, below which it has no root.
    assert np.isnan(paper(seen, made, BENCH, spins).covariance).all()


@pytest.mark.parametrize("estimator", [paper, series, series_weighted])
def test_u_of_closed_formulas_is_their_scatter(estimator: ClosedFormulas):
    """Over 400 draws of 1 µV; the band of a standard deviation is two-sided 99.9 %."""
    f, rates = printed_design()
    noise, draws = 1e-6, 400
    rng = np.random.default_rng(5)
    drawn = TRUTH.output(f) + noise * rng.standard_normal((draws, *f.shape))
    seen, made, spins = table(drawn, rates)
    norm = np.hypot(rates**2, PAPER_G)
    found = closed_formulas.coefficients(
        made, seen.mean, norm, estimator.invert, weighted=estimator.weighted
    )
    exact = with_noise(table(TRUTH.output(f), rates)[0], noise)
    stated = estimator(exact, made, BENCH, spins).std
    assert np.abs(found.std(axis=0, ddof=1) / stated - 1).max() < 3.29 / np.sqrt(2 * draws)


def test_series_is_left_with_less():
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates)
    error = np.abs(off(series(seen, made, BENCH, spins).value)).max(axis=1)
    assert np.all(error < [6e-9, 6.5e-7, 2.1e-9])


def test_ml_is_exact_without_noise():
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates)
    estimate = ml(seen, made, BENCH, spins)
    assert estimate.converged
    assert np.all(np.abs(off(estimate.value)).max(axis=1) < [1e-12, 1e-12, 1e-15])


def test_ml_on_the_rounded_table(corrected: Array):
    _, rates = printed_design()
    seen, made, spins = table(corrected, rates)
    error = np.abs(off(ml(seen, made, BENCH, spins).value)).max(axis=1)
    assert np.all(error < [1e-8, 1.5e-7, 2e-10])


BOUND = np.array(  # of S, b, D by the note
    [[1.16e-7, 7.1e-7, 1.56e-7], [2.75e-6, 5.2e-6, 3.5e-6], [3.48e-9, 1.49e-8, 5.6e-9]]
)


def stated(estimate: Estimate) -> Array:
    """Return the stated deviations of S, b and D, (3, 3)."""
    step = 1e-3 * estimate.std[:9]
    to = np.stack([as_printed(estimate.value[:9] + row) for row in np.diag(step)])
    slope = (to - as_printed(estimate.value[:9])).reshape(9, 9) / step[:, None]
    variance = np.diagonal(slope.T @ estimate.covariance[:9, :9] @ slope)
    return np.sqrt(variance).reshape(3, 3)


def test_ml_states_the_cramer_rao_bound():
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates)
    assert stated(ml(seen, made, BENCH, spins)) == pytest.approx(BOUND, rel=0.01)


def test_a_full_circle_is_the_better_plan():
    f, rates = sensed_motion(full_circle(), RATES)
    seen, made, spins = table(TRUTH.output(f), rates)
    sd = stated(ml(seen, made, BENCH, spins))
    assert sd[0, 1] == pytest.approx(1.0e-7, rel=0.05)
    assert sd[2, 1] == pytest.approx(3.4e-9, rel=0.05)


def condition(f: Array) -> tuple[int, float]:
    rows = closed_formulas.regression_matrix(TRUTH.output(f))
    singular = np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[1]
    rank = int(np.sum(singular > 1e-10 * singular[0]))
    return rank, float(singular[0] / singular[-1])


def test_rank_and_condition_say_what_the_count_of_positions_does_not():
    assert condition(printed_design()[0]) == (13, pytest.approx(330, rel=0.01))
    assert condition(sensed_motion(full_circle(), RATES)[0]) == (13, pytest.approx(17, rel=0.05))
    assert condition(sensed_motion(printed_attitudes(), RATES[:1])[0])[0] == 10
    assert condition(sensed_motion(printed_attitudes(), RATES[:2])[0])[0] == 13


def drawn(seed: int, trials: int) -> tuple[Array, Array]:
    f, rates = printed_design()
    noise = np.random.default_rng([seed, 836]).standard_normal((trials, *f.shape))
    return TRUTH.output(f) + NOISE * noise, rates


@pytest.mark.parametrize(
    ("invert", "expected"),
    [
        (
            closed_formulas.series,
            [[4.1e-7, 2.9e-6, 5.4e-7], [5.2e-6, 1.8e-5, 6.8e-6], [4.7e-9, 1.3e-7, 7.8e-9]],
        ),
        (
            closed_formulas.paper,
            [[1.6e-6, 1.5e-5, 6.9e-6], [5.2e-6, 1.5e-5, 7.4e-6], [9.2e-7, 1.1e-5, 2.1e-6]],
        ),
    ],
)
def test_closed_formulas_scatter_as_the_note_says(
    invert: closed_formulas.SeriesInverse, expected: list[list[float]]
):
    output, rates = drawn(1, 4000)
    seen, made, _ = table(output, rates)
    a = rates**2
    norm = np.sqrt(a**2 + PAPER_G**2)
    found = off(closed_formulas.coefficients(made, seen.mean, norm, invert))
    possible = np.isfinite(found).all(axis=(1, 2))
    if invert is closed_formulas.paper:
        assert 0.10 < 1 - possible.mean() < 0.16
    else:
        assert possible.all()
    assert found[possible].std(axis=0) == pytest.approx(np.array(expected), rel=0.1)


def test_four_thousand_calibrations_reach_the_bound(seed: int):
    trials = 4000
    seen, made, spins = table(*drawn(seed, trials))
    found = ml(seen, made, BENCH, spins)
    assert found.converged.all()
    bound = stated(
        ml(*table(TRUTH.output(printed_design()[0]), printed_design()[1])[:2], BENCH, spins)
    )
    error = off(found.value)
    ratio = error.std(axis=0) / bound
    assert np.all(np.abs(ratio - 1) < 0.05)
    assert np.abs(error.mean(axis=0) / bound).max() < 4 / np.sqrt(trials)
    assert found.dof == 51
    print(f"std over bound {ratio.min():.3f} to {ratio.max():.3f}, χ² {found.chi2.mean():.2f}")
    assert found.chi2.mean() == pytest.approx(51, abs=0.8)


@pytest.mark.slow
def test_calibrations_together_are_those_of_each_alone():
    output, rates = drawn(4, 20)
    seen, made, spins = table(output, rates)
    together = ml(seen, made, BENCH, spins)
    for t in range(20):
        alone = ml(replace(seen, mean=seen.mean[t]), made, BENCH, spins)
        assert together.iterations[t] == alone.iterations
        sd = alone.std
        assert np.abs((together.value[t] - alone.value) / sd).max() < 1e-6
        away = (together.covariance[t] - alone.covariance) / np.outer(sd, sd)
        assert np.abs(away).max() < 1e-6


def test_one_rate_in_half_a_circle_leaves_one_axis_open():
    f, rates = sensed_motion(printed_attitudes(), RATES[:1])
    seen, made, spins = table(TRUTH.output(f), rates)
    with pytest.raises(NotObserved) as refusal:
        ml(seen, made, BENCH, spins)
    (direction,) = refusal.value.directions
    weights = {
        name: float(w or 1) for w, name in re.findall(r"([\d.]*) ?\b([xyz]\.k\d)", direction)
    }
    assert set(sorted(weights, key=lambda name: -weights[name])[:3]) == {"y.k0", "y.k1", "y.k2"}
    assert max(w for name, w in weights.items() if name[0] != "y") < 0.05


def test_one_rate_all_round_is_enough():
    f, rates = sensed_motion(full_circle(), RATES[:1])
    seen, made, spins = table(TRUTH.output(f), rates)
    assert np.abs(off(ml(seen, made, BENCH, spins).value)).max() < 1e-9


def test_closed_formulas_refuse_what_they_cannot_do():
    f, rates = sensed_motion(printed_attitudes(), RATES[:1])
    seen, made, spins = table(TRUTH.output(f), rates)
    with pytest.raises(NotObserved):
        series(seen, made, BENCH, spins)
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates, "k3")
    with refused(key="[method]", names=("x.k3", "y.k3", "z.k3")):
        series(seen, made, BENCH, spins)
    seen, made, spins = table(TRUTH.output(f), rates)
    prior = Gaussian(("x.k0",), np.zeros(1), np.eye(1))
    with refused(key="priors", names=("x.k0",)):
        paper(seen, made, BENCH, spins, [prior])
    straight = replace(TRUTH, bend=np.zeros(3))
    noisy = straight.output(f) + NOISE * np.random.default_rng(1).standard_normal(f.shape)
    seen, made, spins = table(noisy, rates)
    with pytest.raises(InputError) as refusal:
        paper(seen, made, BENCH, spins)
    assert refusal.value.names
    assert set(refusal.value.names) <= set("xyz")


def test_non_orthogonality_and_cubic_terms_are_found_on_wish():
    rng = np.random.default_rng(4)
    axes = np.tril(1e-3 * rng.standard_normal((3, 3)), -1) + np.eye(3)
    device = replace(
        TRUTH,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        cubic=np.array([2e-7, -1e-7, 3e-7]),
    )
    f, rates = sensed_motion(full_circle(), RATES)
    seen, made, spins = table(device.output(f), rates, "k3", "nonorthogonality")
    found = ml(seen, made, BENCH, spins)
    named = dict(zip(made.coefficients, found.value.tolist(), strict=True))
    tangents = {name: np.tan(named[name]) for name in named if ".delta" in name}
    assert tangents["y.delta_p"] == pytest.approx(-axes[1, 0], abs=1e-9)
    assert tangents["z.delta_o"] == pytest.approx(axes[2, 0], abs=1e-9)
    assert tangents["z.delta_p"] == pytest.approx(-axes[2, 1], abs=1e-9)
    gain = [1 + named[f"{a}.k1"] for a in "xyz"]
    cubic = [named[f"{a}.k3"] / k * PAPER_G**2 for a, k in zip("xyz", gain, strict=True)]
    assert cubic == pytest.approx(device.cubic.tolist(), rel=1e-4)


@pytest.mark.parametrize("form", ["tilted", "reference"])
def test_rotations_of_the_triad_are_not_observed(form: Form):
    f, rates = sensed_motion(full_circle(), RATES)
    seen, made, spins = table(TRUTH.output(f), rates, "misalignment")
    with pytest.raises(NotObserved) as refusal:
        ml(seen, replace(made, form=form), BENCH, spins)
    assert len(refusal.value.directions) == 3
    assert set(refusal.value.names) == {n for n in made.coefficients if ".delta" in n}


def test_in_the_reference_form_rotations_show_through_k2_alone():
    """And badly, which is why they are held: found 9e-5 to 1.5e-4 rad, by the note 6e-5 to 1e-4."""
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates, "misalignment")
    made = replace(made, form="reference")
    # A prior far wider than what is found lifts the refusal.
    free = [name for name in made.coefficients if ".delta" in name]
    wide = Gaussian.independent(free, 0.0, 1.0)
    found = ml(seen, made, BENCH, spins, [wide])
    index = [found.names.index(name) for name in free]
    pairs = [("y.delta_o", "z.delta_p"), ("x.delta_p", "z.delta_o"), ("x.delta_o", "y.delta_p")]
    rows = np.array([[0.5 * (name in pair) for name in free] for pair in pairs])
    sd = np.sqrt(np.diag(rows @ found.covariance[np.ix_(index, index)] @ rows.T))
    print("rotations by k2 alone:", sd)
    assert np.all((sd > 6e-5) & (sd < 1.6e-4))


def test_errors_of_the_bench_are_in_the_uncertainty(seed: int):
    """Radius, stretch, rate, tilt, gravity and the earth's rate are drawn, and each dwell's own."""
    rng = np.random.default_rng([seed, 293])
    bench = Centrifuge(
        Measured(PAPER_G, 3e-4),
        Measured(1.0, 1e-5),
        Measured(0.683, 1.7e-3),
        Measured(2e-8, 1e-8),
        rate=1e-6,
        tilt=1e-5,
        dwell_rate=5e-7,
        dwell_tilt=2e-6,
    )
    outputs: list[Array] = []
    for _ in range(60):
        value = {q.name: rng.normal(q.value, q.sd) for q in bench.parameters}
        rows: list[Array] = []
        for rate in RATES:
            for attitude in full_circle():
                w = rate * (1 + value["rate"] + bench.dwell_rate * rng.standard_normal())
                w += 7.292115e-5 * np.sin(value["latitude"])
                stretched = value["radius"] * (1 + value["stretch"] * rate**2)
                tilt = value["tilt"] + bench.dwell_tilt * rng.standard_normal()
                a, g = w**2 * stretched + value["g"] * np.sin(tilt), value["g"] * np.cos(tilt)
                one, _ = sensed_motion([attitude], [1.0], radius=a, gravity=g)
                rows.append(one[0])
        f = np.array(rows)
        outputs.append(TRUTH.output(f) + NOISE * rng.standard_normal(f.shape))
    seen, made, spins = table(np.array(outputs), np.repeat(RATES, len(full_circle())))
    found = ml(seen, made, bench, spins)
    exact = {
        "k0": TRUTH.bias * PAPER_G / NOMINAL,
        "k1": TRUTH.scale / NOMINAL - 1,
        "k2": TRUTH.bend * TRUTH.scale / NOMINAL / PAPER_G,
    }
    true = np.array([exact[n.partition(".")[2]]["xyz".index(n[0])] for n in made.coefficients])
    error = found.value[:, :9] - true
    weighed = np.linalg.solve(found.covariance[:, :9, :9], error[..., None])[..., 0]
    nees = (error * weighed).sum(axis=1) / 9
    print(f"NEES {np.mean(nees):.3f}")
    assert np.mean(nees) == pytest.approx(1, abs=4 * np.sqrt(2 / 9 / len(nees)))


def test_a_static_test_as_a_prior_leaves_the_quadratic_terms_to_the_centrifuge():
    f, rates = sensed_motion(printed_attitudes(), RATES[:1])
    seen, made, spins = table(TRUTH.output(f), rates)
    k0 = TRUTH.bias[1] * PAPER_G / NOMINAL
    static = Gaussian(("y.k0",), np.array([k0]), np.array([[(1e-6 * G0) ** 2]]))
    error = off(ml(seen, made, BENCH, spins, [static]).value)
    assert np.abs(error).max() < 1e-9
