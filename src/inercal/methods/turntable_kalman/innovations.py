"""The test of a filter's innovations: whether noise and table are as stated.

The normalised innovations squared (NIS) are χ² if R is the noise, with as many degrees of freedom
as components, less those that only give states of which nothing is known before (Bar-Shalom, Li and
Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, section 5.4). The
source's R is not the noise, and NIS with it is no test.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from inercal.basics.arrays import Array
from inercal.estimation import FilterHistory, ResidualGroup
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods.turntable.model import TriadModel
from inercal.methods.turntable_kalman.filter_tests import InnovationTestData
from inercal.recordings import Observations

_CONFIDENCE_LEVEL = 0.95
# Of the expected NIS: noise is seldom known to 5 %, and a small overstatement is harmless
_MIN_NIS_RATIO = 0.9


class FilterResult(NamedTuple):
    """The result of one filter over one track; coefficients come first."""

    triad: TriadModel
    names: tuple[str, ...]
    value: Array
    covariance: Array
    course: FilterHistory
    nis: float  # sum over its components
    dof: int  # of its NIS, where noise and table are as stated
    unit: str
    untested_reason: str  # why NIS is no test of noise and table; empty where it is
    shared_covariance: Array  # (p, p), the part by gravity, which changes no innovation
    test_data: InnovationTestData | None = None  # where its steps were kept
    rejections: int = 0  # readbacks beyond the gate

    @property
    def sd(self) -> float:
        """Standard deviation of the first three innovations by the filter's model."""
        z = self.course.innovation[self.course.nis > 0, :3]
        ratio = self.nis / max(self.dof, 1)
        return float(np.sqrt(np.mean(z**2) / ratio)) if z.size and ratio else 1.0


def variance_inflation(one: FilterResult) -> float:
    """Return the factor by which the innovations enlarge variances."""
    if one.dof <= 0 or one.nis <= chdtri(one.dof, 1 - _CONFIDENCE_LEVEL):
        return 1.0
    return one.nis / one.dof


def residual_group(one: FilterResult, observations: Observations) -> ResidualGroup:
    """Return the mean innovations of each step of the run."""
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
        dof=one.dof,
        spread=ScatterModel(excess=one.sd * float(np.sqrt(variance_inflation(one) - 1))),
        enlarged=variance_inflation(one) > 1,
    )


def describe_innovations(one: FilterResult) -> str:
    """Return a sentence on the agreement of the innovations with the stated noise and table."""
    mean = one.nis / max(one.dof, 1)
    text = f"{one.course.name}: the innovations' NIS per degree of freedom is {mean:.2f}"
    if variance_inflation(one) > 1:
        return f"{text}, above its 95 % bound: all variances are multiplied by it"
    if one.untested_reason:
        return f"{text}; it is no test of noise and table: {one.untested_reason}"
    if one.nis < _MIN_NIS_RATIO * chdtri(max(one.dof, 1), _CONFIDENCE_LEVEL):
        return (
            f"{text}, below 1: noise or table are better than stated, and the uncertainties are "
            "too large"
        )
    return f"{text}: consistent with noise and table as stated"
