"""What is told of coefficients together where neither is told alone.

An accelerometer that stands up and down feels k1 + K3 g². What tells the two apart lies between,
where the head's second harmonic looks alike: a centrifuge does, or a polygon face at each position.
Both mounting angles share the head's zero; the angle between the accelerometers does not.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.benches.dividing_head import DividingHead
from inercal.estimate import Estimate, Gaussian
from inercal.methods.dual_orthogonal.square import ANGLES
from inercal.units import readable

Array = NDArray[np.float64]
_BETTER = 3.0  # times better known together than alone


def notes(estimate: Estimate, bench: DividingHead, priors: Sequence[Gaussian]) -> tuple[str, ...]:
    """Say what is known better together; of many trials nothing is said."""
    if estimate.value.ndim != 1:
        return ()
    return (*_gains(estimate, bench.gravity.value, priors), *_angle(estimate))


def _gains(estimate: Estimate, g: float, priors: Sequence[Gaussian]) -> tuple[str, ...]:
    told = {name for prior in priors for name in prior.names}
    sums: list[str] = []
    sources: set[bool] = set()
    for name in estimate.wanted:
        axis, _, term = name.partition(".")
        third = f"{axis}.k3"
        if term != "k1" or third not in estimate.wanted:
            continue
        value, sd, better = _together(estimate, (name, third), (1.0, g**2))
        if better:
            sums.append(f"{axis} {readable(value, 2 * sd, 'ppm')}")
            sources.add(third in told)
    if not sums:
        return ()
    why = "a prior of K3 tells k1 from K3"
    if False in sources:
        why = "K3 has no prior, and is told from k1 by what is stated of the head"
    return (
        f"k1 + K3 g² is known better than either (k = 2): {', '.join(sums)}; {why}: give K3 of a "
        "centrifuge, or read a polygon face at every position",
    )


def _angle(estimate: Estimate) -> tuple[str, ...]:
    if not set(ANGLES) <= set(estimate.wanted):
        return ()
    value, sd, better = _together(estimate, ANGLES, (-1.0, 1.0))
    if not better:
        return ()
    return (
        f"the angle between the accelerometers, δ_b − δ_a, is {readable(value, 2 * sd, '″')} "
        "(k = 2): their common angle is as good as the head's zero is known",
    )


def _together(
    estimate: Estimate, names: tuple[str, str], weights: tuple[float, float]
) -> tuple[float, float, bool]:
    """Return the weighted sum of two, its deviation, and whether it is known far better."""
    both, to = estimate.select(names), np.array(weights)
    sd = float(np.sqrt(to @ both.covariance @ to))
    alone = both.std * np.abs(to)
    return float(to @ both.value), sd, bool((alone > _BETTER * sd).all())
