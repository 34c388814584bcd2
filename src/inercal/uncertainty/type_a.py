"""Type A: the covariance of a mean of coloured noise, by non-overlapping batch means.

Samples of one section are cut into batches; the scatter of the batch means about the section's
mean, times the batch length, estimates the noise density at zero frequency, which white and
short-memory noise share over any section: covariance of a mean over n samples = density / n.

Sources: GUM (JCGM 100:2008) 4.2 for the Type A evaluation; batch means: Schmeiser, Operations
Research 30 (1982) 556–568; Flegal and Jones, Annals of Statistics 38 (2010) 1034–1070.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_BATCHES = 20  # a section; enough to judge scatter by, few enough that a batch outlasts memory


class MeanCovariance(NamedTuple):
    """Covariance of each section's mean, (..., r, m, m), and the degrees of freedom behind it."""

    covariance: Array
    dof: float


def pooled_mean_covariance(sections: Sequence[Array], samples: NDArray[np.int64]) -> MeanCovariance:
    """Return the covariance of means of sections that share one noise.

    Parameters
    ----------
    sections : sequence of (..., n, m) arrays
        Samples at rest, equally spaced; they may differ in n.
    samples : (r,) array of int
        Lengths of the sections whose means are wanted; these may be others than `sections`.
    """
    total: Array | float = 0.0
    dof = 0
    for section in sections:
        n, m = section.shape[-2:]
        count = min(_BATCHES, n)
        length = n // count
        batches = section[..., : count * length, :].reshape(*section.shape[:-2], count, length, m)
        means = batches.mean(axis=-2)
        scatter = means - means.mean(axis=-2, keepdims=True)
        total = total + length * np.swapaxes(scatter, -1, -2) @ scatter
        dof += count - 1
    density = np.asarray(total) / dof
    return MeanCovariance(density[..., None, :, :] / samples[:, None, None], float(dof))
