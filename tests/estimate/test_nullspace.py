import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from inercal.basics.errors import NotObserved
from inercal.estimation import Gauge, Gaussian, Problem, least_squares

Array = NDArray[np.float64]


def flat(
    names: tuple[str, ...],
    design: Array,
    scale: Array | None = None,
    priors: tuple[Gaussian, ...] = (),
    wanted: tuple[str, ...] = (),
) -> Problem:
    """Make a linear problem of unit noise whose observations are zero."""
    return Problem(
        names,
        np.zeros(len(names)),
        lambda x: (-(x @ design.T), design),
        np.ones(len(design)),
        np.ones(len(names)) if scale is None else scale,
        priors,
        wanted=wanted,
    )


def refused(problem: Problem) -> tuple[str, ...]:
    with pytest.raises(NotObserved) as caught:
        least_squares(problem)
    named = {word for words in caught.value.directions for word in words.split()}
    assert set(caught.value.names) >= named & set(problem.names)  # words list the largest alone
    return caught.value.directions


def test_a_column_of_zeros_is_named():
    design = np.random.default_rng(0).normal(size=(9, 3))
    design[:, 1] = 0.0
    assert refused(flat(("x.k0", "x.k2", "y.k0"), design)) == ("x.k2",)


def test_offset_and_gain_seen_at_one_level_only_are_named_together():
    design = np.array([[1.0, 9.8, 0, 0], [1, 9.8, 0, 0], [0, 0, 1, 9.8], [0, 0, 1, -9.8]])
    names, scale = ("z.k0", "z.k1", "x.k0", "x.k1"), np.array([0.1, 0.01, 0.1, 0.01])
    (found,) = refused(flat(names, design, scale))
    # k0 + 9.8 k1 is seen: moving k1 by one typical size, 0.098, is undone by −0.98 of k0.
    assert found == "−0.98 z.k0 + z.k1 (in units of their typical size)"


def test_separate_degeneracies_come_out_apart():
    rng = np.random.default_rng(3)
    blocks = []
    for n in (3, 2, 4):
        block = rng.normal(size=(8, n))
        block[:, -1] = block[:, 0] - 2 * block[:, 1]
        blocks.append(block)
    design = np.zeros((24, 9))
    design[:8, :3], design[8:16, 3:5], design[16:, 5:] = blocks
    design[8:16, 4] = 0.5 * design[8:16, 3]
    order = rng.permutation(9)
    names = np.array(["a0", "a1", "a2", "b0", "b1", "c0", "c1", "c2", "c3"])
    directions = refused(flat(tuple(names[order]), design[:, order]))
    assert len(directions) == 3
    groups = sorted(
        {"".join(sorted({c for c in d.split(" (")[0] if c in "abc"})) for d in directions}
    )
    assert groups == ["a", "b", "c"]
    (b,) = (d for d in directions if "b0" in d)
    assert "c2" not in "".join(directions)  # the free column of the block is in no null direction
    assert b.split(" (")[0] in ("−0.5 b0 + b1", "b1 − 0.5 b0")


def test_null_directions_of_random_designs_are_null_and_complete():
    rng = np.random.default_rng(8)
    for _ in range(50):
        m, p, rank = 12, 8, int(rng.integers(1, 8))
        scale = 10.0 ** rng.uniform(-6, 3, size=p)
        design = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, p)) / scale
        names = tuple(f"p{i}" for i in range(p))
        prior = Gaussian(names, np.zeros(p), np.diag(scale**2))
        estimate = least_squares(flat(names, design, scale, priors=(prior,)))
        assert estimate.rank == rank
        assert len(estimate.null_directions) == p - rank
        weights = np.array(
            [[d.weights.get(n, 0.0) for n in names] for d in estimate.null_directions]
        )
        assert np.linalg.matrix_rank(weights) == p - rank
        assert_allclose(np.abs(weights).max(axis=1), 1.0)
        assert np.abs((weights * scale) @ design.T).max() < 1e-8


def test_a_nuisance_without_prior_hides_what_it_resembles():
    rng = np.random.default_rng(1)
    column = 1e4 * rng.normal(size=(10, 1))
    design = np.hstack([column, 1e4 * rng.normal(size=(10, 1)), column])
    problem = flat(("k", "other", "drift"), design, wanted=("k", "other"))
    assert refused(problem) == ("k",)
    known = Gaussian.independent(("drift",), 0.0, 0.1)
    estimate = least_squares(
        flat(("k", "other", "drift"), design, wanted=("k", "other"), priors=(known,))
    )
    assert estimate.null_directions == ()
    assert estimate.rank == 2
    # What is left of k after the drift is as uncertain as the drift is.
    assert_allclose(1 / estimate.singular_values[-1], 0.1, rtol=1e-4)
    assert estimate.weakest is not None
    assert estimate.weakest.weights["k"] == 1.0


