"""Find rows of a table that contradict the bench, when a fit has failed.

One wrong entry can make a nonlinear fit diverge, so this check needs no fit by the method. It fits
y = S f + b to the readings y and the nominal specific force f by least absolute deviations, each
row divided by its |f|. If attitudes are not known, it compares norms. Gyros without accelerometers
are compared with the nominal rates in the same way, all rows divided by the largest rate.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, pairwise, product
from math import atan2, degrees, pi, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.contract import MeanBench
from inercal.physics.plan import Attitude, Index, Spin, Turn, arm_attitude
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

_ALIKE, _REWEIGHTED = 1e-3, 20  # relative: smaller residuals have equal weight; iterations
_VECTORS, _NORMS, _SCATTER = 0.05, 0.3, 8.0  # limits, relative to |f|; times the median residual
_FEWEST, _COLUMN, _MOST_LISTED, _MOST_REPAIRS = 6, 4, 4, 3  # rows, rows, rows, changes
_PAIR, _LEAST_RATE = 2, 1e-3  # rows; rad/s: the earth's rate alone shows no wrong row
_ROUNDED = 1e-12  # relative rounding error of a mean
_LARGEST_ERROR = 0.3  # of scale factors and axes
_REPAIR_WORDS = {
    "sign": "changing the sign of",
    "exchange": "exchanging",
    "decimal": "moving the decimal point of",
    "digit": "changing the digit of",
}
_Steps = Sequence[Any]


def require_possible_rows(
    path: Path, observations: Observations, sensor: Sensor, bench: object, steps: Sequence[object]
) -> None:
    """Refuse rows that contradict the bench, after a fit has failed.

    Parameters
    ----------
    path : path
        The run file, for the message.
    observations, sensor, bench, steps
        See `contradicting_rows`.

    Raises
    ------
    InputError
        Some rows contradict the bench; the message names them and, if one is found, the correction.
    """
    text, labels = contradicting_rows(observations, sensor, bench, steps)
    if text:
        raise InputError(f"{path}: {text}", file=path, names=labels) from None


def require_right_columns(
    path: Path, observations: Observations, sensor: Sensor, bench: object, steps: Sequence[object]
) -> None:
    """Refuse rows that only agree after the correction of a mistake in a whole column of angles.

    Such a mistake may leave a fit that converges. Parameters and errors are those of
    `require_possible_rows`.
    """
    table = _compared_table(observations, sensor, bench, steps)
    if table is not None and (text := _wrong_column(table)):
        raise InputError(f"{path}: {text}", file=path)


class _Table(NamedTuple):
    """The rows that can be compared with the bench, and a function that compares some of them.

    `compare` returns the columns of the fit and the readings, in units of the nominal input.
    """

    triad: Sensor
    read: Array
    labels: tuple[str, ...]
    moves: _Steps
    least: float
    compare: Callable[[Array, _Steps], tuple[Array, Array]]

    def off(self, read: Array, steps: _Steps) -> tuple[Array, Array]:
        """Return the fit to these readings in these steps, and how far each row is off."""
        pair = self.compare(read, steps)
        fit = least_absolute_fit(*pair)
        return fit, _off(*pair, fit)


def _compared_table(
    observations: Observations, sensor: Sensor, bench: object, steps: Sequence[Any]
) -> _Table | None:
    """Return the rows with a nominal motion, or None if there are too few."""
    kind = "f" if sensor.select_axes("f").axes else "w"
    triad, unit = sensor.select_axes(kind), G0 if kind == "f" else 1.0
    mean = observations.mean
    if mean.ndim != len(("row", "axis")) or len(mean) != len(steps) or not triad.axes:
        return None
    if not isinstance(bench, MeanBench) or any(getattr(s, "azimuth", None) for s in steps):
        return None
    rows = [k for k, step in enumerate(steps) if kind == "w" or not _turns_about_platform(step)]
    moves, read = [steps[k] for k in rows], mean[rows, : len(triad.axes)]
    norms = any(isinstance(step, Spin) and step.attitude is None for step in moves)

    def nominal(some: _Steps) -> Array:
        if norms:
            some = [replace(step, attitude=arm_attitude(0.0, 0.0)) for step in some]
        motion = bench.mean_motion(some, {})
        return motion.f if kind == "f" else motion.w

    try:
        size = np.linalg.norm(nominal(moves), axis=-1)
    except InputError:  # the attitudes are not known
        return None
    if len(rows) < _FEWEST or not np.isfinite(read).all() or size.max() < _LEAST_RATE:
        return None
    largest = float(size.max())

    def compare(y: Array, some: _Steps) -> tuple[Array, Array]:
        x = nominal(some)
        size = np.linalg.norm(x, axis=-1, keepdims=True)
        size = size if kind == "f" else np.full_like(size, largest)
        if norms:
            return np.ones_like(size), np.linalg.norm(y, axis=-1, keepdims=True) / size
        return np.concatenate([x, np.full_like(size, unit)], axis=-1) / size, y / size

    labels = tuple(observations.labels[k] for k in rows)
    return _Table(triad, read, labels, moves, _NORMS if norms else _VECTORS, compare)


def _turns_about_platform(step: object) -> bool:
    """Return whether the force on the accelerometers depends on their place in the case."""
    from inercal.benches.rate_platform.sections import RateDwell

    return isinstance(step, Turn) or (isinstance(step, RateDwell) and step.rate != 0)


def contradicting_rows(
    observations: Observations, sensor: Sensor, bench: object, steps: Sequence[object]
) -> tuple[str, tuple[str, ...]]:
    """Return what is wrong, and the labels of the wrong rows; both are empty if nothing is found.

    A mistake in a whole column of angles is named if its correction makes the rows agree.

    Parameters
    ----------
    observations : Observations
        Means of r rows, without a trial axis; the accelerometers come first.
    sensor : Sensor
    bench : object
        The bench; only a bench with nominal motions (`MeanBench`) is checked.
    steps : sequence of r object
        The steps of the rows.
    """
    table = _compared_table(observations, sensor, bench, steps)
    if table is None:
        return "", ()
    if text := _wrong_column(table):
        return text, ()
    triad, read, labels, moves, least, compare = table
    fit, off = table.off(read, moves)
    usual = _SCATTER * float(np.median(off))
    limit = max(least, usual)
    wild = sorted(np.flatnonzero(off > limit).tolist(), key=lambda k: -off[k])
    written = triad.to_output(read)
    text = _constant_channel(written, triad, labels, wild) if wild else ""
    clipped = _clipped_rows(written, wild, np.flatnonzero(off > usual))
    labels = tuple(labels[k] for k in clipped or wild)
    if text:
        return text, tuple(table.labels[k] for k in wild)
    if clipped:
        text = f"the largest reading of {', '.join(labels[:_MOST_LISTED])} and other rows is always"
        peak = np.abs(written[clipped[0]]).max()
        return f"{text} {peak:.6g}, where the output is clipped; remove these rows", labels
    of_wild = {s.attitude for k in wild if isinstance(s := moves[k], Spin)}
    if len(wild) > 1 and len(of_wild) == 1 and least != _NORMS:
        for text, attitude in _other_attitudes(*of_wild):
            others = [replace(moves[k], attitude=attitude) for k in wild]
            if (_off(*compare(read[wild], others), fit) < limit).all():
                span = f"{table.labels[min(wild)]} to {table.labels[max(wild)]}"
                return f"{span} fit with {text}; check this mounting", labels
    lines: list[str] = []
    word = "force" if triad.axes[0].measures == "f" else "largest rate"
    for k, label in zip(wild[:_MOST_LISTED], labels, strict=False):
        repairs: list[str] = []
        for some in _changes(read[[k]], triad, moves, moves[k]):
            repairs = [text for text, y, step in some if _off(*compare(y, [step]), fit) < limit]
            if repairs:
                break
        fix = f", which {' or '.join(repairs)} would correct" if repairs else ""
        fix *= len(repairs) <= _MOST_REPAIRS
        lines.append(f"{label} is off by {100 * off[k]:.0f} % of the {word}{fix}")
    more = f"; and {len(wild) - len(lines)} more" if len(wild) > len(lines) else ""
    text = f"rows contradict the bench: {'; '.join(lines)}{more}; check them, or remove them"
    return (text, labels) if lines else ("", ())


def _wrong_column(table: _Table) -> str:
    """Return a mistake in several rows whose correction makes all rows agree; empty if none."""
    triad, read, moves, least = table.triad, table.read, table.moves, table.least
    if not isinstance(moves[0], Spin | Index):
        return ""
    wrong = int(np.sum(table.off(read, moves)[1] > least))
    if wrong < _PAIR:
        return ""
    axes, several = triad.input_axes(triad.axes[0].measures), wrong >= _COLUMN
    norms = least == _NORMS
    columns = _other_columns(moves) if several else ()
    exchanged = () if norms else _exchanged_mountings(moves)
    tried = ((text, read, steps) for text, steps in chain(columns, exchanged))
    for text, seen, steps in chain(() if norms else _reversed_axes(table), tried):
        fit, off = table.off(seen, steps)
        near = np.abs(fit - 1 if norms else fit[:-1].T - axes).max() < _LARGEST_ERROR
        if near and np.sum(off > least) <= int(several):
            return f"the readings look as if {text}"
    return ""


def _exchanged_mountings(moves: _Steps) -> Iterator[tuple[str, _Steps]]:
    """Yield exchanges of two mountings in all their rows."""
    for (one, first), (two, second) in combinations(_mountings(moves).items(), 2):
        swap = {one: two, two: one}
        text = f"{first} and {second} were exchanged; exchange them"
        yield (
            text,
            [replace(step, attitude=swap.get(step.attitude, step.attitude)) for step in moves],
        )


def _reversed_axes(table: _Table) -> Iterator[tuple[str, Array, _Steps]]:
    """Yield readings with the sign of one axis changed in all rows of one mounting."""
    for mounting, name in _mountings(table.moves).items():
        rows = [step.attitude == mounting for step in table.moves]
        for k, channel in enumerate(table.triad.channels):
            read = table.read.copy()
            read[rows, k] *= -1
            text = f"{channel} had the wrong sign in all rows of {name}; correct the sign"
            yield text, read, table.moves


def _mountings(moves: _Steps) -> dict[Attitude, str]:
    """Return the mountings and their names; a mounting without one is named by its first row."""
    found: dict[Attitude, str] = {}
    for step in moves:
        if isinstance(step, Spin) and step.attitude is not None:
            name = step.attitude.name or f"of {step.label}"
            found.setdefault(step.attitude, f"the mounting {name}")
    return found


def _constant_channel(
    written: Array, triad: Sensor, labels: Sequence[str], wild: Sequence[int]
) -> str:
    """Return that a channel has one value in consecutive rows: in many, or in all `wild` rows."""
    for name, column in zip(triad.channels, written.T, strict=True):
        changes = np.abs(np.diff(column)) > _ROUNDED * np.abs(column).max()
        for rows in np.split(np.arange(len(column)), np.flatnonzero(changes) + 1):
            inside = 3 * len(rows) > len(column) or set(wild) <= set(rows.tolist())
            if len(rows) >= _COLUMN and inside:
                span = f"{labels[rows[0]]} to {labels[rows[-1]]}"
                return f"{name} is always {column[rows[0]]:.6g} from {span}; check its connection"
    return ""


def _clipped_rows(written: Array, wild: Sequence[int], suspected: Indices) -> list[int]:
    """Return the rows whose largest reading is one value, or the largest of all; none if few.

    A value that is only the largest of all must be `suspected` in several rows.
    """
    peaks = np.array([float(f"{one:.6g}") for one in np.abs(written).max(axis=-1)])
    if len(wild) >= _COLUMN and len(set(peaks[wild].tolist())) == 1:
        return list(wild)
    is_largest = peaks == peaks.max()
    return np.flatnonzero(is_largest).tolist() if is_largest[suspected].sum() >= _COLUMN else []


def least_absolute_fit(columns: Array, read: Array) -> Array:
    """Return the coefficients (p, m) with the least sum of |residual|, which few wrong rows affect.

    Parameters
    ----------
    columns : (r, p) array
    read : (r, m) array
        The readings; the residual of a row is the norm over its m channels.
    """
    solved = np.zeros((columns.shape[1], read.shape[1]))
    weight = np.ones((len(read), 1))
    for _ in range(_REWEIGHTED):
        found = np.linalg.lstsq(weight * columns, weight * read, rcond=1e-6)
        solved = np.asarray(found[0], dtype=float)
        weight = 1 / np.sqrt(np.maximum(_off(columns, read, solved), _ALIKE))[:, None]
    return solved


def _off(columns: Array, read: Array, fit: Array) -> Array:
    """Return the norm of each row's residual, (r,)."""
    return np.linalg.norm(read - columns @ fit, axis=-1)


