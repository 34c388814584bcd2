"""Paths for a three-axis table with the axes Z, X, Y (outer to inner), as data.

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

from collections.abc import Callable, Mapping, Sequence
from math import radians

from inercal.basics.errors import InputError
from inercal.physics.plan import Position, Rotation, TableStep

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
    for name, degrees in _SIX.items():
        outer, middle, inner = map(radians, degrees)
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
