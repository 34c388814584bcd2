"""Read from a file of `inercal repeat` how much a sensor's coefficients change between uses.

Schema "inercal/repeatability/1": `sensor`, `frame`, `form`, `coefficients` (a list of name, unit,
value and the uncertainties of mean and next use, SI), `scatter` (covariance that the next use adds,
in that order) and `dof`. Further fields are only for people who read the file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, Field

from inercal.basics.arrays import Array
from inercal.basics.documents import read_document
from inercal.basics.errors import InputError

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
