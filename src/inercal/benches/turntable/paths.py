"""Provide paths of a turntable: standard paths, and paths that a file contains as a table.

The table has one row per step. The header names the columns, with the unit of each quantity. Cells
that a step does not use are empty::

    label, kind,     outer [°], middle [°], inner [°], seconds [s], axis,   angle [°], rate [°/s]
    p1,    position, 0,         90,         0,         90,          ,       ,
    x+,    rotation, ,          ,           ,          ,            middle, 720,       10

If the row of a rotation contains angles of the axes, the axes are first brought to these angles.

The standard paths are for a three-axis table with the axes Z, X, Y (outer to inner).

"paper" warms up, holds ten positions for the accelerometers, turns 720° at 10 °/s about each axis
for the gyros and rests. The figure of the positions in the source is not available, so these ten
are a reconstruction. "fast" turns ±1080° at 30 °/s in the same time. "discrete" has each body axis
up and down, and turns ±1080° at 30 °/s about the vertical in each of these six positions.
"systematic" rests in nineteen positions, with a quarter turn about a level axis between them. Each
body axis turns both ways, and each face is up at least twice. The middle axis is always level, and
the inner axis is level while the middle one is at 0° or 180°.

Source: Liu Zhiwei, Cui Min, Zhang Peng, Xu Wenwu (North University of China), fast MIMU calibration
system.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import is_file
from inercal.basics.units import si_factor
from inercal.benches.turntable.bench import Turntable
from inercal.physics.plan import Position, Rotation, Step, TableStep
from inercal.physics.section_settings import key_error
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.read import read_table

_HOME = (0.0, 0.0, 0.0)
# Angles of the outer, middle and inner axis in degrees.
_TEN = (
    (0, 0, 0), (0, 90, 0), (0, 180, 0), (0, 270, 0), (0, 0, 90),
    (0, 0, -90), (90, 45, 0), (90, 0, 45), (180, 45, 90), (180, -45, 45),
)  # fmt: skip
# Angles for each body axis that is up.
_SIX = {
    "z_p": (0, 0, 0), "y_p": (0, 90, 0), "z_a": (0, 180, 0), "y_a": (0, 270, 0),
    "x_a": (0, 0, 90), "x_p": (0, 0, -90),
}  # fmt: skip
# Angles of the middle and the inner axis in degrees; one of them is a quarter turn further
_NINETEEN = (
    (0, 0), (90, 0), (180, 0), (270, 0), (180, 0), (90, 0), (0, 0),
    (0, 90), (0, 180), (0, 270), (0, 180), (0, 90),
    (90, 90), (180, 90), (270, 90), (180, 90), (90, 90), (0, 90), (0, 0),
)  # fmt: skip
_FIRST_LONGER, _LAST_LONGER = 1.75, 2.25  # times the duration of a rest
_AXIS = {"x": 1, "y": 2, "z": 0}
_WARM_UP = Position("warm-up", _HOME, 120.0)
_REST = Position("rest", _HOME, 72.0)
_SLOW, _FAST = radians(10), radians(30)  # rad/s
_TWICE, _THRICE = radians(720), radians(1080)


def path_by_name(path: str = "paper", seconds: float = 90.0) -> tuple[TableStep, ...]:
    """Return a path by name, with holds of `seconds`.

    Raises
    ------
    InputError
        There is no such path; the message lists the paths.
    """
    if path not in PATHS:
        raise InputError(
            f"path {path!r} is unknown; the paths are {', '.join(PATHS)}", key="path", names=(path,)
        )
    return PATHS[path](seconds)


def paper_path(seconds: float = 90.0) -> tuple[TableStep, ...]:
    """Return the path in the source, with holds of `seconds`."""
    turns = (Rotation(f"{x}+", axis, _TWICE, _SLOW, _HOME) for x, axis in _AXIS.items())
    return (_WARM_UP, *_positions(seconds), *turns, _REST)


def fast_path(seconds: float = 90.0) -> tuple[TableStep, ...]:
    """Return the path of the source with turns at 30 °/s in both directions."""
    turns = (
        Rotation(f"{x}{sign}", axis, angle, _FAST, _HOME)
        for x, axis in _AXIS.items()
        for sign, angle in (("+", _THRICE), ("-", -_THRICE))
    )
    return (_WARM_UP, *_positions(seconds), *turns, _REST)


def discrete_path(seconds: float = 90.0) -> tuple[TableStep, ...]:
    """Return six positions with holds of `seconds` and steady turns about the vertical."""
    steps: list[TableStep] = [_WARM_UP]
    for name, angles in _SIX.items():
        outer, middle, inner = map(radians, angles)
        steps.append(Position(name, (outer, middle, inner), seconds))
        steps.append(Rotation(f"{name}+", 0, _THRICE, _FAST))
        steps.append(Rotation(f"{name}-", 0, -_THRICE, _FAST))
    return tuple(steps)


def systematic_path(seconds: float = 40.0) -> tuple[TableStep, ...]:
    """Return nineteen rests of `seconds` between quarter turns; the first and last are longer."""
    return quarter_turn_path(
        [(0, middle // 90, inner // 90) for middle, inner in _NINETEEN], seconds
    )


def quarter_turn_path(
    attitudes: Sequence[tuple[int, int, int]], seconds: float
) -> tuple[Position, ...]:
    """Return rests of `seconds` at multiples of 90° of the axes; the first and last are longer."""
    longer = {0: _FIRST_LONGER, len(attitudes) - 1: _LAST_LONGER}
    return tuple(
        Position(f"p{k + 1}", _quarters(one), longer.get(k, 1.0) * seconds)
        for k, one in enumerate(attitudes)
    )


def _quarters(axes: tuple[int, int, int]) -> tuple[float, float, float]:
    outer, middle, inner = (radians(90) * number for number in axes)
    return outer, middle, inner


def systematic_plan(path: str = "systematic", seconds: float = 40.0) -> tuple[TableStep, ...]:
    """Return a path by name, with holds of `seconds`, for a systematic calibration.

    Raises
    ------
    InputError
        There is no such path; the message lists the paths.
    """
    return path_by_name(path, seconds)


def _positions(seconds: float) -> list[Position]:
    return [
        Position(f"p{k}", (radians(outer), radians(middle), radians(inner)), seconds)
        for k, (outer, middle, inner) in enumerate(_TEN, start=1)
    ]


PATHS: Mapping[str, Callable[[float], tuple[TableStep, ...]]] = {
    "paper": paper_path,
    "fast": fast_path,
    "discrete": discrete_path,
    "systematic": systematic_path,
}
"""Functions that return each named path, given the duration of a hold in seconds."""


_WORDS = ("label", "kind", "axis")
_LIKE = {"seconds": "s", "angle": "°", "rate": "°/s"}
_LONGEST = 86_400.0  # s
_AXES = 3  # number of axes that the named paths need
_HEADED = re.compile(r"(\w+) *\[(.+)\]")


def read_path(path: str | Path, axes: Sequence[str]) -> tuple[TableStep, ...]:
    """Read a path from a file.

    Parameters
    ----------
    path : path
    axes : sequence of str
        Names of the table's axes, outermost first, as in `Turntable.names`.

    Raises
    ------
    InputError
        A column is unknown or a step is not complete. The message names the file and the line.
    """
    path = Path(path)
    table = read_table(path, text=_WORDS)
    numbers = _quantities(path, table, axes)
    words = {
        name: [str(cell).strip() for cell in table.columns[name]]
        for name in _WORDS
        if name in table.columns
    }
    steps: list[TableStep] = []
    for row, label in enumerate(words["label"]):
        cells = {name: column[row] for name, column in words.items()}
        size = {name: float(column[row]) for name, column in numbers.items()}
        try:
            steps.append(_parse_step(cells, size, axes))
            if label in words["label"][:row]:
                raise _cell_error("label", f"label {label!r} is also in an earlier row; change it")
        except InputError as error:
            where = f"{path.name} {table.place(row)}"
            raise error.located(where, file=path, line=table.line(row)) from None
    return tuple(steps)


def _quantities(path: Path, table: Table, axes: Sequence[str]) -> dict[str, Array]:
    """Return the numeric columns by name, in SI; refuse unknown columns."""

    def refusal(column: str, text: str) -> InputError:
        return InputError(f"{path.name}: column {column!r} {text}", file=path, names=(column,))

    likes = dict.fromkeys(axes, "°") | _LIKE
    result: dict[str, Array] = {}
    for header in table.names:
        if header in _WORDS:
            continue
        headed = _HEADED.fullmatch(header)
        name = headed[1] if headed else header
        if name not in likes:
            possible = (*_WORDS, *(f"{name} [{like}]" for name, like in likes.items()))
            raise refusal(header, f"is unknown; the columns are {', '.join(possible)}")
        if headed is None:
            raise refusal(name, f"needs a unit: {name} [{likes[name]}]")
        if name in result:
            raise refusal(name, "appears twice; remove one of the two")
        with error_location(f"{path.name}: column {header!r}", file=path):
            size = si_factor(headed[2], likes[name])
        result[name] = size * table.numbers(header)
    for name in ("label", "kind"):
        if name not in table.names:
            raise refusal(name, f"is missing; the columns are {', '.join(table.names)}")
    return result


def _parse_step(words: dict[str, str], size: dict[str, float], axes: Sequence[str]) -> TableStep:
    label, kind = words["label"], words["kind"]
    if not label:
        raise _cell_error("label", "the step has no label; give it a label")
    if kind not in ("position", "rotation"):
        raise _cell_error("kind", f"kind is {kind!r}; it must be position or rotation")
    for name in ("axis", "angle", "rate") if kind == "position" else ("seconds",):
        if words.get(name) or not np.isnan(size.get(name, np.nan)):
            raise _cell_error(name, f"a {kind} does not use {name}; leave the cell empty")
    angles = _angles(size, axes)
    step = f"{kind} {label}"
    if kind == "position":
        if angles is None:
            text = f"{step}: the angles are missing; give the angles of {', '.join(axes)}"
            raise _cell_error("angles", text)
        seconds = _required_quantity(size, "seconds", step)
        if not 0 < seconds <= _LONGEST:
            text = f"{step}: seconds is {seconds:.6g}; it must be greater than 0 and at most a day"
            raise _cell_error("seconds", text)
        return Position(label, angles, seconds)
    if (axis := words.get("axis", "")) not in axes:
        raise _cell_error("axis", f"{step}: axis is {axis!r}; it must be {' or '.join(axes)}")
    angle, rate = (_required_quantity(size, name, step) for name in ("angle", "rate"))
    if rate <= 0:
        text = f"{step}: its rate is {degrees(rate):.6g} °/s; it must be greater than 0, because "
        raise _cell_error("rate", f"{text}the sign of the angle gives the direction")
    return Rotation(label, axes.index(axis), angle, rate, angles)


def _cell_error(column: str, text: str) -> InputError:
    return InputError(text, key=column)


def _angles(size: dict[str, float], axes: Sequence[str]) -> tuple[float, ...] | None:
    """Return the axes' angles, or None if all cells are empty."""
    angles = tuple(size.get(axis, np.nan) for axis in axes)
    if np.isnan(angles).all():
        return None
    if np.isnan(angles).any():
        text = f"give the angles of all axes ({', '.join(axes)}) or of none"
        raise _cell_error("angles", text)
    return angles


