"""The qualification of a bench: values of its parameters from a separate measurement.

Two successive qualifications show the drift of a bench. If a parameter drifts as a random walk with
the variance q t, the difference d of two determinations has the variance u₁² + u₂² + q t. This
gives q = max(0, d² − u₁² − u₂²)/t for each parameter. After a time t the uncertainty is

    u²(t) = u₀² + q t

One difference has only one degree of freedom. q is a moment estimate, and its 95 % upper limit is
d²/χ²₀.₀₅(1)/t minus the same variances, which is 254 times larger if d² dominates. Errors that both
determinations share, such as the certificate of the same level, cancel in d. Then u is too large
here, and q is too small.

A qualification is stored as versioned JSON, `*.qualification.json`. Schema
"inercal/qualification/1": `kind`, `bench` (kind and name), `determination`, `date`, `valid_until`,
`method`, `instrument`, `certificate`, `parameters` (a list of name, unit, value, std,
determination, date, valid_until; SI), `covariance` in that order, `test` (chi2, dof, p_value,
suspects), `unseen`, `remarks`, `provenance`, `withdrawn`, and `sha256`, the hash of the other keys.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

import datetime as dt
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inercal.basics.arrays import Array
from inercal.basics.atomic_files import write_text
from inercal.basics.documents import first_problem, record_object
from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file

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
    text = f"{what}: the covariance of {', '.join(names)} is not symmetric and positive definite"
    raise InputError(text, key="covariance", names=names)


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


SCHEMA = "inercal/qualification/1"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)


class _Bench(_Strict):
    kind: str
    name: str


class _Parameter(_Strict):
    name: str
    unit: str
    value: float
    std: Annotated[float, Field(gt=0)]
    determination: str
    date: dt.date
    valid_until: dt.date | None


class _Test(_Strict):
    chi2: float
    dof: int
    p_value: float
    suspects: tuple[str, ...]


class _File(_Strict):
    schema_: Literal["inercal/qualification/1"] = Field(alias="schema")
    kind: str
    bench: _Bench
    determination: str
    date: dt.date
    valid_until: dt.date | None
    method: str
    instrument: str
    certificate: str
    parameters: Annotated[list[_Parameter], Field(min_length=1)]
    covariance: list[list[float]]
    test: _Test
    unseen: tuple[str, ...]
    remarks: tuple[str, ...]
    provenance: dict[str, str]
    withdrawn: str
    sha256: str


def qualification_object(found: Qualification) -> dict[str, Any]:
    """Return the qualification as the JSON object of its file."""
    flat: dict[str, Any] = record_object(found)
    flat |= {
        "schema_": SCHEMA,
        "bench": {"kind": found.bench, "name": found.bench_name},
        "parameters": [
            {"name": one.name, "unit": one.unit, "value": one.value, "std": float(u)}
            | record_object(one)
            for one, u in zip(found.parameters, found.std, strict=True)
        ],
        "test": {name: flat[name] for name in _Test.model_fields},
    }
    keys = {name: one.alias or name for name, one in _File.model_fields.items() if name in flat}
    content = {key: flat[name] for name, key in keys.items()}
    return content | {"sha256": _digest(content)}


def to_text(found: Qualification) -> str:
    """Return a qualification as the text of its file."""
    return json.dumps(qualification_object(found), ensure_ascii=False, indent=2) + "\n"


def save(found: Qualification, path: str | Path) -> Path:
    """Write a qualification to a file, completely or not at all, and return the path."""
    return write_text(path, to_text(found))


def load(path: str | Path) -> Qualification:
    """Read a qualification from its file.

    Raises
    ------
    InputError
        The file is not a qualification, was changed by hand, or contains an impossible value.
    """
    path = Path(path)
    try:
        content = json.loads(read_small_file(path, "qualification"))
        read = _File.model_validate(content)
    except ValidationError as error:
        where, reason = first_problem(error)
        raise InputError(
            f"{path}: not a qualification of schema {SCHEMA}: {where or 'the file'}: {reason}; "
            "give a file that inercal qualify wrote",
            file=path,
        ) from None
    except (ValueError, RecursionError):
        raise InputError(
            f"{path}: not JSON text; give a file that inercal qualify wrote", file=path
        ) from None
    plain = {key: value for key, value in content.items() if key != "sha256"}
    if _digest(plain) != read.sha256:
        raise InputError(
            f"{path}: changed since it was written: its sha256 does not match; qualify again",
            file=path,
        )
    names = tuple(one.name for one in read.parameters)
    size = {len(row) for row in read.covariance} | {len(read.covariance)}
    covariance = np.array(read.covariance) if size == {len(names)} else np.zeros((0, 0))
    require_covariance(covariance, names, str(path))
    stated: dict[str, Any] = (
        dict(read)
        | dict(read.test)
        | {
            "bench": read.bench.kind,
            "bench_name": read.bench.name,
            "parameters": tuple(
                QualifiedParameter(**one.model_dump(exclude={"std"})) for one in read.parameters
            ),
            "covariance": covariance,
        }
    )
    return Qualification(**{one.name: stated[one.name] for one in fields(Qualification)})


def determination_sha256(
    place: tuple[str, str], names: tuple[str, ...], numbers: Any, date: dt.date, method: str
) -> str:
    """Return the SHA-256 hash that identifies a determination.

    Parameters
    ----------
    place : two str
        Kind and name of the bench.
    names : tuple of k str
    numbers : JSON content
        Values and covariance of the parameters.
    date : date
    method : str
    """
    return _digest([*place, list(names), numbers, date.isoformat(), method])


def _digest(content: Any) -> str:
    text = json.dumps(content, ensure_ascii=False, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
