"""Compare the two triads: gravity must rotate between rests as the gyros measure it.

From one rest to the next, the direction of gravity in the case follows from the gyro readings::

    u₂ = Rᵀ u₁        R is the product of the rotations ω dt of all samples, biases subtracted

An exchanged column, a reversed axis or a wrong unit breaks this relation. Let the accelerometer
columns be P f and the gyro columns Q ω, with signed permutations P and Q. They agree with gravity
if det(P) P = Q, because the rotation vector is an axial vector. The turns therefore determine the
signed permutation N of the gyros that makes them agree, and each N has only a few explanations. If
all three accelerometers are reversed (P = −1), then N = 1, so turns between rests cannot reveal it.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import Sensor
from inercal.recordings import Mark, Recording
from inercal.recordings.segments.attitudes import transitions_between_rests

DIFFERENT = np.deg2rad(25)  # misfit of a turn; scale and bias errors of an ordinary sensor are less
_FEWEST_DIFFERENT = 2
_OPPOSITE = np.deg2rad(120)  # misfit of a turn in the opposite direction
_MOST_TURNS = 40
_MOST_SECONDS = 60.0  # between two rests; over a longer time a bias may change
_TURN_SAMPLES = 1024  # a power of two; the largest number of rotations in a turn
_FEWEST_TURNS = 3
_OUTLIERS = 20  # one in this many turns may disagree, for example after a bump or a lost sample
_SPHERE_RESTS = 9  # fewest rests for which the centre of a fitted sphere is reliable
_WIDEST = 0.5  # largest plausible bias, as a fraction of gravity
_UNITS = (180 / np.pi, np.pi / 180)
_USABLE = (0.65, 1.5)  # factors of the readings of sensors that can be calibrated
_SCALES: list[float] = [*np.geomspace(0.1, 10.0, 93).tolist(), 1e2, 1e-2, 1e3, 1e-3]
_NAMES = "xyz"
_AXIS = re.compile(r"\b[ag][xyz]\b")


class GravityTurns(NamedTuple):
    """Turns between neighbouring rests.

    Parameters
    ----------
    before, after : (k, 3) array
        Unit vectors of gravity in the case, measured by the accelerometers.
    angles : (k, n, 3) array
        Rotation vectors in time order, rad, with biases subtracted; n is a power of two.
    """

    before: Array
    after: Array
    angles: Array


@dataclass(frozen=True)
class TurnAgreement:
    """A signed permutation of the gyros, and a scale, with which the turns agree with gravity.

    Parameters
    ----------
    matrix : tuple of 3 tuples of 3 int
        N, where N ω is the reading that the gyros would give in the accelerometers' axes.
    factor : float
        Factor by which the gyro readings must be multiplied.
    misfit : float
        Median angle between predicted and measured gravity, rad.
    """

    matrix: tuple[tuple[int, ...], ...]
    factor: float
    misfit: float

    @property
    def as_recorded(self) -> bool:
        """Whether no axis is exchanged or reversed."""
        return self.matrix == ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def read_gravity_turns(
    recording: Recording, sensor: Sensor, rests: Sequence[Mark]
) -> GravityTurns | None:
    """Return the turns between rests, or None unless both triads lie along x, y, z.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    rests : sequence of Mark
        Rests in time order.
    """
    kinds = {k: [j for j, one in enumerate(sensor.axes) if one.measures == k] for k in "fw"}
    for columns in kinds.values():
        if len(columns) != 3 or not np.allclose([sensor.axes[k].i for k in columns], np.eye(3)):
            return None
    if len(rests) < 2:
        return None
    ways = transitions_between_rests(recording, sensor, rests)
    seconds = ways.time[ways.reached] - ways.time[ways.left]
    chosen = np.flatnonzero(seconds < _MOST_SECONDS)
    if not chosen.size:
        return None
    chosen = chosen[:: -(-len(chosen) // _MOST_TURNS)]
    means = np.array([ways.output[one.start : one.stop].mean(axis=0) for one in rests])
    means = sensor.to_si(means)
    unit = _directions(means[:, kinds["f"]])
    rate, angles = means[:, kinds["w"]], list[Array]()
    longest = int((ways.reached - ways.left)[chosen].max())
    count = min(1 << longest.bit_length(), _TURN_SAMPLES)
    for k in chosen.tolist():
        first, last = int(ways.left[k]), int(ways.reached[k])
        rest = int(ways.rest[k])
        read = sensor.to_si(ways.output[first : last + 1])[:, kinds["w"]]
        steps = np.gradient(ways.time[first : last + 1])[:, None]
        angles.append(sum_rates((read - 0.5 * (rate[rest] + rate[rest + 1])) * steps, count))
    starts = ways.rest[chosen]
    return GravityTurns(unit[starts], unit[starts + 1], np.stack(angles))


def _directions(force: Array) -> Array:
    """Return unit vectors of gravity, after subtracting the bias if a sphere fit is reliable."""
    centre, radius = sphere(force) if len(force) >= _SPHERE_RESTS else (None, None)
    if centre is None or radius is None or np.linalg.norm(centre) > _WIDEST * radius:
        centre = np.zeros(3)
    force = force - centre
    return np.asarray(force / np.linalg.norm(force, axis=-1, keepdims=True), dtype=float)


def sphere(means: Array) -> tuple[Array | None, float | None]:
    """Fit a sphere to readings, (k, 3), and return its centre and radius; None if impossible."""
    if len(means) < 6:
        return None, None
    scale = float(np.abs(means).max()) or 1.0
    x = means / scale
    design = np.column_stack([2 * x, np.ones(len(x))])
    u, values, v = np.linalg.svd(design, full_matrices=False)
    if values[-1] < 1e-4 * values[0]:
        return None, None
    solution: Array = v.T @ ((u.T @ (x**2).sum(axis=-1)) / values)
    squared = float(solution[3] + (solution[:3] ** 2).sum())
    return (solution[:3] * scale, np.sqrt(squared) * scale) if squared > 0 else (None, None)


def sum_rates(rate: Array, count: int = _TURN_SAMPLES) -> Array:
    """Sum neighbouring samples of (n, 3) to `count` rows, or pad a short series with zeros.

    Each sum covers so few samples that their rotations still commute; `count` is a power of two.
    """
    if len(rate) < count:
        return np.concatenate([rate, np.zeros((count - len(rate), rate.shape[1]))])
    edges = np.linspace(0, len(rate), count + 1).astype(int)[:-1]
    return np.asarray(np.add.reduceat(rate, edges, axis=0), dtype=float)


def rotations(angles: Array) -> Array:
    """Return the products of the rotations given by (k, n, 3) rotation vectors, (k, 3, 3)."""
    turned = exp_so3(angles)
    while turned.shape[1] > 1:
        turned = turned[:, ::2] @ turned[:, 1::2]
    return np.asarray(turned[:, 0], dtype=float)


def turn_differences(before: Array, after: Array, turned: Array) -> Array:
    """Return the angle between predicted and measured gravity for each turn, (k,) rad."""
    predicted = np.einsum("kji,kj->ki", turned, before)
    cosine = np.clip((predicted * after).sum(axis=-1), -1, 1)
    return np.asarray(np.arccos(cosine), dtype=float)


@cache
def _permutations() -> tuple[tuple[tuple[int, ...], ...], ...]:
    """Return all 48 signed permutations, starting with the identity."""
    found: list[tuple[tuple[int, ...], ...]] = []
    for signs in product((1, -1), repeat=3):
        for order in permutations(range(3)):
            rows = zip(signs, order, strict=True)
            found.append(tuple(tuple(s * (k == place) for k in range(3)) for s, place in rows))
    return tuple(found)


def find_matching_axes(
    turns: GravityTurns, factors: Iterable[float] = (1.0,)
) -> list[TurnAgreement]:
    """Return all signed permutations with which the turns agree with gravity, best first.

    Parameters
    ----------
    turns : GravityTurns
    factors : iterable of float
        Factors to multiply the gyro readings by.
    """
    found: list[TurnAgreement] = []
    allowed = len(turns.before) // _OUTLIERS
    for factor in factors:
        ways = {sign: rotations(sign * factor * turns.angles) for sign in (1, -1)}
        for matrix in _permutations():
            n = np.array(matrix)
            sign = round(float(np.linalg.det(n)))
            # A rotation by N ω is a rotation by det(N) ω, expressed in axes transformed by N.
            proper = sign * n
            turned = proper @ ways[sign] @ proper.T
            misfits = turn_differences(turns.before, turns.after, turned)
            if (misfits > DIFFERENT).sum() <= allowed:
                found.append(TurnAgreement(matrix, factor, float(np.median(misfits))))
    return sorted(found, key=lambda one: one.misfit)


class TurnVerdict(NamedTuple):
    """Conclusion from the turns between rests about the order and signs of the axes.

    Parameters
    ----------
    turns : int
        Number of turns that were evaluated.
    agree : bool or None
        Whether the turns agree with the axes as recorded; None if no conclusion is possible.
    unique : bool
        Whether exactly one order and sign of the axes agrees.
    misfit : float
        Median angle between predicted and measured gravity, rad.
    changes : tuple of str
        Changes that would make the turns agree, in words: "az is reversed".
    clear : bool
        Whether a single bump cannot explain the disagreement, because two turns disagree or one
        turn went in the opposite direction.
    """

    turns: int
    agree: bool | None
    unique: bool
    misfit: float
    changes: tuple[str, ...] = ()
    clear: bool = False


def judge_turns(turns: GravityTurns | None, *, others: bool = True) -> TurnVerdict:
    """Decide whether the turns agree as recorded, or which changes would make them agree.

    Without `others`, no other axes are tried if the turns agree as recorded, which takes less time.
    """
    nothing = TurnVerdict(0 if turns is None else len(turns.before), None, False, 0.0)
    if turns is None or len(turns.before) < _FEWEST_TURNS:
        return nothing
    read = turn_differences(turns.before, turns.after, rotations(turns.angles))
    if not others and (read > DIFFERENT).sum() <= len(read) // _OUTLIERS:
        return TurnVerdict(len(read), True, False, float(np.median(read)))
    found = find_matching_axes(turns)
    plain = next((one for one in found if one.as_recorded), None)
    if plain is not None:
        return TurnVerdict(len(turns.before), True, len(found) == 1, plain.misfit)
    if not found:
        found = find_matching_axes(turns, _UNITS)
        found = [one for one in found if one.as_recorded] or found
    found = found or _other_scale(turns)
    if not found:
        return nothing
    texts = tuple(dict.fromkeys(text for one in found for text in describe_changes(one)))
    clear = int((read > DIFFERENT).sum()) >= _FEWEST_DIFFERENT or float(read.max()) > _OPPOSITE
    return TurnVerdict(len(read), False, len(found) == 1, found[0].misfit, texts, clear)


def _other_scale(turns: GravityTurns) -> list[TurnAgreement]:
    """Return the scale of the gyros with which the turns agree, if no usable sensor can have it."""
    misfits = [
        turn_differences(turns.before, turns.after, rotations(factor * turns.angles))
        for factor in _SCALES
    ]
    best = min(range(len(_SCALES)), key=lambda k: np.median(misfits[k]))
    factor, own = _SCALES[best], misfits[best]
    if (own > DIFFERENT / 2).sum() > len(own) // _OUTLIERS or _USABLE[0] < factor < _USABLE[1]:
        return []
    return [TurnAgreement(_permutations()[0], factor, float(np.median(own)))]


def describe_changes(found: TurnAgreement) -> tuple[str, ...]:
    """Return the simplest changes of axes and unit that make the turns agree, in words.

    The axes are named ax to gz.
    """
    unit = {_UNITS[1]: "the gyros' unit is °/s", _UNITS[0]: "the gyros' unit is rad/s"}
    times = float(f"{found.factor:.2g}")
    scaled = f"the gyros' readings are multiplied by about {times:g}"
    stated = unit.get(found.factor, "" if found.factor == 1.0 else scaled)
    if found.as_recorded:
        return (stated,) if stated else ()
    n = np.array(found.matrix)
    if np.array_equal(n, -np.eye(3)):
        texts = [
            "two columns are exchanged or one axis is reversed in both triads (left-handed axes)",
            "all gyros are reversed",
        ]
    else:
        options = [(n, "g")]
        if round(float(np.linalg.det(n))) == 1:
            options += [(-n.T, "a"), (n.T, "a")]
        least = min(_changes(matrix) for matrix, _ in options)
        texts = [_change_text(m, name) for m, name in options if _changes(m) == least]
    return tuple(f"{text} and {stated}" if stated else text for text in texts)


def name_columns(change: str, columns: Mapping[str, str]) -> str:
    """Replace axis names such as "gz" in the text of a change by the names of their columns."""
    return _AXIS.sub(lambda found: columns.get(found[0], found[0]), change)


def _changes(matrix: Array) -> int:
    """Return the number of reversed axes plus the number of exchanges that restore their order."""
    moved = 3 - int(np.abs(np.diag(matrix)).sum())
    return int((matrix < 0).sum()) + max(moved - 1, 0)


def _change_text(matrix: Array, name: str) -> str:
    """Describe how the columns must be assigned to x, y and z."""
    order: list[int] = np.abs(matrix).argmax(axis=1).tolist()
    signs = matrix.sum(axis=1)
    moved = [k for k in range(3) if order[k] != k]
    label = [f"{name}{axis}" for axis in _NAMES]
    texts: list[str] = []
    if len(moved) == 2:
        texts.append(f"{label[moved[0]]} and {label[moved[1]]} are exchanged")
    elif len(moved) == 3:
        texts.append(f"the columns of {', '.join(label)} are {', '.join(label[k] for k in order)}")
    reversed_axes = [label[k] for k in range(3) if signs[k] < 0]
    if reversed_axes:
        joined = " and ".join(reversed_axes)
        texts.append(f"{joined} {'is' if len(reversed_axes) == 1 else 'are'} reversed")
    return " and ".join(texts)
