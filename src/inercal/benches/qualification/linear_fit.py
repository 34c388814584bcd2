"""Fit a qualification by generalised least squares, and test the model by its residuals.

    y = H x + e,   e ~ N(0, V):   x = P Hᵀ V⁻¹ y,   P = (Hᵀ V⁻¹ H)⁻¹,   χ² = rᵀ V⁻¹ r

A missing term is found from the reduction of χ² that it would give, Δχ² = sᵀ S⁻¹ s, with the score
s = Cᵀ V⁻¹ r of its columns C and S = Cᵀ (V⁻¹ − V⁻¹ H P Hᵀ V⁻¹) C. The tests share one significance
level in the same way as the tests of a calibration (`inercal.estimation.scores`). The terms get 0.8
of it, divided by their number (Bonferroni), and χ² gets the rest, or all of it if no term is
tested. If χ² exceeds its 95 % bound, covariances are enlarged by χ²/ν, as in a calibration.

`MeasuredParameters` are the parameters that a measurement of a bench determines by such a fit.
"""
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL

_ENLARGING_LEVEL = 0.05  # p-value of χ² below which covariances are enlarged


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The solution of a generalised least-squares fit.

    Parameters
    ----------
    value : (p,) array
    covariance : (p, p) array
        Covariance of the values, enlarged by χ²/ν if χ² exceeds its bound.
    chi2, dof
        χ² of the residuals and its degrees of freedom.
    suspects : tuple of str
        Terms that are missing in the model. If χ² rejects the model and no term explains it, a
        statement that says so.
    """

    value: Array
    covariance: Array
    chi2: float
    dof: int
    suspects: tuple[str, ...] = ()

    @property
    def p_value(self) -> float:
        """Probability of a χ² at least as large; 1 if there are no degrees of freedom."""
        return float(special.chdtrc(self.dof, self.chi2)) if self.dof > 0 else 1.0


def readings_error(text: str) -> InputError:
    """Return the error for readings that are not sufficient or not possible."""
    return InputError(text, key="[measurement] file")


def linear_fit(
    columns: Array,
    y: Array,
    noise: Array,
    missing: Mapping[str, Array] | None = None,
    unseen: str = "",
    level: float = SIGNIFICANCE_LEVEL,
) -> LinearFit:
    """Fit y by a linear combination of columns, with noise of known covariance.

    Parameters
    ----------
    columns : (n, p) array
    y : (n,) array
    noise : (n,) or (n, n) array
        Standard deviations of the noise, or its covariance.
    missing : mapping of str to (n, q) array, optional
        Columns of terms that may be missing in the model, by the text of their message.
    unseen : str
        Advice for the error message if the columns do not determine all unknowns.
    level : float, optional
        Significance level of all tests of the fit together. It is smaller if a measurement makes
        further tests.

    Raises
    ------
    InputError
        The columns are not independent, or there are fewer rows than columns.
    """
    covariance = np.diag(noise**2) if noise.ndim == 1 else noise
    root: Array = np.asarray(np.linalg.cholesky(covariance), dtype=float)
    white: Array = np.asarray(np.linalg.solve(root, y), dtype=float)
    rows: Array = np.asarray(np.linalg.solve(root, columns), dtype=float)
    size = np.linalg.norm(rows, axis=0)
    p = columns.shape[1]
    if len(y) < p or np.linalg.matrix_rank(rows / np.where(size > 0, size, 1.0), 1e-9) < p:
        raise readings_error(
            f"{len(y)} readings do not determine the {p} unknowns: "
            f"{unseen or 'measure at more positions'}",
        )
    scaled = rows / size
    inverse: Array = np.asarray(np.linalg.inv(scaled.T @ scaled), dtype=float)
    value: Array = inverse @ (scaled.T @ white) / size
    cov = inverse / np.outer(size, size)
    residual = white - rows @ value
    chi2, dof = float(residual @ residual), len(y) - p
    tested = _missing_terms(rows, cov, residual, root, missing or {})
    of_terms = SCORE_TEST_SHARE * level if tested else 0.0
    suspects = tuple(
        words.format(size=size) for words, size, p in tested if len(tested) * p < of_terms
    )
    fit = LinearFit(value, cov, chi2, dof, suspects)
    if not suspects and fit.p_value < level - of_terms:
        words = (
            f"χ² is {chi2:.4g} with {dof} degrees of freedom: the noise is larger than stated, "
            "or the model is incomplete"
        )
        fit = replace(fit, suspects=(words,))
    if fit.p_value < _ENLARGING_LEVEL:
        return replace(fit, covariance=cov * max(1.0, chi2 / dof))
    return fit


def _missing_terms(
    rows: Array, covariance: Array, residual: Array, root: Array, missing: Mapping[str, Array]
) -> list[tuple[str, float, float]]:
    """Return the missing terms that can be tested, with their sizes and p-values."""
    found: list[tuple[str, float, float]] = []
    for words, columns in missing.items():
        white: Array = np.asarray(np.linalg.solve(root, columns), dtype=float)
        beyond = white - rows @ (covariance @ (rows.T @ white))
        information = white.T @ beyond
        scale = np.sqrt(np.maximum(np.diagonal(white.T @ white), 1e-300))
        if np.linalg.eigvalsh(information / np.outer(scale, scale))[0] < 1e-9:
            continue
        score = white.T @ residual
        gain = float(score @ np.linalg.solve(information, score))
        size = float(np.linalg.norm(np.linalg.solve(information, score)))
        found.append((words, size, float(special.chdtrc(columns.shape[1], gain))))
    return found


@dataclass(frozen=True, eq=False)
class MeasuredParameters(LinearFit):
    """Parameters of a bench that a measurement determines.

    Parameters
    ----------
    value, covariance, chi2, dof, suspects
        See `LinearFit`; the k values are those of the parameters.
    names : tuple of k str
        Names of the bench's parameters.
    unit : tuple of k str
        SI units.
    unseen : tuple of str
        Effects that the measurement cannot detect.
    remarks : tuple of str
    """

    names: tuple[str, ...] = ()
    unit: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def from_fit(
    fit: LinearFit,
    names: tuple[str, ...],
    unit: str | tuple[str, ...],
    value: Array,
    covariance: Array,
    unseen: tuple[str, ...] = (),
    remarks: tuple[str, ...] = (),
) -> MeasuredParameters:
    """Return parameters, which may share one unit, with the test results of a fit."""
    units = (unit,) * len(names) if isinstance(unit, str) else unit
    tests = fit.chi2, fit.dof, fit.suspects
    return MeasuredParameters(value, covariance, *tests, names, units, unseen, remarks)
