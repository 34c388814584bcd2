"""Errors of a bench that several calibrations share, and estimates of a bench from one run.

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

Bench estimates are determined only from the data of a run. The fit uses the stated value q₀ ± u_q
of a bench parameter q as a prior. If the data also determine q, the prior can be removed from the
result. The estimate q' then comes only from the run::

    q' = q̂ + P_qq (q̂ − q₀)/(u_q² − P_qq),   P' = P + P_q P_qᵀ/(u_q² − P_qq)

P is the covariance of all parameters with the prior, and P_q is its column for q. P'_qq contains
the part Σ P'_qr²/u_r² from other lasting parameters r of the bench. This part is the same in all
runs that use the same determinations. The remaining part of P' belongs only to this run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError


@dataclass(frozen=True)
class BenchEstimate:
    """A bench parameter that was estimated from the data of one run, in SI units.

    Parameters
    ----------
    name : str
        Full name, such as "radius" or "sin1[outer]".
    unit, meaning : str
    value, std : float
        q' and its standard uncertainty from P'_qq, multiplied by the Birge ratio.
    own_std : float Standard uncertainty without the part that all runs with the same determinations
    of the other parameters have in common. stated, stated_std : float
        Stated value q₀ and its standard uncertainty u_q.

    Raises
    ------
    InputError
        If a number is not finite, or a standard deviation is not positive.
    """

    name: str
    unit: str
    meaning: str
    value: float
    std: float
    own_std: float
    stated: float
    stated_std: float

    def __post_init__(self) -> None:
        numbers = (self.value, self.std, self.own_std, self.stated, self.stated_std)
        positive = min(self.std, self.own_std, self.stated_std) > 0
        if not (np.isfinite(numbers).all() and positive):
            raise InputError(
                f"bench estimate {self.name}: numbers must be finite, and standard deviations "
                "positive",
                names=(self.name,),
            )


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
