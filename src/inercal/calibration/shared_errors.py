"""Describe the bench errors that several calibrations share because they outlast a run.

A parameter q of the bench is stated as q₀ ± u_q, and no run measures it again. Examples are the
radius of an arm, local gravity and the azimuth of a base. The coefficients c are estimated with
this value. To first order, they change with the stated value::

    J = ∂c/∂q₀,    P_cq = cov(c − c_true, q₀ − q_true) = J u_q²

If coefficients and parameter are both estimated, P_cq is the column for q in their joint
covariance. If the true value is δ above the stated value, the error of the coefficients is −J δ.
Calibrations i and j with the same determination of q are correlated because of q, and the rest of
their errors is independent::

    cov(c_i, c_j) = Σ_q P_i P_jᵀ / u_q²,    own_i = cov(c_i) − Σ_q P_i P_iᵀ / u_q²

A Birge ratio increases cov(c), and therefore the independent part, but not P. The reason is that
large residuals contain no information about q₀, and J = P / u_q² must remain the derivative.

Source: JCGM 102:2011 (GUM Supplement 2), 6.2; JCGM 100:2008, F.1.2.3 (common influences).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError


@dataclass(frozen=True, eq=False)
class SharedError:
    """A bench error that other calibrations may share.

    Parameters
    ----------
    name : str
        Name of the bench parameter, such as "radius".
    unit : str
        SI unit of the parameter.
    std : float
        Stated standard deviation u_q, in `unit`.
    covariance : (p,) array
        P_cq of the p coefficients, in SI units times `unit`.
    determination : str
        SHA-256 hash that is equal in all calibrations with the same determination of the value.
    date : str or None
        Date of the determination, ISO 8601; None if unknown.

    Raises
    ------
    InputError
        If the standard deviation is not positive, or a value is not finite.
    """

    name: str
    unit: str
    std: float
    covariance: Array
    determination: str
    date: str | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.std) and self.std > 0):
            raise InputError(
                f"shared error {self.name}: the standard deviation is {self.std} and must be "
                "positive",
                names=(self.name,),
            )
        if self.covariance.ndim != 1 or not np.isfinite(self.covariance).all():
            raise InputError(
                f"shared error {self.name}: the covariances must be a list of finite numbers",
                names=(self.name,),
            )

    @property
    def sensitivity(self) -> Array:
        """Derivative J = ∂c/∂q₀ of each coefficient, (p,), in SI units per unit of q."""
        return self.covariance / self.std**2

    def transform(self, jacobian: Array) -> "SharedError":
        """Convert the error to new coefficients, whose derivatives are the jacobian, (q, p)."""
        return replace(self, covariance=jacobian @ self.covariance)


SharedErrors = tuple[SharedError, ...] | None


def transform_shared(shared: SharedErrors, jacobian: Array) -> SharedErrors:
    """Convert shared errors to new coefficients; None stays None."""
    return None if shared is None else tuple(one.transform(jacobian) for one in shared)


def shared_covariance(
    first: SharedErrors, second: SharedErrors, places: tuple[Sequence[int], Sequence[int]]
) -> Array:
    """Return the covariance of two calibrations due to the shared errors that both state.

    Parameters
    ----------
    first, second : tuple of SharedError or None
        Shared errors. None means that the file does not state them; nothing is then shared.
    places : two sequences of p int
        Indices of the coefficients in each calibration.

    Returns
    -------
    (p, p) array
    """
    rows, columns = (list(one) for one in places)
    total = np.zeros((len(rows), len(columns)))
    others = {(one.name, one.determination): one for one in second or ()}
    for one in first or ():
        other = others.get((one.name, one.determination))
        if other is not None:
            pair = np.outer(one.covariance[rows], other.covariance[columns])
            total += pair / (one.std * other.std)
    return total
