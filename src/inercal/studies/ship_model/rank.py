"""The rank of the multi-angle equations, and the names of what they leave free."""

from math import radians
from typing import NamedTuple

import numpy as np

from inercal.benches.rate_table.fixture import About, Reading, multi_angle_plan
from inercal.frames import exp_so3
from inercal.methods.ship_multi_angle.freedom import Free, free
from inercal.methods.ship_multi_angle.norms import residual, rotations, rows
from inercal.sensors.affine import IDEAL, Affine
from inercal.studies.claim import shown
from inercal.studies.section import Section, Table
from inercal.studies.ship_model.experiment import SENSOR, said
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "rank")

_TURN = radians(30)
PLANS: dict[str, tuple[Reading, About]] = {
    "azimuth": ("azimuth", "tangential"),
    "successive": ("successive", "tangential"),
    "dihedral": ("dihedral", "tangential"),
    "dihedral, other tilts about the radial axis": ("dihedral", "radial"),
}


class Told(NamedTuple):
    """What a plan tells without any error: what is left free, and how null the rotations are."""

    left: Free
    gauge: float  # ‖J·rotation‖ / (‖J‖ ‖rotation‖), the largest
    turned: float  # what a turn of 30° changes in the exact equations, g²


def told(reading: Reading, about: About) -> Told:
    """Return what sixteen groups of a plan tell of an ideal sensor."""
    f = said(multi_angle_plan(reading, about))
    model = Affine.of(IDEAL)
    j, turns = rows(model, f), rotations(model)
    moved = np.linalg.norm(j @ turns.T, axis=0) / np.linalg.norm(turns, axis=1)
    turn = exp_so3(_TURN * np.ones(3) / np.sqrt(3))
    away = residual(Affine(turn, np.zeros(3)), f, (f**2).sum(-1))
    left = free(SENSOR, model, f, np.zeros((3 * len(f), 3 * len(f))))
    return Told(left, float(moved.max() / np.linalg.norm(j)), float(np.abs(away).max()))


def section() -> Section:
    """Return the section of the rank."""
    found = {name: told(*plan) for name, plan in PLANS.items()}
    ranks = {name: one.left.rank for name, one in found.items()}
    blind = found["dihedral"].left.blind
    named = _named(found["dihedral"].left)
    findings = (
        WORDS.judge("always", max(ranks.values()), 0.0,
            "a turn of M and p by any rotation keeps every norm: three null directions of "
            "twelve, whatever the data"),
        WORDS.judge("enough", ranks["azimuth"], 0.0,
            "a norm tells nothing of the rotations, however many groups there are"),
        WORDS.judge("datum", len(blind), 0.0,
            f"{named} is free besides: no pose of one tilt presses on x and y together, and "
            "as dihedral angles 135° and 45° are the pose of 135° again"),
    )  # fmt: skip
    table = [
        (name, [str(one.left.rank), str(len(one.left.turns)), _named(one.left) or "none"])
        for name, one in found.items()
    ]
    gauge = max(one.gauge for one in found.values())
    turned = max(one.turned for one in found.values())
    return WORDS.section(
        findings,
        (
            Table("Rank of 16 equations in 12 unknowns, readings without error",
                  "two tilts read as", ("rank", "rotations free", "free besides"), table),
        ),
        turned=_rounding(turned),
        gauge=_rounding(gauge),
    )  # fmt: skip


def _named(left: Free) -> str:
    words = (one.words.partition(":")[0] for one in left.blind)
    return "; ".join(one.removeprefix("the plan's own ") for one in words)


def _rounding(x: float) -> str:
    return f"less than {shown(10.0 ** np.ceil(np.log10(max(x, 1e-16))), 1)}"
