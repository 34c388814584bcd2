"""Errors of estimates of many devices, and whether they are as large as stated."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from inercal.estimation import Estimate

Array = NDArray[np.float64]
_TRUTH = {"k0": "bias", "k1": "scale"}


def errors(
    truth: Mapping[str, Array], found: Estimate, names: Sequence[str] | None = None
) -> tuple[Array, Array]:
    """Return errors (n, p) and the covariance (n, p, p) of the coefficients.

    Parameters
    ----------
    truth : mapping of str to (n, m) array
        True coefficients of the m axes, by name.
    found : Estimate
        Estimate of n devices.
    names : sequence of str, optional
        Coefficients to compare, instead of all that were wanted.
    """
    if names is None:
        names = [name for name in found.names if name in found.wanted]
    at = [found.names.index(name) for name in names]
    axes = list(dict.fromkeys(name.split(".")[0] for name in names))
    true = [
        truth[_TRUTH.get(term, term)][:, axes.index(axis)]
        for axis, term in (name.split(".") for name in names)
    ]
    covariance = found.covariance[..., at, :][..., at]
    off = np.atleast_2d(found.value)[:, at] - np.stack(true, axis=-1)
    return off, np.broadcast_to(covariance, (*off.shape, len(at)))


def require_stated_accuracy(off: Array, covariance: Array) -> None:
    """Require NEES and coverage of U of n devices, each as stated or within a 99.9 % band."""
    p, n = off.shape[1], len(off)
    nees, within = accuracy(off, covariance)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], n * p) / (n * p)
    assert min(low, 0.95) < nees < max(high, 1.05)
    # Coefficients of a device share the errors of the bench: its devices are what is independent.
    low, high = binom.ppf([5e-4, 1 - 5e-4], n, 0.9545) / n
    assert min(low, 0.94) < within < max(high, 0.97)


def accuracy(off: Array, covariance: Array) -> tuple[float, float]:
    """Return the NEES per coefficient and the share of errors within two standard deviations."""
    whitened = np.linalg.solve(covariance, off[..., None])[..., 0]
    nees = float((off * whitened).sum(axis=-1).mean() / off.shape[1])
    within = np.abs(off) < 2 * np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return nees, float(within.mean())
