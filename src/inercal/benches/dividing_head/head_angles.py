"""Compute the angles of a sensor on a dividing head, and how they depend on the bench."""

from collections.abc import Mapping, Sequence
from math import cos, degrees, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.dividing_head import passes
from inercal.physics.plan import Index

if TYPE_CHECKING:
    from inercal.benches.dividing_head.bench import DividingHead

READING_SCALE = "autocollimator scale"
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
        passes.pass_names(steps),
        passes.drift_ramps(steps),
        _trim_references(bench, steps),
    )
    # All visits to a position share its graduation and face errors, named after the first visit.
    place = [steps[k].label for k in passes.first_visit_rows(steps)]
    collimated = any(step.reading for step in steps)
    mean = sum(step.reading for step in steps) / len(steps)
    rows: list[dict[str, float]] = []
    for k, step in enumerate(steps):
        own = {"base": 1.0, f"pier[{step.label}]": 1.0}
        own |= {f"creep[{name}]": float(creeping[p, k]) for p, name in enumerate(named)}
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
        grid = None if bench.polygon else passes.evenly_spaced_angles(steps)
        plain = passes.rows_without_series(steps)
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
    if not passes.matches_any_angle(step.angle, [2 * pi * face / n]):
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
    which, plain = passes.pass_numbers(steps), passes.rows_without_series(steps)
    found: list[int | None] = []
    for k, step in enumerate(steps):
        second = k in plain and passes.matches_any_angle(step.angle, passes.CARDINAL_ANGLES[2:])
        opposite = [
            j
            for j in (plain if second else ())
            if which[j] <= which[k] and passes.matches_any_angle(step.angle, [steps[j].angle + pi])
        ]
        found.append(max(opposite, key=lambda j: (which[j], -j), default=None))
    return found
