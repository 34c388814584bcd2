"""Sums of coefficients that are known far better than each coefficient alone.

An accelerometer that is vertical determines k1 + K3 g². Positions between would separate the two,
but there the head's second harmonic has the same effect; a centrifuge separates them, or a polygon
face at each position. Both mounting angles depend on the head's zero; the angle between the
accelerometers does not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_quantity
from inercal.benches.dividing_head.bench import DividingHead
from inercal.estimation import Estimate, Gaussian
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.methods.dual_orthogonal.g_squared import MOUNTING_ANGLES

_MIN_IMPROVEMENT = 3.0  # standard uncertainty alone over that of the sum


class CoefficientSum(NamedTuple):
    """A sum of two coefficients that is known far better than either, SI of the first."""

    name: str
    meaning: str
    terms: tuple[str, str]
    value: float
    sd: float  # as modelled


def well_determined_sums(estimate: Estimate, g: float) -> tuple[CoefficientSum, ...]:
    """Return k1 + K3 g² of each accelerometer, then the angle between them, where well known.

    Parameters
    ----------
    estimate : Estimate
        Of one recording.
    g : float
        m/s².
    """
    axes = [CoefficientName(name).axis for name in estimate.wanted if name.endswith(".k1")]
    requested = [
        (f"{a}.k1 + {a}.k3 g²", "gain between up and down", (f"{a}.k1", f"{a}.k3"), (1.0, g**2))
        for a in axes
    ]
    first, second = MOUNTING_ANGLES
    between = (f"{second} − {first}", "angle between the accelerometers", (second, first))
    sums: list[CoefficientSum] = []
    for name, meaning, terms, weights in (*requested, (*between, (1.0, -1.0))):
        if set(terms) <= set(estimate.wanted):
            both, to = estimate.select(terms), np.array(weights)
            sd = float(np.sqrt(to @ both.covariance @ to))
            alone = np.abs(to) * np.sqrt(np.diagonal(both.covariance))
            if (alone > _MIN_IMPROVEMENT * sd).all():
                sums.append(CoefficientSum(name, meaning, terms, float(to @ both.value), sd))
    return tuple(sums)


def notes(estimate: Estimate, bench: DividingHead, priors: Sequence[Gaussian]) -> tuple[str, ...]:
    """Return the notes on these sums of one recording; none for many trials."""
    if estimate.value.ndim != 1:
        return ()
    sums = well_determined_sums(estimate, bench.gravity.value)
    k = COVERAGE * float(estimate.birge)
    gains = [one for one in sums if one.terms != MOUNTING_ANGLES[::-1]]
    result: list[str] = []
    if gains:
        known = {name for prior in priors for name in prior.names}
        why = "the prior of K3 separates them"
        if not {one.terms[1] for one in gains} <= known:
            why = "without a prior of K3, only the stated errors of the head separate them"
        values = ", ".join(
            f"{CoefficientName(one.terms[0]).axis} {format_quantity(one.value, k * one.sd, 'ppm')}"
            for one in gains
        )
        result.append(
            f"k1 + K3 g² is known better than k1 or K3 (k = 2): {values}; {why}; to know them "
            "better, give K3 from a centrifuge or read a polygon face at every position"
        )
    result += [
        f"the angle between the accelerometers, δ_b − δ_a, is "
        f"{format_quantity(one.value, k * one.sd, '″')} (k = 2); their common angle is known no "
        "better than the head's zero"
        for one in sums
        if one not in gains
    ]
    return tuple(result)
