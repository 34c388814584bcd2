"""The parameters that a measurement of a bench determines."""

from dataclasses import dataclass

from inercal.basics.arrays import Array
from inercal.benches.qualification.linear_fit import LinearFit


@dataclass(frozen=True, eq=False)
class MeasuredParameters:
    """Parameters of a bench that a measurement determines.

    Parameters
    ----------
    names : tuple of k str
        Names of the bench's parameters.
    unit : tuple of k str
        SI units.
    value : (k,) array
    covariance : (k, k) array
    chi2, dof, p_value
        χ² of the residuals, its degrees of freedom and its p-value.
    suspects : tuple of str
        Violations of the model that the residuals show.
    unseen : tuple of str
        Effects that the measurement cannot detect.
    remarks : tuple of str
    """

    names: tuple[str, ...]
    unit: tuple[str, ...]
    value: Array
    covariance: Array
    chi2: float = 0.0
    dof: int = 0
    p_value: float = 1.0
    suspects: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def from_fit(
    fit: LinearFit,
    names: tuple[str, ...],
    unit: str,
    value: Array,
    covariance: Array,
    unseen: tuple[str, ...] = (),
    remarks: tuple[str, ...] = (),
) -> MeasuredParameters:
    """Return parameters that share one unit, with the test results of a fit."""
    return MeasuredParameters(
        names,
        (unit,) * len(names),
        value,
        covariance,
        fit.chi2,
        fit.dof,
        fit.p_value,
        fit.suspects,
        unseen,
        remarks,
    )
