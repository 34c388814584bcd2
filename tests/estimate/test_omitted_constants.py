"""What a filter leaves out, against generalised least squares on all of its observations."""

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.estimation import Candidate, score_tests
from inercal.estimation.candidate_scores import rows_from_products
from inercal.estimation.kalman import FilterSteps, predict, update
from inercal.estimation.omitted_constants import OmittedSums, omitted_constant_sums

Array = NDArray[np.float64]
N, K, M, EPOCHS = 6, 2, 3, 8  # states, driven ones, observations, epochs
LOST = 4  # the epoch at which nothing is observed and the driven states begin anew
DRIVING, OBSERVED, ROW = 3, 2, 1
COUNT = DRIVING + OBSERVED + 1  # one more is a state that departs from what was known

NONE = np.zeros((0, 0))  # of the states none is wanted


class SimulatedErrors:
    """A random system, with columns that drive its first states and columns that are observed."""

    def __init__(self, seed: int):
        rng = np.random.default_rng([seed, 19])
        self.prior = np.diag(rng.uniform(0.5, 2.0, N)) + 0.3
        self.a = rng.standard_normal((EPOCHS, K, N))
        self.a[LOST] = 0.0
        self.keep = np.ones((EPOCHS, N))
        self.keep[:, K] = 0.8
        self.noise = np.array([[0.9, 0.2], [0.2, 0.5]])
        self.drawn = np.zeros(N)
        self.drawn[K] = 0.3
        self.h = rng.standard_normal((EPOCHS, M, N))
        self.r = rng.uniform(0.1, 1.0, M)
        self.driven = rng.standard_normal((EPOCHS, K, COUNT))
        self.driven[:, :, DRIVING:] = 0.0
        self.driven[LOST] = 0.0
        self.seen = rng.standard_normal((EPOCHS, M - ROW, COUNT))
        self.seen[:, :, :DRIVING] = self.seen[:, :, -1] = 0.0
        self.start = np.zeros((N, COUNT))
        self.start[N - 1, -1] = 1.0

    def transition(self, e: int) -> Array:
        phi = np.diag(self.keep[e])
        phi[:K] = self.a[e]
        return phi

    def filtered(self, z: Array) -> tuple[Array, OmittedSums]:
        """Return the last estimate, and what the recursion says, of observations (e, m)."""
        zero = np.zeros
        made = FilterSteps(
            self.a, self.keep, self.h.copy(), zero((EPOCHS, M, N)), zero((EPOCHS, M)),
            zero((EPOCHS, M)), NONE, zero((EPOCHS, 0, N)),
        )  # fmt: skip
        x, p = np.zeros(N), self.prior.copy()
        for e in range(EPOCHS):
            x = self.transition(e) @ x
            predict(p, self.a[e], self.keep[e], self.noise, self.drawn, np.empty_like(self.a[e]))
            for k in range(M if e != LOST else 0):
                made.off[e, k], made.s[e, k] = update(
                    x, p, self.h[e, k], z[e, k], self.r[k], made.gain[e, k]
                )
        # The last column acts through its state: whether it counts as driving is nothing to it.
        driving = [*range(DRIVING), COUNT - 1]
        order = [*driving, *range(DRIVING, COUNT - 1)]
        found = omitted_constant_sums(
            [(made, self.driven[:, :, driving], self.seen[:, :, DRIVING : COUNT - 1])],
            self.start[:, order], 0, ROW,
        )  # fmt: skip
        back = np.argsort(order)
        return x, OmittedSums(
            found.gram[np.ix_(back, back)], found.product[back], found.moved[:, back]
        )

    def whole(self) -> tuple[Array, Array, Array, Array]:
        """Return V of all observations, their columns C, the gain of the last state, its columns.

        Observations that were not made are left out.
        """
        joint, mean = np.zeros((EPOCHS, N, EPOCHS, N)), np.zeros((EPOCHS, N, COUNT))
        p, now = self.prior, self.start
        for e in range(EPOCHS):
            phi, q = self.transition(e), np.diag(self.drawn)
            q[:K, :K] = self.noise
            p, now = phi @ p @ phi.T + q, phi @ now
            now[:K] += self.driven[e]
            mean[e] = now
            for before in range(e):
                joint[e, :, before] = phi @ joint[e - 1, :, before]
                joint[before, :, e] = joint[e, :, before].T
            joint[e, :, e] = p
        kept = [e for e in range(EPOCHS) if e != LOST]
        c = np.einsum("emn,enc->emc", self.h, mean)
        c[:, ROW:] += self.seen
        between = np.einsum("nfk,fmk->nfm", joint[-1], self.h)[:, kept]
        v = np.einsum("emn,enfk,fik->emfi", self.h, joint, self.h)[kept][:, :, kept]
        size = M * len(kept)
        noise = np.diag(np.tile(self.r, len(kept)))
        v = v.reshape(size, size) + noise
        gain = between.reshape(N, size) @ np.linalg.inv(v)
        return v, c[kept].reshape(size, COUNT), gain, mean[-1]


