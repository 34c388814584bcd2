"""Test whether the difference of two calibrations exceeds the usual scatter from run to run.

E_n and χ² test whether a sensor changed by more than the stated uncertainties allow. The
coefficients of a sensor also scatter from one turn-on, day and mounting to the next, with standard
deviation σ for each use. Two calibrations therefore differ even without a fault. If σ has ν degrees
of freedom, the difference is judged by::

    E_run = d/(t_ν √(u_d² + 2σ²))

u_d² is the variance of the difference d without shared errors, and t_ν gives the same coverage as
2u. The joint test uses the covariance C_d + 2Σ, where Σ is the covariance of the scatter.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration.comparison import Comparison
from inercal.calibration.comparison.changes import CHANCE_FRACTION, JointTest, joint_test
from inercal.calibration.next_use import load_next_use
from inercal.estimation.uncertainty.conformity import expanded_uncertainty


@dataclass(frozen=True, eq=False)
class RunScatter:
    """The scatter of a sensor's coefficients from one use to the next.

    Parameters
    ----------
    source : str
        Printed name of the source, such as "TRIAD-7.repeatability.json".
    names : tuple of p str
    covariance : (p, p) array
        Covariance of one calibration about the mean, SI, without the calibration's own uncertainty.
    dof : (p,) array
        Degrees of freedom of each coefficient.
    """

    source: str
    names: tuple[str, ...]
    covariance: Array
    dof: Array


@dataclass(frozen=True, eq=False)
class RunToRun:
    """The difference of two calibrations compared with the scatter from run to run.

    Parameters
    ----------
    source : str
    names : tuple of p str
        Coefficients with a known scatter.
    normalised_errors : (p,) array
        Normalised errors E_run.
    changed : (p,) array of bool
        Whether |E_n| > 1.
    joint : JointTest or None
    """

    source: str
    names: tuple[str, ...]
    normalised_errors: Array
    changed: NDArray[np.bool_]
    joint: JointTest | None

    @property
    def beyond(self) -> tuple[str, ...]:
        """Coefficients whose difference exceeds the usual scatter."""
        pairs = zip(self.names, self.normalised_errors, strict=True)
        return tuple(name for name, one in pairs if abs(one) > 1)

    @property
    def within(self) -> tuple[str, ...]:
        """Coefficients with |E_n| > 1 whose difference is within the usual scatter."""
        rows = zip(self.names, self.normalised_errors, self.changed, strict=True)
        return tuple(name for name, one, changed in rows if changed and abs(one) <= 1)

    @property
    def expected_exceedances(self) -> float:
        """Number of coefficients that are expected to exceed the scatter by chance."""
        return CHANCE_FRACTION * len(self.names)


def scatter_of_file(path: Path, compared: Comparison) -> RunScatter:
    """Read the scatter for a comparison from a file written by `inercal repeat`.

    Raises
    ------
    InputError
        If the file does not exist, or its frame, form or coefficients are different.
    """
    found = load_next_use(path)
    terms = compared.second.frame, compared.second.sensor.form
    if (found.frame, found.form) != terms:
        raise InputError(
            f"{path}: its frame is {found.frame} and its form is {found.form}, but the "
            f"calibrations have {terms[0]} and {terms[1]}: run inercal repeat with calibrations "
            "that have this frame and form",
            file=path,
            key="--repeatability",
        )
    if not set(found.names) & set(compared.names):
        raise InputError(
            f"{path}: the file has none of the coefficients of the calibrations, only "
            f"{', '.join(found.names)}",
            file=path,
            key="--repeatability",
        )
    return RunScatter(found.source, found.names, found.run_to_run, found.dof)


def against_scatter(compared: Comparison, scatter: RunScatter) -> RunToRun | None:
    """Compare differences with the scatter; None if no coefficient has a known scatter."""
    names = tuple(name for name in compared.names if name in scatter.names)
    if not names or not compared.states_uncertainty:
        return None
    mine = [compared.names.index(name) for name in names]
    its = [scatter.names.index(name) for name in names]
    added = 2 * scatter.covariance[np.ix_(its, its)]
    std = np.sqrt(compared.difference_std[mine] ** 2 + np.diag(added))
    covariance = compared.difference_covariance[np.ix_(mine, mine)] + added
    difference = compared.difference[mine]
    return RunToRun(
        scatter.source,
        names,
        difference / expanded_uncertainty(std, scatter.dof[its]),
        np.abs(compared.normalised_errors[mine]) > 1,
        joint_test(difference, covariance) if (np.diag(covariance) > 0).all() else None,
    )
