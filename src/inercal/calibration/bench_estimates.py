"""Estimate bench parameters from the data of a run, without their stated values.

The fit uses the stated value q₀ ± u_q of a bench parameter q as a prior. If the data also determine
q, the prior can be removed from the result. The estimate q' then comes only from the run::

    q' = q̂ + P_qq (q̂ − q₀)/(u_q² − P_qq),   P' = P + P_q P_qᵀ/(u_q² − P_qq)

P is the covariance of all parameters with the prior, and P_q is its column for q. P'_qq contains
the part Σ P'_qr²/u_r² from other lasting parameters r of the bench. This part is the same in all
runs that use the same determinations. The remaining part of P' belongs only to this run.
"""

from dataclasses import dataclass

import numpy as np

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
