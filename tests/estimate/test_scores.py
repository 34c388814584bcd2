"""Score tests, held to what a fit with the candidate among its parameters gives."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_squared
from scipy.stats import f, kstest, ncx2, norm

from inercal.estimation import Candidate, Gaussian, Problem, least_squares, score_tests
from inercal.estimation.candidate_scores import rows_from_products
from inercal.estimation.scores import (
    _LEVEL_WEIGHTS,  # pyright: ignore[reportPrivateUsage]
    chi2_tail_probabilities,
    chi2_tail_probability,
)

Array = NDArray[np.float64]


def candidate(name: str, rows: Array) -> Candidate:
    k = rows.shape[1]
    names = tuple(f"{name}{i}" for i in range(k))
    return Candidate(name, "coefficient", names, ("1",) * k, rows)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_fall_size_and_shift_are_those_of_the_fit_with_the_candidate(
    rng: np.random.Generator,
) -> None:
    design, extra = rng.standard_normal((20, 4)), rng.standard_normal((20, 2))
    y = design @ np.arange(4.0) + extra @ [0.7, -0.4] + rng.standard_normal(20)
    first = np.linalg.lstsq(design, y)[0]
    whole = np.linalg.lstsq(np.column_stack([design, extra]), y)[0]
    fall = np.sum((y - design @ first) ** 2)
    fall -= np.sum((y - np.column_stack([design, extra]) @ whole) ** 2)
    (score,) = score_tests(y - design @ first, design, [candidate("c", extra)]).scores
    assert score.chi2 == pytest.approx(fall, rel=1e-12)
    assert score.dof == 2
    np.testing.assert_allclose(score.size, whole[4:], rtol=1e-10)
    np.testing.assert_allclose(score.shift, first - whole[:4], rtol=1e-10)


def test_what_the_fit_takes_up_whole_is_not_shown(rng: np.random.Generator) -> None:
    design = rng.standard_normal((20, 4))
    residual = rng.standard_normal(20)
    (score,) = score_tests(residual, design, [candidate("c", design[:, :1] * 3.0)]).scores
    assert score.dof == 0
    assert score.p_value == 1.0
    assert np.isnan(score.size).all()


def test_half_of_a_pair_that_is_shown_leaves_sizes_open(rng: np.random.Generator) -> None:
    design = rng.standard_normal((20, 4))
    both = np.column_stack([rng.standard_normal(20), design[:, 0]])
    (score,) = score_tests(rng.standard_normal(20), design, [candidate("c", both)]).scores
    assert score.dof == 1
    assert np.isnan(score.size).tolist() == [False, True]


def test_a_prior_of_the_solver_is_part_of_the_projection(rng: np.random.Generator) -> None:
    design, extra = rng.standard_normal((12, 3)), rng.standard_normal((12, 1))
    sd = np.linspace(0.5, 2.0, 12)
    y = design @ [1.0, 2.0, 3.0] + sd * rng.standard_normal(12)
    prior = Gaussian.independent(("a",), [1.0], [0.01])

    def problem(columns: Array, names: tuple[str, ...], candidates: bool) -> Problem:
        return Problem(
            names, np.zeros(len(names)), lambda x: (y - x @ columns.T, columns), sd,
            np.ones(len(names)), (prior,),
            candidates=(lambda _: [candidate("d", extra)]) if candidates else None,
        )  # fmt: skip

    small = least_squares(problem(design, ("a", "b", "c"), True))
    large = least_squares(problem(np.column_stack([design, extra]), ("a", "b", "c", "d"), False))
    (score,) = small.score_tests.scores
    assert score.chi2 == pytest.approx(float(small.chi2 - large.chi2), rel=1e-9)
    np.testing.assert_allclose(score.size, large.value[3:], rtol=1e-9)
    np.testing.assert_allclose(score.sd, large.std[3:] / large.birge, rtol=1e-9)
    np.testing.assert_allclose(score.shift, small.value - large.value[:3], rtol=1e-9)


@pytest.mark.slow
def test_scores_are_normal_and_the_adjusted_level_holds(rng: np.random.Generator) -> None:
    design = rng.standard_normal((15, 5))
    basis = np.linalg.qr(design)[0]
    candidates = [candidate(f"c{k}", rng.standard_normal((15, 1))) for k in range(30)]
    least: list[float] = []
    t: list[float] = []
    for _ in range(1500):
        noise = rng.standard_normal(15)
        result = score_tests(noise - basis @ (basis.T @ noise), design, candidates)
        assert result.span == 10
        t.append(float(result.scores[0].size[0] / result.scores[0].sd[0]))
        least.append(min(result.adjusted(one) for one in result.scores))
    assert kstest(t, norm.cdf).pvalue > 1e-3
    # Both bounds are strict: no more false alarms than the level, within 99.9 % of a binomial.
    assert np.mean(np.array(least) < 0.05) < 0.05 + 3.3 * np.sqrt(0.05 * 0.95 / 1500)


def test_parallel_candidates_have_a_cosine_of_one(rng: np.random.Generator) -> None:
    design, one = rng.standard_normal((20, 4)), rng.standard_normal((20, 1))
    alike = one + design @ rng.standard_normal((4, 1))
    both = score_tests(
        rng.standard_normal(20), design, [candidate("a", one), candidate("b", alike)]
    )
    assert both.scores[0].cosine(both.scores[1]) == pytest.approx(1.0, abs=1e-12)
    assert both.span == 1


def test_very_many_rows_are_scored_as_few_are(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    design, noise = rng.standard_normal((300, 6)), rng.standard_normal(300)
    noise -= design @ np.linalg.lstsq(design, noise)[0]
    three = rng.standard_normal((300, 3))
    some = [candidate("c", three), candidate("d", rng.standard_normal((300, 1)))]
    # One that is in a family is the same column alone.
    alone = Candidate("c1", "coefficient", ("c1",), ("1",), three[:, 1:2])
    few = score_tests(noise, design, [*some, alone])
    monkeypatch.setattr("inercal.estimation.candidate_scores._MANY", 100)
    many = score_tests(noise, design, [*some, alone])
    assert many.span == few.span
    for one, other in zip(few.scores, many.scores, strict=True):
        assert other.chi2 == pytest.approx(one.chi2, rel=1e-9)
        np.testing.assert_allclose(other.size, one.size, rtol=1e-9)
        np.testing.assert_allclose(other.shift, one.shift, rtol=1e-9)
        assert other.cosine(many.scores[2]) == pytest.approx(one.cosine(few.scores[2]), rel=1e-9)
        assert other.explained.column.size < one.explained.column.size


def test_products_alone_give_the_same_scores(rng: np.random.Generator) -> None:
    columns, residual = rng.standard_normal((400, 4)), rng.standard_normal(400)
    columns *= [1.0, 1e-6, 1e4, 1.0]  # units differ
    columns[:, 3] = columns[:, 0] + 1e-3 * columns[:, 3]
    less, rows = rows_from_products(columns.T @ columns, columns.T @ residual)
    for k in range(4):
        one = score_tests(residual, np.zeros((400, 0)), [candidate("c", columns[:, k : k + 1])])
        other = score_tests(less, np.zeros((len(less), 0)), [candidate("c", rows[:, k : k + 1])])
        assert other.scores[0].chi2 == pytest.approx(one.scores[0].chi2, rel=1e-6)
        np.testing.assert_allclose(other.scores[0].size, one.scores[0].size, rtol=1e-6)


def test_products_are_those_of_what_is_left_of_the_columns(rng: np.random.Generator) -> None:
    design, residual = rng.standard_normal((40, 5)), rng.standard_normal(40)
    residual -= design @ np.linalg.lstsq(design, residual)[0]
    rows = np.zeros((40, 4))  # two of them share a row, two act apart
    rows[:2, 0], rows[1:3, 1], rows[10, 2], rows[20, 3] = 1.0, 2.0, 1.0, 1.0
    made = score_tests(residual, design, [candidate(f"c{k}", rows[:, k : k + 1]) for k in range(4)])
    left = rows - design @ np.linalg.lstsq(design, rows)[0]
    lengths = np.linalg.norm(left, axis=0)
    expected = np.abs(left.T @ left) / np.outer(lengths, lengths)
    found = [[one.cosine(other) for other in made.scores] for one in made.scores]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("dof", [1, 2, 3, 8, 57, 200, 201, 1000])
@pytest.mark.parametrize("p", [1 - 1e-9, 0.5, 1e-3, 1e-30, 1e-200])
def test_the_tail_of_chi2_is_that_of_scipy(dof: int, p: float) -> None:
    chi2 = float(chi_squared.isf(p, dof))
    assert chi2_tail_probability(chi2, dof) == pytest.approx(chi_squared.sf(chi2, dof), rel=1e-12)


def test_each_number_of_directions_is_missed_as_often_at_six_standard_deviations() -> None:
    for dof, weight in enumerate(_LEVEL_WEIGHTS, 1):
        assert weight == pytest.approx(chi_squared.sf(ncx2.ppf(0.05, dof, 36.0), dof), rel=1e-9)


def test_a_score_by_noise_that_was_found_is_f(seed: int) -> None:
    rng = np.random.default_rng(seed)
    many, nu = 20_000, 12
    variance = rng.chisquare(nu, many) / nu
    chi2 = rng.chisquare(3, many) / variance
    p = [chi2_tail_probability(x, 3, nu) for x in chi2.tolist()]
    assert kstest(p, "uniform").pvalue > 1e-3
    assert chi2_tail_probability(11.3, 3, nu) == pytest.approx(f.sf(11.3 / 3, 3, nu))


def test_chi2_by_noise_that_was_found_of_each_channel_is_f_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    many, nu, channels, dof = 20_000, 60, 6, 54
    variance = rng.chisquare(nu, (channels, many)) / nu
    chi2 = (rng.chisquare(dof / channels, (channels, many)) / variance).sum(axis=0)
    assert kstest(chi2_tail_probabilities(chi2, dof, nu, channels), "uniform").pvalue > 1e-3
    for wrong in ((np.inf, channels), (nu, 1)):
        assert kstest(chi2_tail_probabilities(chi2, dof, *wrong), "uniform").pvalue < 1e-9


def test_noise_that_was_found_lets_fewer_candidates_reject(rng: np.random.Generator) -> None:
    design, residual = np.zeros((30, 0)), rng.standard_normal(30)
    rows = 5.0 * np.eye(30)[:, :6]
    residual[:6] += 5.0
    some = [candidate(f"c{k}", rows[:, k : k + 1]) for k in range(6)]
    stated = score_tests(residual, design, some)
    found = replace(stated, noise_dof=20.0)
    for one in stated.scores:
        assert found.adjusted(one) > stated.adjusted(one)