def _changes(
    read: Array, triad: Sensor, moves: _Steps, own: Any
) -> Iterator[list[tuple[str, Array, Any]]]:
    """Yield lists of single changes to a row, as text, reading and step; one digit comes last."""
    written = triad.to_output(read[0])
    values = dict(zip(triad.channels, written.tolist(), strict=True))

    def entries(some: Iterable[Repair]) -> list[tuple[str, Array, Any]]:
        after = ((one.describe(), [list((values | one.after).values())]) for one in some)
        return [(text, triad.to_si(np.array(row)), own) for text, row in after]

    other: dict[Spin | Index, str] = {}
    for one in moves:
        if isinstance(own, Index) and isinstance(one, Index):
            other[replace(own, angle=one.angle)] = f"an angle of {degrees(one.angle):.6g}°"
        elif isinstance(own, Spin) and isinstance(one, Spin):
            other[replace(own, rate=one.rate)] = f"a rate of {one.rate * 30 / pi:.6g} rpm"
            if one.attitude is not None:
                other[replace(own, attitude=one.attitude)] = f"the attitude of {one.label}"
    *kinds, digits = single_changes(written, triad.channels)
    yield entries(chain(*kinds)) + [(text, read, step) for step, text in other.items()]
    yield entries(digits)


def _other_columns(moves: _Steps) -> Iterator[tuple[str, _Steps]]:
    """Yield frequent mistakes in a whole column of angles, and the steps without the mistake."""
    of_spins = {"rate": "rates", "attitude": "angles or mountings"}
    keys = {"angle": "angles or mountings"} if isinstance(moves[0], Index) else of_spins
    for (key, words), (shift, word) in product(keys.items(), ((1, "down"), (-1, "up"))):
        right = [getattr(step, key) for step in (*moves[shift:], *moves[:shift])]
        text = f"the column of {words} was moved {word} by one row; move it back"
        yield text, [replace(a, **{key: b}) for a, b in zip(moves, right, strict=True)]
    known = [step.attitude for step in moves if isinstance(step, Spin)]
    if not known or any(one is None or one.name or one.up[1] for one in known):
        return
    psi, theta = np.array([_arm_angles(one) for one in known if one is not None]).T
    in_rad = 'the angles were in rad; state [data] attitude_unit = "rad"'
    for text, one, two in (
        ("the columns of ψ and θ were exchanged; correct [data] attitude", theta, psi),
        (in_rad, np.degrees(psi), np.degrees(theta)),
    ):
        right = map(arm_attitude, one.tolist(), two.tolist())
        yield text, [replace(a, attitude=b) for a, b in zip(moves, right, strict=True)]