def test_two_nuisances_that_nothing_tells_apart_are_named():
    design = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 2.0, 2.0]])
    problem = flat(("k", "n1", "n2"), design, wanted=("k",))
    assert refused(problem) == ("n1 − n2 (in units of their typical size)",)


def test_singular_values_are_those_of_the_marginal_information():
    rng = np.random.default_rng(5)
    design, sd = rng.normal(size=(20, 6)), rng.uniform(0.1, 1, size=2)
    names = tuple("abcdef")
    scale = rng.uniform(0.1, 10, size=6)
    prior = Gaussian.independent(("e", "f"), 0.0, sd)
    estimate = least_squares(flat(names, design, scale, wanted=names[:4], priors=(prior,)))
    marginal = estimate.covariance[:4, :4] / np.outer(scale[:4], scale[:4])
    expected = np.sort(1 / np.sqrt(np.linalg.eigvalsh(marginal)))[::-1]
    assert_allclose(estimate.singular_values, expected, rtol=1e-9)


def test_a_nuisance_fitted_away_from_its_mean_does_not_make_a_coefficient_seen():
    # k shows only through the product with a tilt whose mean is zero.
    y = np.array([0.3, 0.3001, 0.2999])

    def linearise(x: Array) -> tuple[Array, Array]:
        tilt, k = x[..., 0, None], x[..., 1, None]
        one = np.ones(3)
        return y - tilt * (1 + k), np.stack([(1 + k) * one, tilt * one], axis=-1)

    prior = Gaussian.independent(("tilt",), 0.0, 1.0)
    problem = Problem(
        ("tilt", "k"), np.zeros(2), linearise, np.full(3, 1e-3), np.ones(2), (prior,), wanted=("k",)
    )
    assert refused(problem) == ("k",)


def test_an_accident_at_the_solution_is_refused_too():
    # Seen at the start (phase 1), hidden where the amplitude comes out as zero.
    def linearise(x: Array) -> tuple[Array, Array]:
        a, b = x[..., 0, None], x[..., 1, None]
        t = np.arange(4.0)
        c, s = np.cos(b * t), np.sin(b * t)
        return -a * c, np.stack([c, -a * t * s], axis=-1)

    problem = Problem(("a", "b"), np.array([1.0, 0.5]), linearise, np.ones(4), np.ones(2))
    assert refused(problem) == ("b",)


def norms(extra: bool = True) -> Problem:
    """|M u|² for many u: blind to any rotation of the frame; a further column is blind too."""
    rng = np.random.default_rng(2)
    u = rng.normal(size=(30, 3))
    names = tuple(f"{a}{b}" for a in "xyz" for b in "xyz") + (("spare",) if extra else ())

    def linearise(x: Array) -> tuple[Array, Array]:
        v = u @ (np.eye(3) + x[:9].reshape(3, 3)).T
        jacobian = 2 * (v[:, :, None] * u[:, None, :]).reshape(30, 9)
        jacobian = np.hstack([jacobian, np.zeros((30, len(names) - 9))])
        return np.sum(u**2, axis=-1) - np.sum(v**2, axis=-1), jacobian

    turns = np.zeros((3, len(names)))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        turns[k, 3 * i + j], turns[k, 3 * j + i] = 1.0, -1.0
    return Problem(
        names,
        np.zeros(len(names)),
        linearise,
        np.full(30, 1e-3),
        np.full(len(names), 0.01),
        known_nulls=(("rotation of the frame", lambda _: turns),),
    )


def test_known_null_directions_come_first_by_their_name():
    directions = refused(norms())
    assert directions == (
        "rotation of the frame: xy − yx (in units of their typical size)",
        "rotation of the frame: xz − zx (in units of their typical size)",
        "rotation of the frame: yz − zy (in units of their typical size)",
        "spare",
    )


def test_a_gauge_removes_what_it_fixes():
    names = norms(extra=False).names
    gauge = Gauge("lower triangular", ("xy", "xz", "yz"), np.eye(3), np.zeros(3))
    problem = norms(extra=False)
    fixed = Problem(
        names, problem.start, problem.linearise, problem.noise, problem.scale, gauges=(gauge,)
    )
    estimate = least_squares(fixed)
    assert estimate.rank == 6
    assert len(estimate.singular_values) == 6
    assert estimate.null_directions == ()
    assert_allclose(estimate.value[[1, 2, 5]], 0, atol=1e-15)


def test_a_long_direction_lists_its_largest_parameters():
    names = tuple(f"p{i}" for i in range(10))
    weights = 1.0 - 0.05 * np.arange(10.0)
    design = np.linalg.svd(weights[None])[2][1:]
    (words,) = refused(flat(names, design))
    assert words == (
        "p0 + 0.95 p1 + 0.9 p2 + 0.85 p3 + 0.8 p4 + 0.75 p5 and 4 more"
        " (in units of their typical size)"
    )


def test_nothing_observed_at_all_is_refused():
    assert refused(flat(("a", "b"), np.zeros((3, 2)))) == ("a", "b")
