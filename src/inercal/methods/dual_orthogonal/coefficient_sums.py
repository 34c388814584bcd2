"""What is told of coefficients together where neither is told alone.

An accelerometer that stands up and down feels k1 + K3 g². What tells the two apart lies between,
where the head's second harmonic looks alike: a centrifuge does, or a polygon face at each position.
Both mounting angles share the head's zero; the angle between the accelerometers does not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.benches.dividing_head.bench import DividingHead
from inercal.calibration.verdict import COVERAGE
from inercal.estimate import Estimate, Gaussian
from inercal.keys import CoefficientName
from inercal.methods.dual_orthogonal.g_squared import MOUNTING_ANGLES
from inercal.units import format_quantity

_MIN_IMPROVEMENT = 3.0  # times better known together than alone


class CoefficientSum(NamedTuple):
    """A sum of two coefficients that is known far better than either, SI of the first."""

    name: str
    meaning: str
    terms: tuple[str, str]
    value: float
    sd: float  # as modelled


def well_determined_sums(estimate: Estimate, g: float) -> tuple[CoefficientSum, ...]:
    """Return k1 + K3 g² of each accelerometer, then the angle between them, where they are.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
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
    found: list[CoefficientSum] = []
    for name, meaning, terms, weights in (*requested, (*between, (1.0, -1.0))):
        if set(terms) <= set(estimate.wanted):
            both, to = estimate.select(terms), np.array(weights)
            sd = float(np.sqrt(to @ both.covariance @ to))
            alone = np.abs(to) * np.sqrt(np.diagonal(both.covariance))
            if (alone > _MIN_IMPROVEMENT * sd).all():
                found.append(CoefficientSum(name, meaning, terms, float(to @ both.value), sd))
    return tuple(found)


def notes(estimate: Estimate, bench: DividingHead, priors: Sequence[Gaussian]) -> tuple[str, ...]:
    """Say what is known better together; of many trials nothing is said."""
    if estimate.value.ndim != 1:
        return ()
    found = well_determined_sums(estimate, bench.gravity.value)
    k = COVERAGE * float(estimate.birge)
    gains = [one for one in found if one.terms != MOUNTING_ANGLES[::-1]]
    said: list[str] = []
    if gains:
        told = {name for prior in priors for name in prior.names}
        why = "a prior of K3 tells k1 from K3"
        if not {one.terms[1] for one in gains} <= told:
            why = "K3 has no prior, and is told from k1 by what is stated of the head"
        sums = ", ".join(
            f"{CoefficientName(one.terms[0]).axis} {format_quantity(one.value, k * one.sd, 'ppm')}"
            for one in gains
        )
        said.append(
            f"k1 + K3 g² is known better than either (k = 2): {sums}; {why}: give K3 of a "
            "centrifuge, or read a polygon face at every position"
        )
    said += [
        f"the angle between the accelerometers, δ_b − δ_a, is "
        f"{format_quantity(one.value, k * one.sd, '″')} (k = 2): their common angle is as good as "
        "the head's zero is known"
        for one in found
        if one not in gains
    ]
    return tuple(said)
