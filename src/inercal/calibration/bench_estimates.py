"""Bench estimates: what a run itself shows of a parameter of its bench.

An estimate has the stated value q₀ ± u_q of a parameter q as a prior. Where the data determine q,
too, the estimate without that prior is the run's own::

    q' = q̂ + P_qq (q̂ − q₀)/(u_q² − P_qq),   P' = P + P_q P_qᵀ/(u_q² − P_qq)

P is the covariance of all parameters with the prior, P_q its column of q. Of P'_qq the part of
other lasting parameters r of the bench, Σ P'_qr²/u_r², is the same in all runs with these
determinations; the rest is the run's own.
"""

from dataclasses import dataclass

import numpy as np

from inercal.basics.errors import InputError


@dataclass(frozen=True)
class BenchEstimate:
    """A parameter of the bench by the data of one run alone, SI.

    Parameters
    ----------
    name : str
        Full name, "radius" or "sin1[outer]".
    unit, meaning : str
    value, std : float
        q' and its standard uncertainty, P'_qq enlarged by the Birge ratio.
    own_std : float
        Without what runs with the same determinations of other parameters share.
    stated, stated_std : float
        q₀ and u_q.

    Raises
    ------
    InputError
        A number that is not finite, or a deviation that is not positive.
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
                f"bench estimate {self.name}: numbers must be finite, and deviations positive",
                names=(self.name,),
            )
