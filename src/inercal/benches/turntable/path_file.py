"""The path of a turntable from a table in a file, one row a step.

Columns are named in the header, quantities with their unit; cells that a step has no use for stay
empty::

    label, kind,     outer [°], middle [°], inner [°], seconds [s], axis,   angle [°], rate [°/s]
    p1,    position, 0,         90,         0,         90,          ,       ,
    x+,    rotation, ,          ,           ,          ,            middle, 720,       10

A rotation whose row has the axes' angles brings them there first.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import PATHS
from inercal.errors import InputError
from inercal.io.column_table import Table
from inercal.io.read import read_table
from inercal.plan import Position, Rotation, Step, TableStep
from inercal.units import si_factor

_WORDS = ("label", "kind", "axis")
_LIKE = {"seconds": "s", "angle": "°", "rate": "°/s"}
_LONGEST = 86_400.0  # s
_AXES = 3  # of the paths that have a name
_HEADED = re.compile(r"(\w+) *\[(.+)\]")


def read_path(path: str | Path, axes: Sequence[str]) -> tuple[TableStep, ...]:
    """Read a path.

    Parameters
    ----------
    path : path
    axes : sequence of str
        Names of the table's axes, outermost first, as `Turntable.names`.

    Raises
    ------
    InputError
        One line that names the file and the line: a column that is none, or a step that is not
        whole.
    """
    path = Path(path)
    table = read_table(path, text=_WORDS)
    numbers = _quantities(path, table, axes)
    words = {
        name: [str(cell).strip() for cell in table.columns[name]]
        for name in _WORDS
        if name in table.columns
    }
    rows = len(words["label"])
    steps: list[TableStep] = []
    for row in range(rows):
        own = {name: values[row] for name, values in words.items()}
        size = {name: float(values[row]) for name, values in numbers.items()}
        try:
            steps.append(_parse_step(own, size, axes))
            if own["label"] in words["label"][:row]:
                raise InputError(f"label {own['label']!r} comes twice")
        except InputError as error:
            where = f"line {table.first_line + row}" if table.first_line else f"row {row + 1}"
            raise InputError(f"{path.name} {where}: {error}") from None
    return tuple(steps)


def _quantities(path: Path, table: Table, axes: Sequence[str]) -> dict[str, Array]:
    """Return the columns of numbers, SI, by name; all columns are known afterwards."""
    likes = dict.fromkeys(axes, "°") | _LIKE
    found: dict[str, Array] = {}
    for header in table.names:
        if header in _WORDS:
            continue
        headed = _HEADED.fullmatch(header)
        name = headed[1] if headed else header
        if name not in likes:
            possible = (*_WORDS, *(f"{name} [{like}]" for name, like in likes.items()))
            raise InputError(
                f"{path.name}: no column {header!r} is known, but {', '.join(possible)}"
            )
        if headed is None:
            raise InputError(f"{path.name}: column {name!r} needs a unit: {name} [{likes[name]}]")
        if name in found:
            raise InputError(f"{path.name}: column {name!r} comes twice")
        try:
            size = si_factor(headed[2], likes[name])
        except InputError as error:
            raise InputError(f"{path.name}: column {header!r}: {error}") from None
        found[name] = size * table.numbers(header)
    for name in ("label", "kind"):
        if name not in table.names:
            raise InputError(f"{path.name}: no column {name!r}; it has {', '.join(table.names)}")
    return found


def _parse_step(words: dict[str, str], size: dict[str, float], axes: Sequence[str]) -> TableStep:
    label, kind = words["label"], words["kind"]
    if not label:
        raise InputError("a step needs a label")
    if kind == "position":
        _refuse_needless(words, size, "position", ("axis", "angle", "rate"))
        angles = _angles(size, axes)
        if angles is None:
            raise InputError(f"position {label}: give the angles of {', '.join(axes)}")
        return Position(label, angles, _seconds(size, label))
    if kind != "rotation":
        raise InputError(f"kind {kind!r}; it is position or rotation")
    _refuse_needless(words, size, "rotation", ("seconds",))
    axis = words.get("axis", "")
    if axis not in axes:
        raise InputError(f"rotation {label}: axis {axis!r}; it is {' or '.join(axes)}")
    angle, rate = _required_quantity(size, "angle", label), _required_quantity(size, "rate", label)
    if angle == 0:
        raise InputError(f"rotation {label}: its angle is 0; give one, negative for the other way")
    if rate <= 0:
        raise InputError(
            f"rotation {label}: its rate is {degrees(rate):.6g} °/s; give it > 0: the angle says "
            "which way"
        )
    return Rotation(label, axes.index(axis), angle, rate, _angles(size, axes))


def _seconds(size: dict[str, float], label: str) -> float:
    seconds = _required_quantity(size, "seconds", label)
    if not 0 < seconds <= _LONGEST:
        what = "more than a day" if seconds > 0 else "give it > 0"
        raise InputError(f"position {label}: {seconds:.6g} s; {what}")
    return seconds


def _angles(size: dict[str, float], axes: Sequence[str]) -> tuple[float, ...] | None:
    """Return the axes' angles; None where all cells are empty."""
    angles = tuple(size.get(axis, np.nan) for axis in axes)
    if np.isnan(angles).all():
        return None
    if np.isnan(angles).any():
        raise InputError(f"give the angles of all axes, {', '.join(axes)}, or of none")
    return angles


def _required_quantity(size: dict[str, float], name: str, label: str) -> float:
    value = size.get(name, np.nan)
    if np.isnan(value):
        raise InputError(f"{label}: {name} is missing")
    return value


def _refuse_needless(
    words: dict[str, str], size: dict[str, float], kind: str, names: Sequence[str]
) -> None:
    for name in names:
        if words.get(name) or not np.isnan(size.get(name, np.nan)):
            raise InputError(f"a {kind} has no {name}: leave the cell empty")


def path_plan(
    options: Mapping[str, Any], bench: Turntable, folder: Path, plan: Callable[[], tuple[Step, ...]]
) -> Callable[[], tuple[Step, ...]]:
    """Return the plan; of a file it is read when it is asked for.

    Parameters
    ----------
    options : mapping
        Keys of [method] that say something of the plan.
    bench : Turntable
        Its axes name the columns of a file.
    folder : Path
        Where a file is looked for.
    plan : callable
        The plan of a path by name.

    Raises
    ------
    InputError
        A path that is neither known nor a file, or a file and `seconds`.
    """
    name = options.get("path")
    if name is None or name in PATHS:
        if len(bench.axes) != _AXES:
            return _refusing_plan(
                f"path: {name or next(iter(PATHS))} is of three axes, this table has "
                f"{len(bench.axes)}: name a file of its steps"
            )
        return plan
    file = folder / name
    if not file.is_file():
        raise InputError(f"[method] path {name!r}: no such file; or {', '.join(PATHS)}")
    if "seconds" in options:
        raise InputError(f"[method] seconds: {name} says how long positions last; leave it out")
    return partial(read_path, file, bench.names)


def _refusing_plan(words: str) -> Callable[[], tuple[Step, ...]]:
    """Return a plan that is refused where it is asked for: a calibration can do without."""

    def plan() -> tuple[Step, ...]:
        raise InputError(words)

    return plan
