"""What a filter's innovations say of it: whether noise and table are as stated.

Normalised, their squares (NIS) are χ² of as many degrees of freedom as there are components, if R
is the noise (Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and
Navigation, section 5.4). The source's R is not, and its NIS tests nothing.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from inercal.arrays import Array
from inercal.estimate import FilterHistory, ResidualGroup
from inercal.estimate.residual_scatter import ScatterModel
from inercal.methods.turntable.model import EPOCH_PERIOD, TriadModel
from inercal.methods.turntable_kalman.filter_tests import InnovationTestData
from inercal.recording import Observations, Track

_CONFIDENCE_LEVEL = 0.95
# Of NIS as stated: noise is seldom known to 5 %, and what is less does no harm
_MIN_NIS_RATIO = 0.9


class FilterResult(NamedTuple):
    """What one filter made of one track; coefficients come first."""

    triad: TriadModel
    names: tuple[str, ...]
    value: Array
    covariance: Array
    course: FilterHistory
    nis: float  # sum over its components
    components: int  # observed
    minimum_nis: float  # NIS a component where all is as stated, at least
    unit: str
    untested_reason: str  # why NIS does not test what was stated; empty where it does
    shared_covariance: Array  # (p, p), part of the covariance that no innovation shows: gravity's
    test_data: InnovationTestData | None = None  # where its steps were kept
    rejections: int = 0  # readbacks beyond the gate

    @property
    def sd(self) -> float:
        """Of the first three innovations, as the filter expected them."""
        z = self.course.innovation[self.course.nis > 0, :3]
        ratio = self.nis / max(self.components, 1)
        return float(np.sqrt(np.mean(z**2) / ratio)) if z.size and ratio else 1.0


def minimum_nis(track: Track) -> float:
    """Return how small NIS may be: by trapezoids an epoch of n samples has the noise of n − ½."""
    step = float(np.median(np.diff(track.time))) if track.time.size > 1 else 0.0
    return 1 - 0.5 * min(step / EPOCH_PERIOD, 1.0)


def variance_inflation(one: FilterResult) -> float:
    """Return what the innovations enlarge variances by."""
    if one.components == 0 or one.nis <= chdtri(one.components, 1 - _CONFIDENCE_LEVEL):
        return 1.0
    return one.nis / one.components


def residual_group(one: FilterResult, observations: Observations) -> ResidualGroup:
    """Return mean innovations by step of the run."""
    kept = one.course.nis > 0
    time, z = one.course.time[kept], one.course.innovation[kept, :3]
    labels: list[str] = []
    means: list[Array] = []
    counts: list[int] = []
    for label, middle, seconds in zip(
        observations.labels, observations.time, observations.duration, strict=True
    ):
        at = np.abs(time - middle) <= seconds / 2
        if at.any():
            labels.append(label)
            means.append(z[at].mean(axis=0))
            counts.append(int(at.sum()))
    residual = np.array(means).reshape(-1, 3)
    return ResidualGroup(
        name=f"innovations of the {one.course.name}' filter, mean of each step",
        unit=one.unit,
        labels=tuple(labels),
        residual=residual,
        # Innovations are independent.
        sd=one.sd / np.sqrt(np.array(counts, dtype=float))[:, None] * np.ones(3),
        chi2=one.nis,
        dof=one.components,
        spread=ScatterModel(excess=one.sd * float(np.sqrt(variance_inflation(one) - 1))),
        enlarged=variance_inflation(one) > 1,
    )


def describe_innovations(one: FilterResult) -> str:
    """Say how the innovations agree with what was stated."""
    mean = one.nis / max(one.components, 1)
    said = f"{one.course.name}: the innovations' NIS is {mean:.2f} a component"
    if variance_inflation(one) > 1:
        return f"{said} (1 is as stated): beyond what noise and table allow"
    if one.untested_reason:
        return f"{said}: {one.untested_reason}, so it tests nothing"
    if one.nis < _MIN_NIS_RATIO * one.minimum_nis * chdtri(one.components, _CONFIDENCE_LEVEL):
        return (
            f"{said} (1 is as stated): less than stated; noise or table are better than that, and "
            "the uncertainties too large"
        )
    return f"{said} (1 is as stated): within what noise and table allow"