@pytest.mark.parametrize("seed", range(5))
def test_sums_and_shifts_are_those_of_all_observations_at_once(seed: int):
    drawn = SimulatedErrors(seed)
    v, c, gain, mean = drawn.whole()
    z = np.random.default_rng(seed).standard_normal((EPOCHS, M))
    _, found = drawn.filtered(z)
    made = np.delete(z, LOST, axis=0).ravel()
    inverse = np.linalg.inv(v)
    np.testing.assert_allclose(found.gram, c.T @ inverse @ c, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.product, c.T @ inverse @ made, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.moved, gain @ c - mean, rtol=1e-9, atol=1e-9)


def test_a_filter_that_errs_by_a_constant_has_it_as_its_score():
    drawn, q = SimulatedErrors(7), np.array([0.7, -0.4, 0.2, 1.1, -0.3, 0.5])
    _, c, _, _ = drawn.whole()
    z = np.zeros((EPOCHS, M))
    z[[e for e in range(EPOCHS) if e != LOST]] = (c @ q).reshape(-1, M)
    x, found = drawn.filtered(z)
    residual, rows = rows_from_products(found.gram, found.product)
    names = tuple(f"q{k}" for k in range(COUNT))
    all_of_them = Candidate("q", "coefficient", names, ("1",) * COUNT, rows, found.moved)
    (score,) = score_tests(residual, np.zeros((len(residual), 0)), [all_of_them]).scores
    np.testing.assert_allclose(score.size, q, rtol=1e-7)
    assert score.dof == COUNT
    # The states that nothing drives are truly zero: the estimate is their shift.
    np.testing.assert_allclose(score.shift[K : N - 1], x[K : N - 1], rtol=1e-6)
    assert score.shift[N - 1] == pytest.approx(x[N - 1] - q[-1], rel=1e-6)


def test_observations_that_do_not_count_still_correct_the_states():
    drawn = SimulatedErrors(3)
    z = np.random.default_rng(3).standard_normal((EPOCHS, M))
    zero = np.zeros
    steps = FilterSteps(
        drawn.a, drawn.keep, drawn.h, zero((EPOCHS, M, N)), zero((EPOCHS, M)), zero((EPOCHS, M)),
        NONE, zero((EPOCHS, 0, N)),
    )  # fmt: skip
    x, p = np.zeros(N), drawn.prior.copy()
    for e in range(EPOCHS):
        x = drawn.transition(e) @ x
        predict(p, drawn.a[e], drawn.keep[e], drawn.noise, drawn.drawn, np.empty_like(drawn.a[e]))
        for k in range(M if e != LOST else 0):
            steps.off[e, k], steps.s[e, k] = update(
                x, p, drawn.h[e, k], z[e, k], drawn.r[k], steps.gain[e, k]
            )
    pieces = [(steps, drawn.driven[:, :, :DRIVING], zero((EPOCHS, 2, 0)))]
    start = drawn.start[:, :DRIVING]
    whole = omitted_constant_sums(pieces, start, 0, ROW)
    some = omitted_constant_sums(pieces, start, 0, ROW, 2)
    np.testing.assert_array_equal(whole.moved, some.moved)
    least = np.linalg.eigvalsh(whole.gram - some.gram)[0]
    assert least > -1e-9
    assert np.trace(some.gram) < np.trace(whole.gram)
