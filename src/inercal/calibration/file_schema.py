"""What a calibration file may hold: types by a strict schema, and what its numbers must satisfy.

A file whose hash is right may still have been written by another program, or by hand and hashed
again. Nothing is converted: a number in quotation marks or `true` is no number.
"""

import math
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inercal.basics.errors import InputError
from inercal.calibration.forms import Frame
from inercal.estimation.uncertainty.conformity import Result, RuleName
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Form

_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
_Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
_Text = Annotated[str, Field(strict=True)]
_Count = Annotated[int, Field(strict=True, ge=0)]
_Cosine = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1.001, le=1.001)]
_Direction = Annotated[list[_Cosine], Field(min_length=3, max_length=3)]
_Range = Annotated[list[_Number], Field(min_length=2, max_length=2)]
_Texts = dict[_Text, _Text]

_ROUNDING = 1e-9  # of a correlation, or of a rotation's elements


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")


class _Readout(_Strict):
    model_config = ConfigDict(strict=True, extra="forbid")

    scale: _Number
    offset: _Number
    unit: _Text
    full_scale: _Number | None = None


class _Axis(_Strict):
    name: _Text
    measures: Measures
    i: _Direction
    p: _Direction
    readout: _Readout


class _Sensor(_Strict):
    name: _Text
    form: Form
    reference_temperature_K: _Number
    axes: Annotated[list[_Axis], Field(min_length=1)]


class _Coefficient(_Strict):
    name: _Text
    value: _Number
    std: _Positive
    unit: _Text


class _Test(_Strict):
    name: _Text
    chi2: _Number | None
    dof: _Count
    p_value: _Number | None
    p_among_all: _Number | None


class _Component(_Strict):
    name: _Text
    value: _Number | None
    std: _Number | None
    unit: _Text


class _Shift(_Strict):
    coefficient: _Text
    in_U: _Number | None


class _Remaining(_Strict):
    chi2: _Number | None
    dof: _Count
    p_value: _Number | None


class _Change(_Strict):
    section: _Text
    key: _Text
    value: _Text | _Number | bool | list[_Text]


class _Advice(_Strict):
    reason: _Text
    changes: list[_Change]
    action: _Text
    chi2: _Number | None


class _Suspect(_Strict):
    name: _Text
    kind: _Text
    components: list[_Component]
    chi2: _Number | None
    dof: _Count
    p_value: _Number | None
    remaining: _Remaining | None = None
    largest_shift: _Shift
    not_told_from: list[_Text]


class _NoiseFactor(_Strict):
    what: _Text
    channel: _Text | None
    factor: _Number | None


class _RoundedChannel(_Strict):
    channel: _Text
    step: _Positive
    noise: _Number
    dead_band: bool
    std: _Positive


class _Verdict(_Strict):
    grade: _Text
    word: _Text = ""
    reasons: list[_Text]
    tests: list[_Test]
    suspect: _Suspect | None
    best_cause: _Suspect | None = None
    advice: list[_Advice] = []
    scatter: _Number | None = None
    noise: list[_NoiseFactor] = []
    rounding: list[_RoundedChannel] | None = None


class _SharedError(_Strict):
    name: _Text
    unit: _Text
    std: _Positive
    determination: _Text
    date: _Text | None
    covariance: list[_Number]


class _BenchEstimate(_Strict):
    name: _Text
    unit: _Text
    meaning: _Text
    value: _Number
    std: _Positive
    own_std: _Positive
    stated: _Number
    stated_std: _Positive


class _LimitResult(_Strict):
    name: _Text
    lower: _Number | None
    upper: _Number | None
    value: _Number
    std: _Positive
    guard: _Positive
    result: Result
    probability: _Share


class _Conformity(_Strict):
    rule: RuleName
    factor: Annotated[_Number, Field(gt=0)]
    uncertainty: Literal["session", "next_use"]
    result: Result
    probability: _Share
    limits: Annotated[list[_LimitResult], Field(min_length=1)]


class _File(_Strict):
    sensor: _Sensor
    method: _Text
    estimator: _Text
    coefficients: list[_Coefficient]
    covariance: list[list[_Number]]
    frame: Frame
    mount: Annotated[list[_Direction], Field(min_length=3, max_length=3)]
    conditions: _Texts
    provenance: _Texts
    notes: list[_Text]
    verdict: _Verdict | None = None
    shared: list[_SharedError] | None = None
    validity: dict[Literal["rate", "force", "temperature"], _Range] | None = None
    job: _Texts = {}
    conformity: _Conformity | None = None
    bench_estimates: list[_BenchEstimate] | None = None


def require_valid(content: dict[str, Any]) -> None:
    """Refuse the content of a calibration file that contradicts the schema or itself.

    Parameters
    ----------
    content : dict
        The JSON object.

    Raises
    ------
    InputError
        Its first wrong field: a type, a word that is not possible, a number that is not finite, a
        coefficient twice, a standard deviation that contradicts the covariance, a covariance that
        is none, a mounting that is no rotation.
    """
    try:
        file = _File.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = _dotted(first["loc"])
        raise InputError(f"{key}: {_reason(first['type'], first['msg'])}", key=key) from None
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
        raise InputError("mount: the matrix is no rotation", key="mount")


@lru_cache(maxsize=16)  # a register holds thousands of calibrations of one mounting
def _is_rotation(rows: tuple[tuple[float, ...], ...]) -> bool:
    matrix = np.array(rows, dtype=float)
    orthonormal = np.max(np.abs(matrix @ matrix.T - np.eye(3))) <= 1e-6
    return bool(orthonormal and np.linalg.det(matrix) >= 0)


def _require_covariance(rows: list[list[float]], coefficients: Sequence[_Coefficient]) -> None:
    """Refuse a matrix that is no covariance, or whose diagonal contradicts the deviations."""
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


def _dotted(loc: tuple[int | str, ...]) -> str:
    """Return the place of a field: coefficients[3].std."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in loc).lstrip(".")


def _reason(kind: str, message: str) -> str:
    reasons = {"missing": "is missing", "finite_number": "is not finite"}
    return reasons.get(kind, message[0].lower() + message[1:])
