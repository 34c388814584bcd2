"""Find the passes of a dividing head, and the angles of a sensor on it with their dependences.

A pass visits the positions once, in any order.

A series of small tilts about a position is a pass of its own, and all its rows belong to that
position: the head's error is the same in all of them. The repeated readings of a warm-up, at the
beginning of a run, are a pass of their own, too.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from math import cos, degrees, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.plan import Index

if TYPE_CHECKING:
    from inercal.benches.dividing_head.bench import DividingHead

ANGLE_TOLERANCE = 1e-4  # rad; closer angles belong to the same position
TILT = pi / 360  # rad; the largest small tilt
SAME_ANGLE = 1e-7  # rad; in a series of small tilts, closer angles are the same
_FEWEST, _DIFFERENT = 5, 4  # rows and angles of a series of small tilts
_FEWEST_REPEATS = 12  # readings of a warm-up
CARDINAL_ANGLES = (0.0, pi / 2, pi, 1.5 * pi)


def distance_from_whole_turns(angle: float) -> float:
    """Return the distance of an angle from the nearest whole number of turns, rad."""
    return abs((angle + pi) % (2 * pi) - pi)


def matches_any_angle(angle: float, others: Iterable[float]) -> bool:
    """Return whether an angle equals one of the others except for whole turns; all in rad."""
    return any(distance_from_whole_turns(angle - other) < ANGLE_TOLERANCE for other in others)


def small_tilt_series(angles: Sequence[float]) -> list[range]:
    """Return the rows of each series of small tilts.

    A series is five or more consecutive rows within 0.5°, with four or more different angles. Its
    first row has the angle of the position about which it tilts. If the row before has the same
    angle, it is a plain reading there.

    Parameters
    ----------
    angles : sequence of float
        Angles of the head, rad.
    """
    return list(_series(tuple(angles)))


@lru_cache(maxsize=32)
def _series(angles: tuple[float, ...]) -> tuple[range, ...]:
    found: list[range] = []
    start = 0
    while start < len(angles):
        stop = start + 1
        while stop < len(angles) and distance_from_whole_turns(angles[stop] - angles[start]) < TILT:
            stop += 1
        if len({round(angle / SAME_ANGLE) for angle in angles[start:stop]}) < _DIFFERENT:
            start += 1
            continue
        while round(angles[start + 1] / SAME_ANGLE) == round(angles[start] / SAME_ANGLE):
            start += 1
        found.append(range(start, stop))
        start = stop
    return tuple(one for one in found if len(one) >= _FEWEST)


def warm_up_rows(steps: Sequence[Index]) -> range:
    """Return the rows of a warm-up: twelve or more readings of the first angle.

    The last reading before the head turns belongs to the first pass.
    """
    turned = (k for k, s in enumerate(steps) if abs(s.angle - steps[0].angle) > SAME_ANGLE)
    repeats = range(next(turned, len(steps)) - 1)
    return repeats if len(repeats) >= _FEWEST_REPEATS else range(0)


def steps_without_warm_up(steps: Sequence[Index]) -> Sequence[Index]:
    """Return the steps after the warm-up, whose readings enter the fit."""
    return steps[len(warm_up_rows(steps)) :]


def rows_without_series(steps: Sequence[Index]) -> list[int]:
    """Return the rows that belong neither to a series of small tilts nor to a warm-up."""
    series = [warm_up_rows(steps), *small_tilt_series([step.angle for step in steps])]
    apart = {k for rows in series for k in rows}
    return [k for k in range(len(steps)) if k not in apart]


def first_visit_rows(steps: Sequence[Index]) -> list[int]:
    """Return, for each step, the row of the first visit to its position."""
    angles = [step.angle for step in steps]
    for rows in small_tilt_series(angles):
        for k in rows:
            angles[k] = angles[rows.start]
    return list(_first_visits(tuple(angles)))


@lru_cache(maxsize=32)
def _first_visits(angles: tuple[float, ...]) -> tuple[int, ...]:
    first: list[int] = []
    for k, angle in enumerate(angles):
        same = (j for j in dict.fromkeys(first) if matches_any_angle(angle, [angles[j]]))
        first.append(next(same, k))
    return tuple(first)


def pass_numbers(steps: Sequence[Index]) -> list[int]:
    """Return the number of the pass that each step belongs to, counted from 0.

    A warm-up is a pass, and so is a series of small tilts. Otherwise a new pass begins when two
    consecutive positions have been visited before. A single position that comes again, because it
    closes the turn or was repeated, belongs to the current pass.
    """
    first = first_visit_rows(steps)
    parts = [warm_up_rows(steps), *small_tilt_series([s.angle for s in steps])]
    series = {k: rows for rows in parts for k in rows}
    numbers: list[int] = []
    current: set[int] = set()
    number = 0
    for k, place in enumerate(first):
        rows = series.get(k)
        if rows is None:
            before, after = k - 1 in series, k + 1 in series
            next_again = k + 1 < len(first) and not after and first[k + 1] in current
            begins = before or (place in current and next_again)
        else:
            begins = k == rows.start
        if numbers and begins:
            number += 1
            current.clear()
        numbers.append(number)
        if rows is None:
            current.add(place)
    return numbers


def pass_names(steps: Sequence[Index]) -> list[str]:
    """Return the names of the passes, such as "pass 1"."""
    return [f"pass {k}" for k in range(1, max(pass_numbers(steps), default=-1) + 2)]


def missing_cardinal_angles(steps: Sequence[Index]) -> dict[str, list[float]]:
    """Return the cardinal angles, rad, that are missing in each pass, by the name of the pass."""
    which, plain = pass_numbers(steps), rows_without_series(steps)
    result: dict[str, list[float]] = {}
    for k, name in enumerate(pass_names(steps)):
        own = [steps[row].angle for row in plain if which[row] == k]
        missing = [angle for angle in CARDINAL_ANGLES if not matches_any_angle(angle, own)]
        if own and missing:
            result[name] = missing
    return result


def evenly_spaced_angles(steps: Sequence[Index]) -> Array | None:
    """Return the evenly spaced angles nearest to the steps, (r,) rad; None if there are none.

    The stated angles may differ from evenly spaced ones by up to `ANGLE_TOLERANCE`.
    """
    n = len(set(first_visit_rows(steps)))
    if n == 0:
        return None
    first = steps[0].angle if distance_from_whole_turns(steps[0].angle) > ANGLE_TOLERANCE else 0.0
    turns = [round((step.angle - first) * n / (2 * pi)) for step in steps]
    grid = [first + turn * 2 * pi / n for turn in turns]
    off = max(abs(a - step.angle) for a, step in zip(grid, steps, strict=True))
    uneven = off > ANGLE_TOLERANCE or len({turn % n for turn in turns}) < n
    return None if uneven else np.array(grid)


def drift_ramps(steps: Sequence[Index]) -> Array:
    """Return the effect of a unit drift per pass at each step, (passes, r), minus its mean.

    The positions are assumed to be evenly spaced in time, and every pass to be as long as the
    longest one. A series of small tilts drifts as much per row as the other passes. The drift
    in a pass continues from the end of the previous pass.
    """
    which = np.array(pass_numbers(steps), dtype=np.int64)
    row = np.arange(len(steps))
    longest = int(np.bincount(which[rows_without_series(steps) or row]).max())
    rising: list[Array] = []
    for k in range(int(which.max()) + 1):
        (own,) = np.nonzero(which == k)
        ramp = np.clip(row - own[0], 0, own.size) / longest
        rising.append(ramp - ramp.mean())
    return np.stack(rising)


READING_SCALE, LEVEL_SCALE = "autocollimator scale", "level scale"
"""Name of the relative error of all autocollimator readings; -2 is a wrong sign."""


class SensorAngles(NamedTuple):
    """The sensor's angles ψ, linear in the bench's parameters q: nominal + Σ weight q."""

    nominal: Array  # (r,), rad
    weights: Mapping[str, Array]  # (r,) each, by full name of the parameter


def sensor_angles(bench: "DividingHead", steps: Sequence[Index]) -> SensorAngles:
    """Return the angles of r steps, corrected by level, autocollimator and certificate.

    Only deviations of the level from its mean count, because its zero is not the plumb line. The
    same holds for an autocollimator that is read at every position.

    Raises
    ------
    InputError
        The polygon has no face at a position where the autocollimator is read.
    """
    rows = angle_weights(bench, steps)
    nominal = np.array([step.level for step in steps])
    nominal = nominal - nominal.mean() + _stated_angles(bench, steps)
    nominal = nominal + [
        sum(weight * bench.qualified.correction(name) for name, weight in row.items())
        for row in rows
    ]
    names = dict.fromkeys(name for row in rows for name in row)
    weights = {name: np.array([row.get(name, 0.0) for row in rows]) for name in names}
    return SensorAngles(nominal, weights)


def angle_weights(bench: "DividingHead", steps: Sequence[Index]) -> list[dict[str, float]]:
    """Return the derivatives of each step's angle for the bench's parameters, by full name."""
    if not steps:
        return []
    named, creeping, trimmed = (
        pass_names(steps),
        drift_ramps(steps),
        _trim_references(bench, steps),
    )
    # All visits to a position share its graduation and face errors, named after the first visit.
    place = [steps[k].label for k in first_visit_rows(steps)]
    collimated = any(step.reading for step in steps)
    mean = sum(step.reading for step in steps) / len(steps)
    level = sum(step.level for step in steps) / len(steps)
    rows: list[dict[str, float]] = []
    for k, step in enumerate(steps):
        own = {"base": 1.0, f"pier[{step.label}]": 1.0}
        own |= {f"creep[{name}]": float(creeping[p, k]) for p, name in enumerate(named)}
        if step.level != level:
            own[LEVEL_SCALE] = step.level - level
        if bench.backlash:
            own["backlash"] = step.sense / 2
        first = trimmed[k]
        if bench.collimated == "every":
            own[f"face[{step.label}]"] = 1.0
            if collimated:
                own[READING_SCALE] = step.reading - mean
            own[f"polygon[{place[k]}]"] = 1.0
        else:
            read = k if first is None else first
            for h in range(1, len(bench.harmonics) + 1):
                angle = h * steps[read].angle
                own |= {f"sin{h}": sin(angle), f"cos{h}": cos(angle)}
            own[f"division[{place[read]}]"] = 1.0
        if first is not None:
            own[f"trim[{step.label}]"] = 1.0
            if collimated:
                own[READING_SCALE] = step.reading - steps[first].reading
            own[f"polygon[{place[k]}]"] = 1.0
            own[f"polygon[{place[first]}]"] = -1.0
        rows.append(own)
    return rows


def _stated_angles(bench: "DividingHead", steps: Sequence[Index]) -> Array:
    """Return the angles from head, autocollimator and certificate, without the level, (r,) rad."""
    head = np.array([step.angle for step in steps])
    if bench.collimated == "none":
        return head
    if bench.collimated == "every":
        # The head's own reading is not used, so that its rounding has no effect.
        grid = None if bench.polygon else evenly_spaced_angles(steps)
        plain = rows_without_series(steps)
        face, deviation = np.array(
            [_face_angle(bench, step, tilted=k not in plain) for k, step in enumerate(steps)]
        ).T
        reading = np.array([step.reading for step in steps])
        return (face if grid is None else grid) + deviation + reading - reading.mean()
    for k, first in enumerate(_trim_references(bench, steps)):
        if first is not None:
            half_turns = round((head[k] - head[first]) / pi)
            one, other = (steps[j].reading + _face_angle(bench, steps[j])[1] for j in (k, first))
            head[k] = head[first] + half_turns * pi + one - other
    return head


def _face_angle(bench: "DividingHead", step: Index, *, tilted: bool = False) -> tuple[float, float]:
    """Return the nominal angle of the face at a step, and the certified deviation from it, rad.

    A small tilt turns a face by a stated angle.

    Raises
    ------
    InputError
        The polygon has no face at the angle of the step.
    """
    n = len(bench.polygon)
    if n == 0:
        return step.angle, 0.0
    face = round(step.angle * n / (2 * pi))
    if tilted:
        return step.angle, bench.polygon[face % n]
    if not matches_any_angle(step.angle, [2 * pi * face / n]):
        raise InputError(
            f"position {step.label}: {degrees(step.angle):.6g}° is not on a face of a polygon "
            f"with {n} faces, {360 / n:.4g}° apart; give the certificate of the polygon that "
            "was used",
            key="polygon",
            names=(step.label,),
        )
    return 2 * pi * face / n, bench.polygon[face % n]


def _trim_references(bench: "DividingHead", steps: Sequence[Index]) -> list[int | None]:
    """Return, for each step, the row whose reading the head was trimmed to, if any.

    180° is trimmed to 0°, and 270° to 90°, in the same pass or otherwise in the last pass before.
    """
    if bench.collimated != "pairs":
        return [None] * len(steps)
    which, plain = pass_numbers(steps), rows_without_series(steps)
    found: list[int | None] = []
    for k, step in enumerate(steps):
        second = k in plain and matches_any_angle(step.angle, CARDINAL_ANGLES[2:])
        opposite = [
            j
            for j in (plain if second else ())
            if which[j] <= which[k] and matches_any_angle(step.angle, [steps[j].angle + pi])
        ]
        found.append(max(opposite, key=lambda j: (which[j], -j), default=None))
    return found