def _arm_angles(attitude: Attitude) -> tuple[float, float]:
    """Return ψ and θ, rad, the inverse of `arm_attitude`."""
    out, up = attitude.out, attitude.up
    return atan2(out[1], out[2] * up[0] - out[0] * up[2]), atan2(up[0], -up[2])


def _other_attitudes(attitude: Attitude | None) -> Iterator[tuple[str, Attitude]]:
    """Yield attitudes with another ψ or θ, in steps of 15°, those in steps of 90° first."""
    if attitude is None or attitude.name or attitude.up[1]:
        return
    psi, theta = _arm_angles(attitude)
    for turn in sorted(range(15, 360, 15), key=lambda turn: turn % 90 > 0):
        for name, one, two in (("θ", 0, radians(turn)), ("ψ", radians(turn), 0)):
            before = round(degrees(theta if two else psi), 6) % 360
            text = f"{name} = {(before + turn) % 360:.6g}° instead of {before:.6g}°"
            yield text, arm_attitude(psi + one, theta + two)


@dataclass(frozen=True)
class Repair:
    """One change to a row: entries before and after it, in output units, by axis."""

    kind: str  # "sign", "exchange", "decimal" or "digit"
    before: dict[str, float]
    after: dict[str, float]

    def describe(self) -> str:
        """Return a description such as "changing the sign of az (0.743943 → −0.743943)"."""
        names = " and ".join(self.before)
        pairs = [f"{self.before[a]:.9g} → {self.after[a]:.9g}" for a in self.before]
        return f"{_REPAIR_WORDS[self.kind]} {names} ({', '.join(pairs)})".replace("-", "−")


