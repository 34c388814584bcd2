"""Find the rank of the multi-angle equations, their null directions and their damped solution."""

from math import radians
from typing import NamedTuple

import numpy as np

from inercal.benches.rate_table.fixture import TiltAxis, TiltConvention, multi_angle_plan
from inercal.methods.ship_multi_angle.free_norm_directions import FreeDirections, free_directions
from inercal.methods.ship_multi_angle.norm_equations import (
    norm_jacobian,
    norm_residuals,
    rotation_directions,
)
from inercal.physics.frames import exp_so3
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel
from inercal.studies.claim import format_significant
from inercal.studies.ship_model.estimators import EstimatorComparison
from inercal.studies.ship_model.simulated_rate_table import (
    MILLI,
    SENSOR,
    median_estimate,
    median_ratio,
    nominal_force,
)
from inercal.studies.study import StudySection, StudyTable, read_section_text

TEXT = read_section_text("inercal.studies.ship_model", "rank")
DAMPING_TEXT = read_section_text("inercal.studies.ship_model", "damping")

_ROTATION_ANGLE = radians(30)
PLANS: dict[str, tuple[TiltConvention, TiltAxis]] = {
    "azimuth": ("azimuth", "tangential"),
    "successive": ("successive", "tangential"),
    "dihedral": ("dihedral", "tangential"),
    "dihedral, other tilts about the radial axis": ("dihedral", "radial"),
}


class PlanInformation(NamedTuple):
    """Observability of a plan without errors: null directions and a check of rotations."""

    left: FreeDirections
    gauge: float  # ‖J·rotation‖ / (‖J‖ ‖rotation‖), the largest
    turned: float  # change in the exact equations for a rotation of 30°, g²


def plan_information(reading: TiltConvention, about: TiltAxis) -> PlanInformation:
    """Return the observability of an ideal sensor in a plan of sixteen groups."""
    f = nominal_force(multi_angle_plan(reading, about))
    model = AffineModel.of(IDENTITY_PARAMETERS)
    j, turns = norm_jacobian(model, f), rotation_directions(model)
    moved = np.linalg.norm(j @ turns.T, axis=0) / np.linalg.norm(turns, axis=1)
    turn = exp_so3(_ROTATION_ANGLE * np.ones(3) / np.sqrt(3))
    away = norm_residuals(AffineModel(turn, np.zeros(3)), f, (f**2).sum(-1))
    left = free_directions(SENSOR, model, f, np.zeros((3 * len(f), 3 * len(f))))
    return PlanInformation(left, float(moved.max() / np.linalg.norm(j)), float(np.abs(away).max()))


def section() -> StudySection:
    """Build the section about the rank."""
    found = {name: plan_information(*plan) for name, plan in PLANS.items()}
    ranks = {name: one.left.rank for name, one in found.items()}
    blind = found["dihedral"].left.unobserved
    named = _free_direction_names(found["dihedral"].left)
    findings = (
        TEXT.judge("always", max(ranks.values()), 0.0,
            "any rotation of M and p keeps every norm: there are three null directions of "
            "twelve for any data"),
        TEXT.judge("enough", ranks["azimuth"], 0.0,
            "norms provide no information on rotations, however many groups there are"),
        TEXT.judge("datum", len(blind), 0.0,
            f"{named} is also free: no pose with one tilt loads x and y together, and "
            "as dihedral angles, 135° and 45° are the same pose as 135°"),
    )  # fmt: skip
    table = [
        (
            name,
            [
                str(one.left.rank),
                str(len(one.left.rotations)),
                _free_direction_names(one.left) or "none",
            ],
        )
        for name, one in found.items()
    ]
    gauge = max(one.gauge for one in found.values())
    turned = max(one.turned for one in found.values())
    return TEXT.section(
        findings,
        (
            StudyTable("Rank of 16 equations in 12 unknowns, readings without error",
                  "two tilts read as", ("rank", "rotations free", "also free"), table),
        ),
        turned=_bound_text(turned),
        gauge=_bound_text(gauge),
    )  # fmt: skip


def damped_section(found: EstimatorComparison) -> StudySection:
    """Build the section about the damped least squares."""
    norms, vectors = (
        [median_estimate(of(name) / MILLI) for name in ("damped", "planar")]
        for of in (found.norms, found.vector_errors)
    )
    worse = (found.vector_errors("damped") > found.vector_errors("planar")).mean()
    findings = (
        DAMPING_TEXT.judge("fits", *median_ratio(*norms),
            f"{format_significant(norms[1].value)} mg before, {format_significant(norms[0].value)} "
            "mg after: the minimised quantity decreases"),
        DAMPING_TEXT.judge("betters", *median_ratio(*vectors),
            f"{format_significant(vectors[1].value)} mg before, "
            f"{format_significant(vectors[0].value)} mg after; the vector error increases for "
            f"{worse:.0%} of the devices"),
    )  # fmt: skip
    return DAMPING_TEXT.section(findings)


def _free_direction_names(left: FreeDirections) -> str:
    words = (one.words.partition(":")[0] for one in left.unobserved)
    return "; ".join(one.removeprefix("the plan's own ") for one in words)


def _bound_text(x: float) -> str:
    return f"less than {format_significant(10.0 ** np.ceil(np.log10(max(x, 1e-16))), 1)}"
