"""Type A: the covariance of a mean whose samples are not independent.

Samples are cut into a batches of equal length and the scatter of the batch means is used in place
of the scatter of the samples (non-overlapping batch means; Flegal and Jones 2010, Annals of
Statistics 38, 1034–1070, equation 4; for independent samples it is GUM 4.2.3):

    Ω = Σ bⱼ (ȳⱼ − ȳ)(ȳⱼ − ȳ)ᵀ / (a − 1),   cov ȳ = Ω / n,   a − 1 degrees of freedom

It is unbiased when a batch is long compared with the correlation time of the noise. Few, long
batches cost little: beyond some 10 to 30 the interval hardly gets shorter (Schmeiser 1982,
Operations Research 30, 556–568), so their number is fixed and their length grows with the data.
Sections of the same noise pool their scatter: a fit that is weighted by a covariance of ν degrees
of freedom in m channels has its χ² enlarged by about ν / (ν − m − 1), so ν should be many times m.
"""

from collections.abc import Iterable

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

BATCHES = 20


def pooled_mean_covariances(
    sections: Iterable[Array], batches: int = BATCHES
) -> tuple[list[Array], float]:
    """Return the covariance of the mean of each of several sections of the same noise.

    The sections share one Ω, estimated from all of them; the covariance of each mean is Ω / n.

    Parameters
    ----------
    sections : iterable of (..., n, m) arrays
        Sections of n samples of m channels, of any lengths at one sampling rate; their means may
        differ, their noise may not. They are read once, one after another.
    batches : int
        Batches per section. Of many sections, few and long batches are enough: 4 of each of 40
        give as many degrees of freedom as 20 of each of 6, and allow noise of a longer correlation.

    Returns
    -------
    covariances : list of (..., m, m) arrays
        One for each section.
    dof : float
        Degrees of freedom behind all of them.

    Raises
    ------
    InputError
        Too few samples for a covariance of m channels.
    """
    total, dof, m = np.zeros(()), 0, 0
    counts: list[int] = []
    for section in sections:
        n, m = section.shape[-2:]
        counts.append(n)
        number = min(max(batches, 2), n)
        edges = np.arange(number) * n // number
        length = np.diff(edges, append=n)
        means = np.add.reduceat(section, edges, axis=-2) / length[:, None]
        off = (means - np.mean(section, axis=-2, keepdims=True)) * np.sqrt(length)[:, None]
        total = total + np.swapaxes(off, -1, -2) @ off
        dof += number - 1
    if dof < max(m, 1):
        raise InputError(
            f"{sum(counts)} samples in {len(counts)} sections give {dof} degrees of freedom, fewer "
            f"than the {m} that the covariance of {m} channels needs; record longer sections"
        )
    return [total / (dof * n) for n in counts], float(dof)