def single_changes(written: Array, channels: Sequence[str]) -> Iterator[list[Repair]]:
    """Yield lists of single changes to a row, one list per kind, the simplest kind first."""
    named = dict(zip(channels, written.tolist(), strict=True))
    yield [Repair("sign", {a: v}, {a: -v}) for a, v in named.items() if v]
    yield [
        Repair("exchange", {a: named[a], b: named[b]}, {a: named[b], b: named[a]})
        for a, b in combinations(channels, 2)
        if named[a] != named[b]
    ]
    yield [
        Repair("decimal", {a: v}, {a: float(f"{v * factor:.9g}")})
        for a, v in named.items()
        for factor in (10.0, 0.1)
        if v
    ]
    yield [
        Repair("digit", {a: v}, {a: other}) for a, v in named.items() for other in _digit_changes(v)
    ]


def _digit_changes(value: float) -> list[float]:
    """Return all numbers with one digit changed or two neighbouring digits exchanged."""
    text = f"{value:.9g}"
    places = [k for k, c in enumerate(text) if c.isdigit()]
    changed = {
        float(text[:k] + d + text[k + 1 :]) for k in places for d in "0123456789" if d != text[k]
    }
    for j, k in pairwise(places):
        swapped = list(text)
        swapped[j], swapped[k] = swapped[k], swapped[j]
        changed.add(float("".join(swapped)))
    return sorted(changed - {value})
