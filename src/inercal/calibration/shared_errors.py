"""What calibrations of one bench have in common: errors of it that last beyond one run.

A parameter q of the bench is known beforehand as q₀ ± u_q, and no run measures it anew: the radius
of an arm, local gravity, the azimuth of a base. The coefficients c are estimated with it, and to
first order move with the value that was stated::

    J = ∂c/∂q₀,    P_cq = cov(c − c_true, q₀ − q_true) = J u_q²

P_cq is the column of the joint covariance of coefficients and parameter where both are estimated.
If the true value lies δ above the stated one, the coefficients come out −J δ from where they
should. Calibrations i and j that rest on the same determination of q are correlated by it, and what
remains of each is its own::

    cov(c_i, c_j) = Σ_q P_i P_jᵀ / u_q²,    own_i = cov(c_i) − Σ_q P_i P_iᵀ / u_q²

A Birge ratio enlarges cov(c), and so what is own, but not P: residuals that are too large say
nothing of q₀, and J = P / u_q² stays the derivative.

Source: JCGM 102:2011 (GUM Supplement 2), 6.2; JCGM 100:2008, F.1.2.3 (common influences).
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError


@dataclass(frozen=True, eq=False)
class SharedError:
    """An error of the bench that other calibrations may have too.

    Parameters
    ----------
    name : str
        Of the bench's parameter, "radius".
    unit : str
        Of the parameter, SI.
    std : float
        Standard deviation u_q as it was stated, in the unit.
    covariance : (p,) array
        P_cq of the p coefficients, SI times the unit.
    determination : str
        What is alike in calibrations that rest on one determination of the value; SHA-256.
    date : str or None
        Of the determination, ISO 8601; None where it is not known.

    Raises
    ------
    InputError
        A deviation that is not positive, or a value that is not finite.
    """

    name: str
    unit: str
    std: float
    covariance: Array
    determination: str
    date: str | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.std) and self.std > 0):
            raise InputError(f"shared {self.name}: standard deviation is {self.std}; give it > 0")
        if self.covariance.ndim != 1 or not np.isfinite(self.covariance).all():
            raise InputError(f"shared {self.name}: a covariance is not finite, or no list")

    @property
    def sensitivity(self) -> Array:
        """J = ∂c/∂q₀ of each coefficient, (p,): SI per unit."""
        return self.covariance / self.std**2

    def transform(self, jacobian: Array) -> "SharedError":
        """Return the error of other coefficients, whose derivatives by these are (q, p)."""
        return replace(self, covariance=jacobian @ self.covariance)


SharedErrors = tuple[SharedError, ...] | None


def transform_shared(shared: SharedErrors, jacobian: Array) -> SharedErrors:
    """Return the errors of other coefficients; None stays not known."""
    return None if shared is None else tuple(one.transform(jacobian) for one in shared)
