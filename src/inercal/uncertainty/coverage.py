"""Expanded uncertainty U = k u: the coverage factor (GUM G.3, table G.2)."""
# pyright: reportMissingTypeStubs=false

import numpy as np
from scipy.special import ndtri, stdtrit


def coverage_factor(dof: float = np.inf, probability: float = 0.9545) -> float:
    """Return k such that ± k u holds the value with this probability.

    Parameters
    ----------
    dof : float, optional
        Degrees of freedom of u, positive; infinite where u is known.
    probability : float, optional
        Between 0 and 1; the default gives k = 2.00 for infinite degrees of freedom.
    """
    upper = (1 + probability) / 2
    return float(ndtri(upper) if np.isinf(dof) else stdtrit(dof, upper))
