"""Limits for coefficients, the test of conformity, and the scatter from one use to the next.

The result for the whole sensor is the worst result of all its limits. The probability that the
sensor conforms is the probability that all coefficients conform at the same time, computed from
their covariance. For example, if each of 24 independent coefficients conforms with a probability of
99 %, all of them conform with 79 %.

The scatter from one use to the next comes from a file of `inercal repeat`. Schema
"inercal/repeatability/1": `sensor`, `frame`, `form`, `coefficients` (a list of name, unit,
value and the uncertainties of mean and next use, SI), `scatter` (covariance that the next use adds,
in that order) and `dof`. Further fields are only for people who read the file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, Field

from inercal.basics.arrays import Array
from inercal.basics.documents import read_document, record_object
from inercal.basics.errors import InputError
from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.grade import Verdict
from inercal.estimation.uncertainty import COVERAGE
from inercal.estimation.uncertainty.conformity import (
    RESULTS,
    DecisionRule,
    Result,
    conformance_probability,
    expanded_uncertainty,
    joint_conformance_probability,
    judge,
)
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import ErrorTerm

SCHEMA = "inercal/repeatability/1"
_Number = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, eq=False)
class NextUseScatter:
    """How much the coefficients of a sensor scatter from one use to the next.

    Parameters
    ----------
    source : str
        Name of the file.
    sensor : str
        Name of the sensor.
    frame, form : str
        Body frame and form of the model to which the coefficients refer.
    names : tuple of str
    covariance : (p, p) array
        Covariance of one use about the mean, SI.
    run_to_run : (p, p) array
        Covariance of one session about the mean, including effects of the bench such as a new
        mounting. It equals `covariance` if the file does not state it.
    dof : (p,) array
        Degrees of freedom of each coefficient.
    """

    source: str
    sensor: str
    frame: str
    form: str
    names: tuple[str, ...]
    covariance: Array
    run_to_run: Array
    dof: Array

    def of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the covariance and the degrees of freedom of the named coefficients.

        Raises
        ------
        InputError
            If a coefficient is not in the file.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise InputError(
                f"{self.source} states no scatter for {', '.join(missing)}; it has "
                f"{', '.join(self.names)}",
                names=tuple(missing),
            )
        picks = [self.names.index(name) for name in names]
        return self.covariance[np.ix_(picks, picks)], self.dof[picks]


class _Coefficient(BaseModel, defer_build=True):
    name: str
    dof: Annotated[float, Field(gt=0)]


class _Sensor(BaseModel, defer_build=True):
    name: str


class _File(BaseModel, defer_build=True):
    schema_: Literal["inercal/repeatability/1"] = Field(alias="schema")
    sensor: _Sensor
    frame: str
    form: str
    coefficients: Annotated[list[_Coefficient], Field(min_length=1)]
    scatter: list[list[_Number]]
    run_to_run: list[list[_Number]] | None = None


def load_next_use(path: Path) -> NextUseScatter:
    """Read the scatter from a file written by `inercal repeat`.

    Raises
    ------
    InputError
        If the file does not exist, or contains something else.
    """
    found = read_document(path, _File, "inercal repeat")
    names = tuple(one.name for one in found.coefficients)
    covariance = _square(path, "scatter", found.scatter, len(names))
    run_to_run = covariance
    if found.run_to_run is not None:
        run_to_run = _square(path, "run_to_run", found.run_to_run, len(names))
    dof = np.array([one.dof for one in found.coefficients])
    return NextUseScatter(
        path.name, found.sensor.name, found.frame, found.form, names, covariance,
        run_to_run, dof,
    )  # fmt: skip


def _square(path: Path, key: str, rows: list[list[float]], size: int) -> Array:
    matrix = np.array([row for row in rows if len(row) == size])
    if matrix.shape != (size, size):
        raise InputError(f"{path}: {key} must be {size} × {size}", file=path)
    return matrix


UncertaintyName = Literal["session", "next_use"]


@dataclass(frozen=True)
class LimitResult:
    """A coefficient with its limits and the result of the test, in SI units.

    Parameters
    ----------
    name : str
    lower, upper : float
        Limits; a missing limit is infinite.
    value, std : float
        Value and its standard uncertainty.
    guard : float
        Guard band.
    result : str
        One of `inercal.estimation.uncertainty.conformity.RESULTS`.
    probability : float
        Probability that the true value is within the limits.
    """

    name: str
    lower: float
    upper: float
    value: float
    std: float
    guard: float
    result: Result
    probability: float


@dataclass(frozen=True)
class Conformity:
    """Whether a calibration conforms to the limits of its coefficients.

    Parameters
    ----------
    rule : DecisionRule
    limits : tuple of LimitResult
    probability : float
        Probability that all true values are within their limits.
    uncertainty : "session" or "next_use"
        Whether U of the session or U of the next use was used to judge the limits.
    """

    rule: DecisionRule
    limits: tuple[LimitResult, ...]
    probability: float
    uncertainty: UncertaintyName = "session"

    @property
    def result(self) -> Result:
        """The worst result among the limits."""
        return RESULTS[max(RESULTS.index(one.result) for one in self.limits)]

    @property
    def beyond(self) -> tuple[str, ...]:
        """Names of the coefficients that are beyond their limits."""
        return tuple(one.name for one in self.limits if one.result.endswith("fail"))

    @property
    def accepted(self) -> bool:
        """Whether every coefficient is within its limits by at least the guard band."""
        return self.result == "pass"


@dataclass(frozen=True)
class Specification:
    """Limits of coefficients, and the decision rule.

    Parameters
    ----------
    limits : mapping of str to (float, float)
        Lower and upper limit of each coefficient in SI units, by full name; a missing limit is
        infinite.
    rule : DecisionRule
    next_use : NextUseScatter or None
        Scatter of the sensor between uses; if None, the uncertainty of the session is used.
    """

    limits: Mapping[str, tuple[float, float]]
    rule: DecisionRule
    next_use: NextUseScatter | None = None

    def judge(self, names: Sequence[str], value: Array, covariance: Array) -> Conformity:
        """Judge whether the coefficients conform to their limits.

        If there is a scatter S between uses, it counts twice, because both this session and the
        next use scatter about the mean. If S has ν degrees of freedom and C is the covariance of
        the session, then U² = 2 t_ν² S + 4 C, and U/2 is used as u.

        Parameters
        ----------
        names : sequence of str
            Names of the coefficients, which must include all coefficients with limits.
        value : (p,) array
            SI.
        covariance : (p, p) array
        """
        chosen = [list(names).index(name) for name in self.limits]
        y, v = value[chosen], covariance[np.ix_(chosen, chosen)]
        if self.next_use is not None:
            v = _next_use_covariance(v, *self.next_use.of(tuple(self.limits)))
        std = np.sqrt(np.diag(v))
        lower, upper = np.array(list(self.limits.values())).T
        guard = self.rule.guard(std)
        each = zip(
            self.limits, lower.tolist(), upper.tolist(), y.tolist(), std.tolist(), guard.tolist(),
            [RESULTS[k] for k in judge(y, lower, upper, guard)],
            conformance_probability(y, std, lower, upper).tolist(), strict=True,
        )  # fmt: skip
        joint = joint_conformance_probability(y, v, lower, upper)
        which = "session" if self.next_use is None else "next_use"
        return Conformity(self.rule, tuple(LimitResult(*one) for one in each), joint, which)


def _next_use_covariance(session: Array, scatter: Array, dof: Array) -> Array:
    """Return a (p, p) covariance with U/2 of the next use as standard uncertainties."""
    by = expanded_uncertainty(np.ones(len(dof)), dof) / COVERAGE
    return session + 2 * scatter * np.outer(by, by)


def limit_text(lower: float, upper: float, term: ErrorTerm) -> str:
    """Return limits in the unit of the coefficient, such as "-20 to 20 mg" or "≤ 50 µg/g²"."""
    low, high = (f"{limit / term.si:.6g}" for limit in (lower, upper))
    if not isfinite(lower):
        return f"≤ {high} {term.unit}"
    if not isfinite(upper):
        return f"≥ {low} {term.unit}"
    return f"± {high} {term.unit}" if lower == -upper else f"{low} to {high} {term.unit}"


def conformity_lines(
    conformity: Conformity | None, sensor: Sensor, verdict: Verdict | None
) -> list[str]:
    """Return a summary line, and a line for each limit whose result is not "pass".

    The list is empty if nothing was judged.
    """
    if conformity is None:
        return []
    rule, count = conformity.rule, len(conformity.limits)
    passed = sum(one.result == "pass" for one in conformity.limits)
    band = "no guard band" if rule.name == "simple" else f"guard band {rule.factor:g} U"
    which = ", U of the next use" if conformity.uncertainty == "next_use" else ""
    lines = [
        f"specification: {conformity.result}; {passed} of {count} limits passed ({band}{which}); "
        f"probability that all conform: {probability_text(conformity.probability)}"
    ]
    if verdict is not None and verdict.grade == "unreliable":
        lines[0] += "; U is doubtful because the result is not to be relied on"
    for one in sorted(conformity.limits, key=lambda one: -RESULTS.index(one.result)):
        if one.result != "pass":
            row = limit_row(one, sensor.coefficient(one.name))
            lines.append(
                f"{row.name}: {row.result}: {row.value} ± {row.expanded} {row.unit}, limit "
                f"{row.limit}, probability of conformity {row.probability}"
            )
    return lines


class LimitRow(NamedTuple):
    """A limit in the unit of its coefficient, as text."""

    name: str
    value: str
    expanded: str
    unit: str
    limit: str
    guard: str
    result: str
    probability: str


def limit_row(one: LimitResult, term: ErrorTerm) -> LimitRow:
    """Return a limit and its coefficient as text."""
    value, expanded = format_value_and_uncertainty(
        one.value / term.si, COVERAGE * one.std / term.si
    )
    limit = limit_text(one.lower, one.upper, term)
    guard = format_value_and_uncertainty(0.0, one.guard / term.si)[1]
    chance = probability_text(one.probability)
    return LimitRow(one.name, value, expanded, term.unit, limit, guard, one.result, chance)


def probability_text(probability: float) -> str:
    """Return a probability as text in percent, but never "0 %" or "100 %".

    It has two significant digits, or so many that its distance from 100 % has two.
    """
    if probability < 1e-4:
        return "< 0.01 %"
    if probability > 1 - 1e-4:
        return "> 99.99 %"
    percent = 100 * probability
    return f"{float(format_value_and_uncertainty(percent, min(percent, 100 - percent))[0]):g} %"


def conformity_object(conformity: Conformity) -> dict[str, Any]:
    """Return the conformity as a JSON object in SI units; a missing limit is null."""
    return {
        "rule": conformity.rule.name,
        "factor": float(conformity.rule.factor),
        "uncertainty": conformity.uncertainty,
        "result": conformity.result,
        "probability": conformity.probability,
        "limits": record_object(conformity.limits),
    }
