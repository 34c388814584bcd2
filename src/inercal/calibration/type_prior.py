"""Read and write priors for new sensors, which earlier sensors of the type determine.

A prior is a file `*.prior.toml` with schema "inercal/type-prior/1", in SI: `form`, `correlations`
(how they were estimated), and a table `[[coefficient]]` for each coefficient with `name`, `unit`,
`mean`, `sd`, `dof`, `between_sensors`, `mean_share` and two rows of correlations: `correlation`
with the coefficients of the same axis or sensor, and `other_axis` with the coefficients of another
axis that has the same prior. A name without an axis, such as "kip", applies to every axis.
`[[readout]]` states the nominal readout to which the coefficients refer, and `[[sensor]]` the
sensors that were used.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inercal.basics.arrays import Array
from inercal.basics.atomic_files import write_text
from inercal.basics.documents import first_problem, origin
from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.small_files import read_toml
from inercal.physics.sensors import TABLES
from inercal.physics.sensors.coefficient_tables import ErrorTerm

SCHEMA = "inercal/type-prior/1"
_TABLES = ("coefficient", "readout", "sensor", "outlying")
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Share = Annotated[float, Field(ge=0, le=1)]
_Correlation = Annotated[float, Field(ge=-1, le=1)]


class _Content(BaseModel):
    model_config = ConfigDict(frozen=True, defer_build=True)


class CoefficientPrior(_Content):
    """Prior of one coefficient, SI; `sd` is U/2, where ± U contains 95.45 % of new sensors."""

    name: str
    unit: str
    mean: _Number
    sd: _Positive
    dof: _Positive  # of the Student t distribution with the same U
    between_sensors: Annotated[float, Field(ge=0, allow_inf_nan=False)]  # REML, k = 1
    mean_share: _Share  # of the variance sd², due to the uncertainty of the mean
    measurement_share: _Share  # of the observed scatter, due to the uncertainty of measurement
    correlation: tuple[_Correlation, ...]
    other_axis: tuple[_Correlation, ...]


class TypeReadout(_Content):
    """Nominal readout of an axis, or of every axis that measures this quantity if `axis` is ""."""

    axis: str
    measures: Literal["f", "w", "m"]
    unit: str
    scale: _Number
    offset: _Number


class SourceSensor(_Content):
    """A sensor that was used, with its calibration and, if known, the SHA-256 of its recording."""

    name: str
    source: str
    recording_sha256: str = ""


class OutlyingSensor(_Content):
    """A coefficient that is too far from those of the other sensors, with its p-value."""

    sensor: str
    coefficient: str
    p: _Share


class TypePrior(_Content):
    """The prior for a new sensor, derived from earlier sensors of the same type."""

    schema_: Literal["inercal/type-prior/1"] = Field(default=SCHEMA, alias="schema")
    type_name: str = ""
    form: str
    correlations: str
    count: Annotated[int, Field(ge=1)]  # number N of sensors, or of axes
    coefficient: Annotated[tuple[CoefficientPrior, ...], Field(min_length=1)]
    readout: Annotated[tuple[TypeReadout, ...], Field(min_length=1)]
    sensor: tuple[SourceSensor, ...]
    outlying: tuple[OutlyingSensor, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(one.name for one in self.coefficient)

    def term(self, name: str) -> ErrorTerm:
        """Return the line of the coefficient table, with the printed unit.

        Raises
        ------
        InputError
            There is no such coefficient.
        """
        axis, term = CoefficientName(name).parts
        kinds = [TABLES[one.measures] for one in self.readout if one.axis == axis]
        found = [line for table in kinds for line in table if line.name == term]
        if not found:
            raise InputError(f"type prior: there is no coefficient {name!r}", names=(name,))
        return found[0]

    def covariance(self, places: Iterable[tuple[int, str]]) -> Array:
        """Return the covariance of coefficients of one sensor, SI.

        Parameters
        ----------
        places : iterable of (int, str)
            Index of each coefficient's prior, and its axis.
        """
        chosen = tuple(places)
        rows = [
            [
                (one.correlation if axis == other_axis else one.other_axis)[j]
                * one.sd
                * self.coefficient[j].sd
                for j, other_axis in chosen
            ]
            for i, axis in chosen
            for one in [self.coefficient[i]]
        ]
        return np.array(rows)

    def to_object(self) -> dict[str, Any]:
        """Return the content of the file."""
        return {"schema": SCHEMA} | self.model_dump(exclude={"schema_"})

    def save(self, path: str | Path) -> Path:
        """Write the file completely or not at all; return its path."""
        return write_text(path, _toml_text(self.to_object() | origin()))


def load_type_prior(path: Path) -> TypePrior:
    """Read a prior that `inercal prior` wrote.

    Raises
    ------
    InputError
        The file does not exist, or contains something else.
    """
    content = read_toml(path, "file of inercal prior")
    try:
        found = TypePrior.model_validate(content)
    except ValidationError as error:
        place, reason = first_problem(error)
        raise InputError(
            f"{path}: {place or 'the whole file'}: {reason}; give a file that inercal prior wrote",
            file=path,
        ) from None
    p = len(found.coefficient)
    for one in found.coefficient:
        with error_location(path):
            found.term(one.name)
        if len(one.correlation) != p or len(one.other_axis) != p:
            raise InputError(
                f"{path}: {one.name}: correlation and other_axis must have {p} values each",
                file=path,
                names=(one.name,),
            )
    return found


def _toml_text(content: Mapping[str, Any]) -> str:
    """Return a document of numbers, texts, lists and tables as TOML."""
    tables = {key: content[key] for key in _TABLES if content[key]}
    lines = ["# Written by inercal prior; all values are in SI units"]
    lines += [f"{key} = {_toml(value)}" for key, value in content.items() if key not in tables]
    for key, each in tables.items():
        for table in each:
            lines += ["", f"[[{key}]]", *(f"{name} = {_toml(x)}" for name, x in table.items())]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    # JSON is TOML for texts, finite numbers and lists of these, except for the character DEL.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
