"""Read and write qualifications as versioned JSON, `*.qualification.json`.

Schema "inercal/qualification/1": `kind`, `bench` (kind and name), `determination`, `date`,
`valid_until`, `method`, `instrument`, `certificate`, `parameters` (a list of name, unit, value,
std, determination, date, valid_until; SI), `covariance` in that order, `test` (chi2, dof, p_value,
suspects), `unseen`, `remarks`, `provenance`, `withdrawn`, and `sha256`, the hash of the other keys.
"""

import datetime as dt
import hashlib
import json
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inercal.basics.atomic_files import write_text
from inercal.basics.documents import first_problem, record_object
from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.benches.qualification.result import (
    Qualification,
    QualifiedParameter,
    require_covariance,
)

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
