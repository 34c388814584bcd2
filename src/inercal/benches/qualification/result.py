"""The qualification of a bench: values of its parameters from a separate measurement."""

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

ANY_BENCH = "any"  # kind of bench for parameters of the place, such as gravity


@dataclass(frozen=True)
class QualifiedParameter:
    """One parameter of a bench in a qualification.

    Parameters
    ----------
    name : str
        Name of the parameter, as in `inercal.basics.parameters.Parameter`.
    unit : str
        SI unit.
    value : float
    determination : str
        Identifier of the determination.
    date : date
        Date of the determination.
    valid_until : date or None
        Last day on which the parameter may be used; None if no day is stated.
    """

    name: str
    unit: str
    value: float
    determination: str
    date: dt.date
    valid_until: dt.date | None


@dataclass(frozen=True, eq=False)
class Qualification:
    """A qualification, with the content of its file.

    Parameters
    ----------
    kind : str
        Kind of the measurement, such as "head_map".
    bench : str
        Kind of the bench; "any" for parameters that belong to the place.
    bench_name : str
        The laboratory's name for the bench; empty for any bench of the kind.
    determination : str
        SHA-256 hash of the results, with bench, date and method.
    date : date
    valid_until : date or None
    method, instrument, certificate : str
    parameters : tuple of k QualifiedParameter
        Parameters of the qualification; those from earlier determinations come first.
    covariance : (k, k) array
        Covariance of the parameters, SI. For a parameter that varies from dwell to dwell it
        contains the variance of a single value.
    chi2, dof, p_value : float, int and float
        χ² of the residuals, its degrees of freedom and its p-value; 0, 0 and 1 without residuals.
    suspects : tuple of str
        Violations of the model that the residuals show.
    unseen : tuple of str
        Effects that the measurement cannot detect.
    remarks : tuple of str
    provenance : mapping of str to str
    withdrawn : str
        Date and reason if it was withdrawn; otherwise empty.
    """

    kind: str
    bench: str
    bench_name: str
    determination: str
    date: dt.date
    valid_until: dt.date | None
    method: str
    instrument: str
    certificate: str
    parameters: tuple[QualifiedParameter, ...]
    covariance: Array
    chi2: float = 0.0
    dof: int = 0
    p_value: float = 1.0
    suspects: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    withdrawn: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(one.name for one in self.parameters)

    @property
    def std(self) -> Array:
        """Standard uncertainties (k = 1), (k,) SI."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def consistent(self) -> bool:
        """Whether the residuals are consistent with the model."""
        return not self.suspects

    def expired_parameters(self, day: dt.date) -> tuple[QualifiedParameter, ...]:
        """Return the parameters that are no longer valid on a day."""
        return tuple(
            one for one in self.parameters if one.valid_until is not None and one.valid_until < day
        )

    def is_of_bench(self, kind: str, name: str) -> bool:
        """Return whether the qualification is valid for a bench of this kind and name."""
        return self.bench == ANY_BENCH or (self.bench == kind and self.bench_name in ("", name))


def require_covariance(covariance: Array, names: tuple[str, ...], what: str) -> None:
    """Refuse a covariance that is not symmetric and positive definite.

    Raises
    ------
    InputError
        The covariance is not usable.
    """
    k = len(names)
    known = covariance.shape == (k, k) and bool(np.isfinite(covariance).all())
    variance = np.diagonal(covariance) if known else np.zeros(1)
    if (variance > 0).all():
        sd = np.sqrt(variance)
        correlation = covariance / np.outer(sd, sd)
        # A correlation of almost zero is only a rounding error, which need not be symmetric.
        symmetric = np.allclose(correlation, correlation.T, rtol=0, atol=1e-9)
        if symmetric and np.linalg.eigvalsh(correlation)[0] > 0:
            return
    raise InputError(
        f"{what}: the covariance of {', '.join(names)} is not symmetric and positive definite",
        key="covariance",
        names=names,
    )
