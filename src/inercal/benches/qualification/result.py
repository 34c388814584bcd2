"""The qualification of a bench: values of its parameters from a separate measurement.

Two successive qualifications show the drift of a bench. If a parameter drifts as a random walk with
the variance q t, the difference d of two determinations has the variance u₁² + u₂² + q t. This
gives q = max(0, d² − u₁² − u₂²)/t for each parameter. After a time t the uncertainty is

    u²(t) = u₀² + q t

One difference has only one degree of freedom. q is a moment estimate, and its 95 % upper limit is
d²/χ²₀.₀₅(1)/t minus the same variances, which is 254 times larger if d² dominates. Errors that both
determinations share, such as the certificate of the same level, cancel in d. Then u is too large
here, and q is too small.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

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


YEAR = 365.25  # d


class ParameterDrift(NamedTuple):
    """The drift of one parameter between two qualifications.

    Parameters
    ----------
    name, unit : str
        Name of the parameter and its SI unit.
    difference, std : float
        Later minus earlier value, and its standard deviation without a drift.
    walk : float
        Variance q of the random walk, unit² per year.
    upper : float
        95 % upper limit of q.
    u_year : float
        Standard uncertainty of the later value after a year.
    """

    name: str
    unit: str
    difference: float
    std: float
    walk: float
    upper: float
    u_year: float


def drift_between(earlier: Qualification, later: Qualification) -> tuple[ParameterDrift, ...]:
    """Return the drift of each parameter that two qualifications of one bench share.

    Raises
    ------
    InputError
        The qualifications are for different benches, from the same day or in the wrong order, or
        they determined no common parameter.
    """
    if (earlier.bench, earlier.bench_name) != (later.bench, later.bench_name):
        raise InputError(
            f"the qualifications are for different benches: {earlier.bench} {earlier.bench_name!r} "
            f"and {later.bench} {later.bench_name!r}"
        )
    years = (later.date - earlier.date).days / YEAR
    if years <= 0:
        raise InputError(
            f"the qualifications are from {earlier.date} and {later.date}: give two from "
            f"different days, with the earlier one first"
        )
    from scipy import special  # only a comparison needs it

    found: list[ParameterDrift] = []
    for k, one in enumerate(later.parameters):
        if one.name not in earlier.names or one.determination != later.determination:
            continue
        i = earlier.names.index(one.name)
        difference = one.value - earlier.parameters[i].value
        variance = float(earlier.std[i] ** 2 + later.std[k] ** 2)
        walk = max(0.0, difference**2 - variance) / years
        limit = difference**2 / float(special.chdtri(1, 0.95))
        upper = max(0.0, limit - variance) / years
        after = float(later.std[k] ** 2 + walk) ** 0.5
        found.append(
            ParameterDrift(one.name, one.unit, difference, variance**0.5, walk, upper, after)
        )
    if not found:
        raise InputError("the qualifications have no parameter that both determined")
    return tuple(found)