def _required_quantity(size: dict[str, float], name: str, step: str) -> float:
    value = size.get(name, np.nan)
    if np.isnan(value):
        raise _cell_error(name, f"{step}: {name} is missing")
    return value


def path_plan(
    options: Mapping[str, Any], bench: Turntable, folder: Path, plan: Callable[[], tuple[Step, ...]]
) -> Callable[[], tuple[Step, ...]]:
    """Return the plan function of a run; it reads the file only when it is called.

    Parameters
    ----------
    options : mapping
        Keys of [method] that concern the plan.
    bench : Turntable
        Bench whose axes name the columns of the file.
    folder : Path
        Folder of the file.
    plan : callable
        Plan function for a named path.

    Raises
    ------
    InputError
        The path is neither a known name nor a file, or `seconds` is stated together with a file.
    """
    name = options.get("path")
    if name is None or name in PATHS:
        if len(bench.axes) != _AXES:
            text = f"{name or 'the default path'} needs three axes, but this table has "
            return partial(
                _refuse_plan, f"path: {text}{len(bench.axes)}; name a file with its steps"
            )
        return plan
    file = folder / name
    if not is_file(file):
        text = f"{name!r} is neither a file in {folder} nor one of {', '.join(PATHS)}"
        raise key_error("[method] path", text, names=(name,))
    if "seconds" in options:
        raise key_error("[method] seconds", f"{name} already gives the durations; remove the key")
    return partial(read_path, file, bench.names)


def _refuse_plan(text: str) -> tuple[Step, ...]:
    """Refuse the plan only when it is called: a calibration does not need it."""
    raise InputError(text, key="[method] path")
