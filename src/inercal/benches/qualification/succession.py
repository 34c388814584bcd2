"""The drift of a bench between two successive qualifications.

If a parameter drifts as a random walk with the variance q t, the difference d of two determinations
has the variance u₁² + u₂² + q t. This gives q = max(0, d² − u₁² − u₂²)/t for each parameter. After
a time t the uncertainty is

    u²(t) = u₀² + q t

One difference has only one degree of freedom. q is a moment estimate, and its 95 % upper limit is
d²/χ²₀.₀₅(1)/t minus the same variances, which is 254 times larger if d² dominates. Errors that both
determinations share, such as the certificate of the same level, cancel in d. Then u is too large
here, and q is too small.
"""
# pyright: reportMissingTypeStubs=false

from typing import NamedTuple

from scipy import special

from inercal.basics.errors import InputError
from inercal.benches.qualification.result import Qualification

YEAR = 365.25  # d


class ParameterDrift(NamedTuple):
    """The drift of one parameter between two qualifications.

    Parameters
    ----------
    name, unit : str
        Name of the parameter and its SI unit.
    difference, std : float
        Later minus earlier value, and its standard deviation without a drift.
    walk : float
        Variance q of the random walk, unit² per year.
    upper : float
        95 % upper limit of q.
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
    """Return the drift of each parameter that two qualifications of one bench share.

    Raises
    ------
    InputError
        The qualifications are for different benches, from the same day or in the wrong order, or
        they determined no common parameter.
    """
    if (earlier.bench, earlier.bench_name) != (later.bench, later.bench_name):
        raise InputError(
            f"the qualifications are for different benches: {earlier.bench} {earlier.bench_name!r} "
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
