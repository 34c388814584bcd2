"""The strict schema of calibration files, and the checks of their numbers.

Even a file with a correct hash may come from another program, or may have been edited by hand and
hashed again. Types are not converted: `true` or a number in quotation marks is not accepted as a
number.
"""

import math
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, ValidationError

from inercal.basics.documents import Positive, Record, Share, first_problem, to_utc
from inercal.basics.errors import InputError
from inercal.calibration.forms import Frame
from inercal.calibration.verdict_object import VerdictRecord
from inercal.estimation.uncertainty.conformity import Result, RuleName
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Form

_Cosine = Annotated[float, Field(ge=-1.001, le=1.001)]
_Direction = Annotated[list[_Cosine], Field(min_length=3, max_length=3)]
_Range = Annotated[list[float], Field(min_length=2, max_length=2)]

_ROUNDING = 1e-9  # tolerance for a correlation, or for the elements of a rotation


class _Readout(Record):
    model_config = ConfigDict(extra="forbid")

    scale: float
    offset: float
    unit: str
    full_scale: float | None = None


class _Axis(Record):
    name: str
    measures: Measures
    i: _Direction
    p: _Direction
    readout: _Readout


class _Sensor(Record):
    name: str
    form: Form
    reference_temperature_K: float
    axes: Annotated[list[_Axis], Field(min_length=1)]


class _Coefficient(Record):
    name: str
    value: float
    std: Positive
    unit: str


class _SharedError(Record):
    name: str
    unit: str
    std: Positive
    determination: str
    date: str | None
    covariance: list[float]


class _BenchEstimate(Record):
    name: str
    unit: str
    meaning: str
    value: float
    std: Positive
    own_std: Positive
    stated: float
    stated_std: Positive


class _LimitRecord(Record):
    name: str
    lower: float | None
    upper: float | None
    value: float
    std: Positive
    guard: Positive
    result: Result
    probability: Share


class ConformityRecord(Record):
    """The conformity of the calibration that the file states."""

    rule: RuleName
    factor: Annotated[float, Field(gt=0)]
    uncertainty: Literal["session", "next_use"]
    result: Result
    probability: Share
    limits: Annotated[list[_LimitRecord], Field(min_length=1)]


class CalibrationRecord(Record):
    """The fields of a calibration file, except its schema and its hash."""

    sensor: _Sensor
    method: str
    estimator: str
    coefficients: list[_Coefficient]
    covariance: list[list[float]]
    frame: Frame
    mount: Annotated[list[_Direction], Field(min_length=3, max_length=3)]
    conditions: dict[str, str]
    provenance: dict[str, str]
    notes: list[str]
    verdict: VerdictRecord | None = None
    shared: list[_SharedError] | None = None
    validity: dict[Literal["rate", "force", "temperature", "field"], _Range] | None = None
    job: dict[str, str] = Field(default_factory=dict[str, str])
    conformity: ConformityRecord | None = None
    bench_estimates: list[_BenchEstimate] | None = None


def checked_record(content: dict[str, Any]) -> CalibrationRecord:
    """Check that the content of a calibration file follows the schema without contradictions.

    Parameters
    ----------
    content : dict
        The JSON object.

    Raises
    ------
    InputError
        If a field is invalid: a wrong type, an unknown word, a number that is not finite, a
        coefficient that is listed twice, a standard deviation that contradicts the covariance, an
        invalid covariance, a mounting matrix that is not a rotation, a blank name of the sensor, or
        a time of creation that is not in ISO 8601. The error names the first invalid field.
    """
    try:
        file = CalibrationRecord.model_validate(content)
    except ValidationError as error:
        key, reason = first_problem(error)
        raise InputError(f"{key}: {reason}", key=key) from None
    names = [one.name for one in file.coefficients]
    if len(set(names)) < len(names):
        repeated = tuple(name for name, count in Counter(names).items() if count > 1)
        raise InputError(
            f"coefficients: {repeated[0]} is stated more than once",
            key="coefficients",
            names=repeated,
        )
    _require_covariance(file.covariance, file.coefficients)
    if not _is_rotation(tuple(map(tuple, file.mount))):
        raise InputError("mount: the matrix is not a rotation", key="mount")
    if not file.sensor.name.strip():
        raise InputError("sensor.name: it is blank", key="sensor")
    _require_time(file.provenance.get("created", ""))
    return file


def _require_time(created: str) -> None:
    """Raise an error if a time of creation is stated that is not a time."""
    try:
        _ = created and to_utc(created)
    except ValueError:
        raise InputError(
            f"provenance.created: {created!r} is not a time in ISO 8601", key="created"
        ) from None


@lru_cache(maxsize=16)  # a register may contain thousands of calibrations with the same mounting
def _is_rotation(rows: tuple[tuple[float, ...], ...]) -> bool:
    matrix = np.array(rows, dtype=float)
    orthonormal = np.max(np.abs(matrix @ matrix.T - np.eye(3))) <= 1e-6
    return bool(orthonormal and np.linalg.det(matrix) >= 0)


def _require_covariance(rows: list[list[float]], coefficients: Sequence[_Coefficient]) -> None:
    """Raise an error if the covariance is invalid or contradicts the standard deviations."""
    p = len(coefficients)
    if [len(row) for row in rows] != [p] * p:
        raise InputError(
            f"covariance: {p} coefficients need {p} rows of {p} numbers", key="covariance"
        )
    covariance = np.array(rows, dtype=float).reshape(p, p)
    variance = np.diag(covariance)
    for one, each in zip(coefficients, variance.tolist(), strict=True):
        if each < 0:
            what = f"the variance of {one.name} is negative"
        elif abs(math.sqrt(each) - one.std) > 1e-6 * one.std:
            what = f"the variance of {one.name} contradicts its std {one.std:g}"
        else:
            continue
        raise InputError(f"covariance: {what}", key="covariance", names=(one.name,))
    size = np.sqrt(np.where(variance > 0, variance, 1.0))
    with np.errstate(over="ignore", under="ignore"):
        correlation = covariance / size / size[:, None]
    if not np.isfinite(correlation).all():
        raise InputError("covariance: a correlation exceeds 1", key="covariance")
    if p and np.abs(correlation - correlation.T).max() > _ROUNDING:
        raise InputError("covariance: the matrix is not symmetric", key="covariance")
    try:
        np.linalg.cholesky(correlation + 10 * p * _ROUNDING * np.eye(p))
    except np.linalg.LinAlgError:
        raise InputError(
            "covariance: the matrix is not positive semidefinite", key="covariance"
        ) from None
