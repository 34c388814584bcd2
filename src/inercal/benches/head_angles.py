"""At which angles a dividing head makes a sensor stand, and what these depend on."""

from collections.abc import Mapping, Sequence
from math import cos, degrees, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.benches.passes import SAME, beyond_turns, pass_names, passes, ramps
from inercal.errors import InputError
from inercal.plan import Index

if TYPE_CHECKING:
    from inercal.benches.dividing_head import DividingHead

Array = NDArray[np.float64]
_ON_FACE = 1e-4  # rad; a position that is further from a face is on none


class Angles(NamedTuple):
    """At which angles ψ the sensor stands, by the bench's parameters q: nominal + Σ weight q."""

    nominal: Array  # (r,), rad
    weights: Mapping[str, Array]  # (r,) each, by full name


def angles(bench: "DividingHead", steps: Sequence[Index]) -> Angles:
    """Return the angles of r steps, with what level, autocollimator and certificate tell.

    Raises
    ------
    InputError
        A collimated position on no face of the polygon.
    """
    rows = acting(bench, steps)
    nominal = [step.angle + step.level + _known(bench, step, steps) for step in steps]
    names = dict.fromkeys(name for row in rows for name in row)
    weights = {name: np.array([row.get(name, 0.0) for row in rows]) for name in names}
    return Angles(np.array(nominal), weights)


def acting(bench: "DividingHead", steps: Sequence[Index]) -> list[dict[str, float]]:
    """Return how the angle of each step depends on the parameters, by full name."""
    if not steps:
        return []
    named = pass_names(steps)
    creeping = ramps(steps)
    rows: list[dict[str, float]] = []
    for k, step in enumerate(steps):
        own = {"base": 1.0, f"pier[{step.label}]": 1.0}
        own |= {f"creep[{name}]": float(creeping[p, k]) for p, name in enumerate(named)}
        first = _trimmed_to(step, steps) if bench.collimated == "pairs" else None
        if bench.collimated == "every":
            own[f"face[{step.label}]"] = 1.0
            own[f"polygon[{_earliest(step, steps).label}]"] = 1.0
        else:
            read = step if first is None else first
            for h in range(1, len(bench.harmonics) + 1):
                own |= {f"sin{h}": sin(h * read.angle), f"cos{h}": cos(h * read.angle)}
            own[f"division[{_earliest(read, steps).label}]"] = 1.0
        if first is not None:
            own[f"trim[{step.label}]"] = 1.0
            own[f"polygon[{_earliest(step, steps).label}]"] = 1.0
            own[f"polygon[{_earliest(first, steps).label}]"] = -1.0
        rows.append(own)
    return rows


def _known(bench: "DividingHead", step: Index, steps: Sequence[Index]) -> float:
    """Return what autocollimator and certificate tell of a step's angle beyond nominal, rad."""
    if bench.collimated == "every":
        return step.reading + _face(bench, step)
    first = _trimmed_to(step, steps) if bench.collimated == "pairs" else None
    if first is None:
        return 0.0
    return step.reading - first.reading + _face(bench, step) - _face(bench, first)


def _face(bench: "DividingHead", step: Index) -> float:
    """Return the certified deviation of the face that is read at a step, rad.

    Raises
    ------
    InputError
        The step is on no face.
    """
    n = len(bench.polygon)
    if n == 0:
        return 0.0
    face = round(step.angle * n / (2 * pi))
    if beyond_turns(step.angle - 2 * pi * face / n) > _ON_FACE:
        raise InputError(
            f"position {step.label}: {degrees(step.angle):.6g}° is on no face of a polygon of {n}, "
            f"which are {360 / n:.4g}° apart; give the certificate of the polygon that was used"
        )
    return bench.polygon[face % n]


def _earliest(step: Index, steps: Sequence[Index]) -> Index:
    """Return the first step at the same position: its graduation and its face err alike."""
    return next(other for other in steps if beyond_turns(other.angle - step.angle) < SAME)


def _trimmed_to(step: Index, steps: Sequence[Index]) -> Index | None:
    """Return the step of the same pass whose reading the head was trimmed to, if any."""
    for second in (pi, 1.5 * pi):
        if beyond_turns(step.angle - second) < SAME:
            of = dict(zip([s.label for s in steps], passes(steps), strict=True))
            for other in steps:
                same = of[other.label] == of[step.label]
                if same and beyond_turns(other.angle - second + pi) < SAME:
                    return other
    return None
