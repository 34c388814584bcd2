"""The qualification of a bench: values of its parameters, found by a measurement of their own."""

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

ANY_BENCH = "any"  # kind of bench of what belongs to the place, as gravity


@dataclass(frozen=True)
class QualifiedParameter:
    """One parameter of a bench in a qualification.

    Parameters
    ----------
    name : str
        As of `inercal.basics.parameters.Parameter`.
    unit : str
        SI.
    value : float
    determination : str
        Identity of the determination.
    date : date
        Of the determination.
    valid_until : date or None
        The last day on which it may be used; None where none is stated.
    """

    name: str
    unit: str
    value: float
    determination: str
    date: dt.date
    valid_until: dt.date | None


@dataclass(frozen=True, eq=False)
class Qualification:
    """A qualification, as its file has it.

    Parameters
    ----------
    kind : str
        Of the measurement, "head_map".
    bench : str
        Kind of the bench; "any" for what belongs to the place.
    bench_name : str
        The laboratory's name of the bench; empty for any bench of the kind.
    determination : str
        SHA-256 of what was found, with bench, date and method.
    date : date
    valid_until : date or None
    method, instrument, certificate : str
    parameters : tuple of k QualifiedParameter
        Those of earlier determinations first.
    covariance : (k, k) array
        SI; of a parameter that differs from dwell to dwell, the variance of each of its values.
    chi2, dof, p_value : float, int and float
        Of the residuals; 0, 0 and 1 where there are none.
    suspects : tuple of str
        Violations of the model that the residuals show.
    unseen : tuple of str
        What the measurement cannot see.
    remarks : tuple of str
    provenance : mapping of str to str
    withdrawn : str
        When and why it was withdrawn; empty of one that is in use.
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
        """Whether the residuals agree with the model."""
        return not self.suspects

    def expired_parameters(self, day: dt.date) -> tuple[QualifiedParameter, ...]:
        """Return the parameters that were valid only until before a day."""
        return tuple(
            one for one in self.parameters if one.valid_until is not None and one.valid_until < day
        )

    def is_of_bench(self, kind: str, name: str) -> bool:
        """Return whether it is of a bench of this kind and name."""
        return self.bench == ANY_BENCH or (self.bench == kind and self.bench_name in ("", name))


def require_covariance(covariance: Array, names: tuple[str, ...], what: str) -> None:
    """Refuse a covariance that is not symmetric and positive definite.

    Raises
    ------
    InputError
    """
    k = len(names)
    known = covariance.shape == (k, k) and bool(np.isfinite(covariance).all())
    variance = np.diagonal(covariance) if known else np.zeros(1)
    if (variance > 0).all():
        sd = np.sqrt(variance)
        correlation = covariance / np.outer(sd, sd)
        # A correlation of almost zero is nothing but rounding, which need not be symmetric.
        symmetric = np.allclose(correlation, correlation.T, rtol=0, atol=1e-9)
        if symmetric and np.linalg.eigvalsh(correlation)[0] > 0:
            return
    raise InputError(
        f"{what}: the covariance of {', '.join(names)} is not symmetric and positive definite",
        key="covariance",
        names=names,
    )
