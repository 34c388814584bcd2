"""Bring a problem to the form that solvers need: whitened, with priors as rows, gauges as a basis.

The free coordinates t determine the parameters through x = x₀ + B t. Without gauges B is the
identity. With gauges C x = d its columns span the null space of C (scaled), so every x satisfies
the gauges exactly. Internally all arrays have a trials dimension; a problem without one has a
single trial.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from inercal.basics.arrays import Array, row_products
from inercal.basics.errors import InputError
from inercal.estimation.problem import Problem, cholesky


def column_lengths(matrix: Array) -> Array:
    """Return the length of each column of (..., m, n) matrices; a length of 0 is replaced by 1."""
    size = np.linalg.norm(matrix, axis=-2)
    return np.where(size > 0, size, 1.0)


def svd(matrix: Array, *, full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ of a finite matrix, (m, n).

    LAPACK's divide-and-conquer algorithm (gesdd) fails for rare matrices with very small numbers.
    Its older algorithm (gesvd) is slower but does not fail.
    """
    try:
        return np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        import scipy.linalg

        found = scipy.linalg.svd(matrix, full_matrices=full_matrices, lapack_driver="gesvd")
        return cast("tuple[Array, Array, Array]", found)


def svds(matrices: Array) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ, without columns of zero weight, of finite matrices, (..., m, n).

    A single column needs no algorithm, and most candidates of a score test have one component.
    """
    if matrices.shape[-1] == 1:
        length = np.linalg.norm(matrices, axis=-2)
        unit = matrices / np.where(length > 0, length, 1.0)[..., None]
        return unit, length, np.ones((*length.shape, 1))
    try:
        return np.linalg.svd(matrices, full_matrices=False)
    except np.linalg.LinAlgError:
        flat = matrices.reshape(-1, *matrices.shape[-2:])
        parts = zip(*(svd(one, full_matrices=False) for one in flat), strict=True)
        u, s, v = (np.array(part).reshape(*matrices.shape[:-2], *part[0].shape) for part in parts)
        return u, s, v


class LinearisationPoint(NamedTuple):
    """The problem linearised at x; all arrays have a trials dimension.

    Rows and weights that all trials share have length 1 in this dimension, so that they are not
    copied.
    """

    x: Array  # (trials, p)
    residual: Array  # y − h(x), (trials, m)
    rows: Array  # ∂h/∂t, (1 or trials, m, k), decorrelated if the noise is correlated
    weight: Array  # factor that whitens each row, (1 or trials, m)
    whitened: Array  # whitened residual, (trials, m)
    prior: Array  # whitened μ − x, (trials, b)

    def of_trial(self, k: int) -> "LinearisationPoint":
        """Return the point of one trial."""
        return LinearisationPoint(*(a[k : k + 1] if len(a) > 1 else a for a in self))


class Whitener(NamedTuple):
    """Whitening: 1/sd, (1 or trials, m), or inverse Cholesky factors, (1 or trials, m, m)."""

    inverse: Array
    full: bool

    def of_trial(self, k: int) -> "Whitener":
        """Return the whitening of one trial."""
        return self if len(self.inverse) == 1 else Whitener(self.inverse[k : k + 1], self.full)

    def whiten(self, rows: Array) -> Array:
        """Whiten changes of the observations, (m, q) or (trials, m, q)."""
        return self.inverse @ rows if self.full else self.inverse[..., None] * rows


class WhitenedProblem:
    """A checked and whitened problem.

    Parameters
    ----------
    problem : Problem
        The problem. It is linearised once, at its start, to check it and to find m and the number
        of trials.

    Raises
    ------
    InputError
        Shapes, noise, gauges or values at the start are invalid.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        p = len(problem.names)
        self.basis, start = gauge_basis(problem)
        self.prior_full, self.prior_rows, targets = prior_equations(problem, self.basis)

        with np.errstate(all="ignore"):
            residual, jacobian = problem.linearise(start)
        leads = [a.shape[:-1] for a in (start, residual, *targets)]
        leads.append(jacobian.shape[:-2])
        if any(len(lead) > 1 for lead in leads):
            raise InputError(
                f"start, residual, Jacobian and priors have the leading shapes {leads}; give at "
                "most one leading dimension, for the trials"
            )
        try:
            lead = np.broadcast_shapes(*leads)
        except ValueError:
            raise InputError(
                f"start, residual, Jacobian and priors have {sorted(set(leads))} trials; give each"
                " the same number",
                key="start",
            ) from None
        self.single = lead == ()
        self.trials = 1 if self.single else lead[0]
        self.m = residual.shape[-1]
        self.dof = self.m + len(self.prior_rows) - self.free
        if problem.observations and len(problem.observations) != self.m:
            raise InputError(
                f"{len(problem.observations)} labels for {self.m} observations; give one for each",
                key="observations",
            )
        if jacobian.shape[-2:] != (self.m, p):
            raise InputError(
                f"linearise returned a Jacobian of shape {jacobian.shape}; expected (..., "
                f"{self.m}, {p})",
                key="linearise",
            )
        require_finite(residual, jacobian)

        self.prior_target = prior_targets(targets, self.trials)
        self.start = np.broadcast_to(start, (self.trials, p))
        noise = problem.noise(start) if callable(problem.noise) else problem.noise
        self.first_whitener = self._whitener(noise)
        self.first = self.point(
            self.start, *self._with_trials(residual, jacobian), self.first_whitener
        )
        # Observability takes priors of nuisances into account, but not priors of wanted parameters.
        known = [prior.marginal(problem.nuisances) for prior in problem.priors]
        nuisance = [prior.rows(problem.names)[0] for prior in known if prior]
        self.nuisance_rows = np.concatenate([np.zeros((0, p)), *nuisance])

    @property
    def free(self) -> int:
        """Number of free coordinates, k = p − gauge rows."""
        return len(self.problem.names) if self.basis is None else self.basis.shape[1]

    @property
    def constant_noise(self) -> bool:
        """Whether the weights are the same at every point."""
        return not callable(self.problem.noise)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the residual (trials, m) and Jacobian (1 or trials, m, p) at x (trials, p)."""
        # Far from the solution a model may overflow; the search rejects such a point by its cost.
        with np.errstate(all="ignore"):
            residual, jacobian = self.problem.linearise(x[0] if self.single else x)
        return self._with_trials(residual, jacobian)

    def point(
        self, x: Array, residual: Array, jacobian: Array, whitener: Whitener | None = None
    ) -> LinearisationPoint:
        """Whiten a linearisation at x, with the noise at x unless another whitening is given."""
        inverse, full = whitener or self.whitener(x)
        rows = jacobian if self.basis is None else jacobian @ self.basis
        if full:
            with np.errstate(all="ignore"):
                rows, weight = inverse @ rows, np.ones((1, self.m))
                whitened = (inverse @ residual[..., None])[..., 0]
        else:
            # The rows are not copied: in a large batch a copy costs as much as the model.
            weight, whitened = inverse, inverse * residual
        prior = self.prior_target - row_products(x, self.prior_full.T)
        return LinearisationPoint(x, residual, rows, weight, whitened, prior)

    def whitener(self, x: Array) -> Whitener:
        """Return the whitening for the noise at x (trials, p)."""
        if not callable(self.problem.noise):
            return self.first_whitener
        return self._whitener(self.problem.noise(x[0] if self.single else x))

    def _with_trials(self, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        residual = np.broadcast_to(residual, (self.trials, self.m))
        return residual, jacobian if jacobian.ndim == 3 else jacobian[None]

    def _whitener(self, noise: Array) -> Whitener:
        m, leads = self.m, ((), (1,), (self.trials,))
        if self.problem.correlated:
            if noise.shape[-2:] != (m, m) or noise.shape[:-2] not in leads:
                raise self._noise_shape_error(noise, f"a covariance (..., {m}, {m})")
            inverse = np.asarray(np.linalg.inv(cholesky(noise, "noise")), dtype=float)
            return Whitener(inverse.reshape(-1, m, m), full=True)
        if noise.shape[-1:] != (m,) or noise.shape[:-1] not in leads:
            raise self._noise_shape_error(noise, f"standard deviations (..., {m})")
        if not np.all(np.isfinite(noise) & (noise > 0)):
            bad = int(np.flatnonzero(~(np.isfinite(noise) & (noise > 0)))[0]) % m
            raise noise_error(self.problem, bad)
        return Whitener(1 / noise.reshape(-1, m), full=False)

    def _noise_shape_error(self, noise: Array, expected: str) -> InputError:
        return InputError(
            f"noise has shape {noise.shape}; expected {expected}, with no leading dimension, or "
            f"with one of length 1 or {self.trials}",
            key="noise",
        )


def prior_equations(problem: Problem, basis: Array | None) -> tuple[Array, Array, list[Array]]:
    """Return all priors' whitened rows, in x and in free coordinates, and their targets."""
    rows = [prior.rows(problem.names) for prior in problem.priors]
    full = np.concatenate([np.zeros((0, len(problem.names))), *(one for one, _ in rows)])
    return full, full if basis is None else full @ basis, [target for _, target in rows]


