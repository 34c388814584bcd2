"""The drift of a bench between two successive qualifications.

As a random walk with the variance q t, the difference d of two determinations has the variance
u₁² + u₂² + q t: q = max(0, d² − u₁² − u₂²)/t of each parameter, and between them

    u²(t) = u₀² + q t

One difference is one degree of freedom: q is a moment estimate, and its upper limit of 95 % is
d²/χ²₀.₀₅(1)/t less the same variances, 254 times larger where d² leads. Errors that both share,
such as the same certificate of a level, cancel in d: u is then too large here, and q too small.
"""
# pyright: reportMissingTypeStubs=false

from typing import NamedTuple

from scipy import special

from inercal.basics.errors import InputError
from inercal.benches.qualification.result import Qualification

YEAR = 365.25  # d


class ParameterDrift(NamedTuple):
    """The drift of one parameter.

    Parameters
    ----------
    name, unit : str
        SI.
    difference, std : float
        Later less earlier, and its standard deviation without a drift.
    walk : float
        q, unit² per year.
    upper : float
        Its upper limit of 95 %.
    u_year : float
        Standard uncertainty of the later value after a year.
    """

    name: str
    unit: str
    difference: float
    std: float
    walk: float
    upper: float
    u_year: float


def drift_between(earlier: Qualification, later: Qualification) -> tuple[ParameterDrift, ...]:
    """Return the drift of each parameter that two qualifications of one bench have.

    Raises
    ------
    InputError
        They are of different benches, of one day, in the wrong order, or have no common parameter
        that each determined.
    """
    if (earlier.bench, earlier.bench_name) != (later.bench, later.bench_name):
        raise InputError(
            f"the qualifications are of different benches: {earlier.bench} {earlier.bench_name!r} "
            f"and {later.bench} {later.bench_name!r}"
        )
    years = (later.date - earlier.date).days / YEAR
    if years <= 0:
        raise InputError(
            f"the qualifications are from {earlier.date} and {later.date}: give two from "
            "different days, the earlier first"
        )
    found: list[ParameterDrift] = []
    for k, one in enumerate(later.parameters):
        if one.name not in earlier.names or one.determination != later.determination:
            continue
        i = earlier.names.index(one.name)
        difference = one.value - earlier.parameters[i].value
        variance = float(earlier.std[i] ** 2 + later.std[k] ** 2)
        walk = max(0.0, difference**2 - variance) / years
        limit = difference**2 / float(special.chdtri(1, 0.95))
        upper = max(0.0, limit - variance) / years
        after = float(later.std[k] ** 2 + walk) ** 0.5
        found.append(
            ParameterDrift(one.name, one.unit, difference, variance**0.5, walk, upper, after)
        )
    if not found:
        raise InputError("the qualifications have no parameter that both determined")
    return tuple(found)
