"""What is told of k1 and K3 together where neither is told alone.

An accelerometer that stands up and down feels k1 + K3 g². What tells the two apart lies between,
where the head's second harmonic looks alike: a centrifuge does, or a polygon face at each position.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.benches.dividing_head import DividingHead
from inercal.estimate import Estimate, Gaussian
from inercal.units import readable

Array = NDArray[np.float64]
_APART = 3.0  # times better known together than alone


def of_gains(
    estimate: Estimate, bench: DividingHead, priors: Sequence[Gaussian]
) -> tuple[str, ...]:
    """Say k1 + K3 g² of each accelerometer that has both and knows their sum far better.

    Nothing is said of trials.
    """
    if estimate.value.ndim != 1:
        return ()
    g = bench.gravity.value
    told = {name for prior in priors for name in prior.names}
    sums: list[str] = []
    sources: set[bool] = set()
    for name in estimate.wanted:
        axis, _, term = name.partition(".")
        third = f"{axis}.k3"
        if term != "k1" or third not in estimate.wanted:
            continue
        both = estimate.select((name, third))
        to = np.array([1.0, g**2])
        sd = float(np.sqrt(to @ both.covariance @ to))
        if float(both.std[0]) > _APART * sd:
            sums.append(f"{axis} {readable(float(to @ both.value), 2 * sd, 'ppm')}")
            sources.add(third in told)
    if not sums:
        return ()
    why = "the prior of K3 alone tells k1 from K3"
    if False in sources:
        why = "K3 has no prior, and is told from k1 by what is stated of the head alone"
    return (
        f"k1 + K3 g² is known better than either (k = 2): {', '.join(sums)}; {why}: give K3 of a "
        "centrifuge, or read a polygon face at every position",
    )