def prior_targets(targets: Sequence[Array], trials: int) -> Array:
    """Return the whitened prior means for all priors, (trials, b)."""
    whole = [np.broadcast_to(one, (trials, one.shape[-1])) for one in targets]
    return np.concatenate([np.zeros((trials, 0)), *whole], axis=-1)


def require_finite(*values: Array) -> None:
    """Raise an error if residuals or derivatives at the start are not finite."""
    if not all(np.isfinite(one).all() for one in values):
        raise InputError(
            "a residual or a derivative of the model is not finite at the start values; "
            "check the readings and the stated values for extreme numbers",
            key="linearise",
        )


def noise_error(problem: Problem, bad: int) -> InputError:
    """Return the error for the invalid noise of the observation with this index."""
    label = problem.observations[bad] if problem.observations else f"{bad}"
    return InputError(
        f"the standard deviation of observation {label} is not positive; give one above 0",
        key="noise",
        names=(label,),
    )


def gauge_basis(problem: Problem) -> tuple[Array | None, Array]:
    """Return the basis B (p, k) of moves allowed by the gauges, and a start that satisfies them."""
    if not problem.gauges:
        return None, problem.start
    matrix = np.concatenate([gauge.rows(problem.names) for gauge in problem.gauges])
    value = np.concatenate([gauge.value for gauge in problem.gauges])
    # Rows of C·scale, normalised to length 1, so that the rank does not depend on units.
    scaled = matrix * problem.scale
    size = np.linalg.norm(scaled, axis=1)
    if not np.all(size > 0):
        raise InputError("a row of a gauge's matrix is zero; remove the row", key="gauge")
    left, singular, right = svd(scaled / size[:, None])
    q = len(value)
    if q > len(problem.names) or singular[q - 1] < 1e-10:
        words = tuple(gauge.words for gauge in problem.gauges)
        raise InputError(
            f"gauges {'; '.join(words)} are not independent; remove one of them",
            key="gauge",
            names=words,
        )
    short = (value - problem.start @ matrix.T) / size
    move = ((short @ left) / singular) @ right[:q] * problem.scale
    return problem.scale[:, None] * right[q:].T, problem.start + move
