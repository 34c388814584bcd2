"""What a measurement of a bench gives."""

from dataclasses import dataclass

from inercal.basics.arrays import Array
from inercal.benches.qualification.linear_fit import LinearFit


@dataclass(frozen=True, eq=False)
class MeasuredParameters:
    """Parameters found by a measurement.

    Parameters
    ----------
    names : tuple of k str
        As the bench calls them.
    unit : tuple of k str
        SI.
    value : (k,) array
    covariance : (k, k) array
    chi2, dof, p_value
        Of the residuals.
    suspects : tuple of str
        Violations of the model that the residuals show.
    unseen : tuple of str
        What the measurement cannot see.
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
    """Return parameters of one unit with the tests of a fit."""
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
