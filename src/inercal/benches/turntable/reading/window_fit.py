"""Compute the weighted residuals of several gyros in one window, in linear time.

The noise of n increments has a tridiagonal covariance T = L D Lᵀ, and the parameters add C P Cᵀ.
With A = D^−½ L⁻¹ C P^½, and Q the upper part of the orthogonal factor in [A; 1] = Q R, the inverse
of the sum is W = T⁻¹ − B Bᵀ, where B = L⁻ᵀ D^−½ Q. No n × n matrix is formed, and no digits are
lost if C P Cᵀ is much larger than T.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

import numpy as np
import scipy.linalg

from inercal.basics.arrays import Array

LEAST_LEFT = 1e-9  # times the information with only noise: less is a rounding error


class WindowFit:
    """The weighted residuals in one window, and the information that they contain.

    Parameters
    ----------
    variance, between : (g, n) and (g, n − 1) arrays
        Diagonal and off-diagonal of the noise's tridiagonal covariance, rad².
    residual : (g, n) array
        Residuals, rad.
    columns : (g, n, q) array
        Change of the residuals for one standard deviation of each parameter.

    Attributes
    ----------
    triangle : (g, q, q) array
        The matrix R defined in the module.
    known : (g, n, q) array
        The matrix B defined in the module.
    explained : (g, q) array
        Qᵀ D^−½ L⁻¹ times the residuals.
    weighted : (g, n) array
        W times the residuals.
    of_noise, information : (g, n) arrays
        Diagonals of T⁻¹ and of W.
    neighbours : (g, n − 1) array
        Elements of W next to its diagonal.
    """

    def __init__(self, variance: Array, between: Array, residual: Array, columns: Array):
        # The covariances of all gyros together form one tridiagonal matrix.
        beside = np.zeros(variance.shape)
        beside[:, :-1] = between
        self._factor = _Bidiagonal(variance.ravel(), beside.ravel()[:-1])
        (g, n, q), size = columns.shape, variance.size
        white = self._factor.whitened(
            np.concatenate([columns, residual[..., None]], axis=-1).reshape(size, -1)
        ).reshape(g, n, -1)
        stacked = np.zeros((g, n + q, q))
        stacked[:, :n] = white[..., :-1]
        stacked[:, np.arange(n, n + q), np.arange(q)] = 1.0
        orthogonal, self.triangle = np.linalg.qr(stacked)
        self._span = orthogonal[:, :n]
        self.explained = np.einsum("gnq,gn->gq", self._span, white[..., -1])
        left = white[..., -1] - np.einsum("gnq,gq->gn", self._span, self.explained)
        back = self._factor.unwhitened(
            np.concatenate([self._span, left[..., None]], axis=-1).reshape(size, -1)
        ).reshape(g, n, -1)
        self.known, self.weighted = back[..., :-1], back[..., -1]
        self.of_noise = self._factor.inverse_diagonal.reshape(g, n)
        self.information = self.of_noise - np.einsum("gnq,gnq->gn", self.known, self.known)
        beside.ravel()[:-1] = self._factor.inverse_neighbours
        self.neighbours = beside[:, :-1] - np.einsum(
            "gnq,gnq->gn", self.known[:, 1:], self.known[:, :-1]
        )

    def later(self, values: Array) -> Array:
        """Multiply (g, n, k) values by the part of T⁻¹ above its diagonal."""
        return self._factor.later(values.reshape(-1, values.shape[-1])).reshape(values.shape)

    def quadratic(self, signature: Array) -> float:
        """Return sᵀ W s for (g, n) values s, or 0 if it is only a rounding error."""
        white = self._factor.whitened(signature.reshape(-1, 1)).reshape(signature.shape)
        explained = np.einsum("gnq,gn->gq", self._span, white)
        left = float(np.sum(white**2) - np.sum(explained**2))
        return left if left > LEAST_LEFT * float(np.sum(white**2)) else 0.0


class _Bidiagonal:
    """The factors L D Lᵀ of a tridiagonal covariance T, where L has ones on its diagonal.

    Parameters
    ----------
    variance, between : (n,) and (n − 1,) arrays
        The diagonal of T, and the elements next to it.
    """

    def __init__(self, variance: Array, between: Array):
        pttrf, self._solve = scipy.linalg.get_lapack_funcs(("pttrf", "tbtrs"), (variance,))
        diagonal, self._below, wrong = pttrf(variance, between)
        if wrong:
            raise np.linalg.LinAlgError("the covariance is not positive definite")
        self._root = np.sqrt(diagonal)[:, None]
        self._band = np.ones((2, variance.size))
        self._band[1, :-1] = self._below
        inverse = (1.0 / diagonal)[:, None]
        squares = np.ones((2, variance.size))
        squares[1, :-1] = -(self._below**2)
        self.inverse_diagonal: Array = self._solved(squares, inverse, "T")[:, 0]
        self.inverse_neighbours: Array = -self._below * self.inverse_diagonal[1:]

    def whitened(self, values: Array) -> Array:
        """Multiply (n, k) values by D^−½ L⁻¹."""
        return self._solved(self._band, values, "N") / self._root

    def unwhitened(self, values: Array) -> Array:
        """Multiply (n, k) values by L⁻ᵀ D^−½."""
        return self._solved(self._band, values / self._root, "T")

    def later(self, values: Array) -> Array:
        """Multiply (n, k) values by the part of T⁻¹ above its diagonal."""
        right = np.zeros_like(values)
        right[:-1] = self.inverse_neighbours[:, None] * values[1:]
        return self._solved(self._band, right, "T")

    def _solved(self, band: Array, right: Array, transposed: str) -> Array:
        """Solve L x = right, or Lᵀ x = right if `transposed` is "T"."""
        return self._solve(band, right, uplo="L", trans=transposed, diag="U")[0]
