"""Compare the estimators on the same devices by their norm errors and vector errors.

The rank of the multi-angle equations and their null directions explain the differences.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.rate_table.fixture import TiltAxis, TiltConvention, multi_angle_plan
from inercal.methods.ship_multi_angle import damped, joint, planar, planar_norm
from inercal.methods.ship_multi_angle.free_norm_directions import FreeDirections, free_directions
from inercal.methods.ship_multi_angle.norm_equations import (
    norm_jacobian,
    norm_residuals,
    rotation_directions,
)
from inercal.physics.frames import exp_so3
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel
from inercal.studies.claim import format_all, shown
from inercal.studies.ship_model import simulated_rate_table as simulated
from inercal.studies.study import Call, StudySection, StudyTable, read_section_text

TEXT = read_section_text("inercal.studies.ship_model", "estimators")

ESTIMATORS = {"planar": planar, "damped": damped, "planar_norm": planar_norm, "joint": joint}
UNCALIBRATED, UNDAMPED = "uncalibrated", "Gauss–Newton"
_STEPS, _DIVERGED = 20, 1e6  # θ
_DESCRIPTIONS = {
    UNCALIBRATED: "without calibration (M = 1, p = 0)",
    "planar": "uses 9 untilted states as vectors",
    "damped": "uses norms of 16 groups, and starts from planar",
    UNDAMPED: "solves the same equations without damping",
    "planar_norm": "uses untilted states as vectors, tilted states as norms",
    "joint": "uses all 25 states as vectors, with uncertain mountings",
}


@dataclass(frozen=True, eq=False)
class EstimatorComparison:
    """The estimates of all estimators on the same devices."""

    case: simulated.ShipModelCase
    seed: int
    models: Mapping[str, AffineModel]

    def with_only(self, name: str) -> "EstimatorComparison":
        """Return the comparison with only one estimator."""
        return replace(self, models={name: self.models[name]})

    def vector_errors(self, name: str) -> Array:
        """Return the rms vector error on fresh poses, (trials,) g."""
        return simulated.vector_rms(self.models[name], self.case.device, self.seed)

    def norms(self, name: str) -> Array:
        """Return the rms norm error at the groups, (trials,) g."""
        return simulated.norm_rms(self.models[name], self.case)


def estimator_calls(case: simulated.ShipModelCase) -> list[Call]:
    """Return the calls that `combine_estimators` needs, one per estimator."""
    return [*(partial(_estimate_model, case, name) for name in ESTIMATORS),
            partial(_undamped_from_planar, case)]  # fmt: skip


def combine_estimators(
    case: simulated.ShipModelCase, seed: int, found: Sequence[AffineModel]
) -> EstimatorComparison:
    """Return the comparison of all estimators from the results of the calls."""
    trials = len(case.readings)
    none = AffineModel.of(np.broadcast_to(IDENTITY_PARAMETERS, (trials, 12)))
    names = (*ESTIMATORS, UNDAMPED)
    return EstimatorComparison(
        case, seed, {UNCALIBRATED: none} | dict(zip(names, found, strict=True))
    )


def _estimate_model(case: simulated.ShipModelCase, name: str) -> AffineModel:
    estimate = ESTIMATORS[name](case.observations, simulated.SENSOR, case.bench, case.steps)
    return simulated.model_from_estimate(estimate)


def _undamped_from_planar(case: simulated.ShipModelCase) -> AffineModel:
    return undamped_model(case, _estimate_model(case, "planar"))


def undamped_model(case: simulated.ShipModelCase, start: AffineModel) -> AffineModel:
    """Return the result of undamped steps, which divide by rounding errors in null directions.

    The result depends on the rounding of the machine. A device that diverges keeps its last values.
    """
    a = case.readings[..., case.group_rows, :]
    theta = start.theta.copy()
    for _ in range(_STEPS):
        here = np.flatnonzero(np.abs(theta).max(-1) < _DIVERGED)
        model = AffineModel.of(theta[here])
        back = np.asarray(np.linalg.pinv(norm_jacobian(model, a[here]), rcond=0.0), dtype=float)
        off = norm_residuals(model, a[here], case.squared_norm)
        theta[here] -= (back @ off[..., None])[..., 0]
    return AffineModel.of(theta)


def section(
    found: EstimatorComparison, searched: simulated.MedianEstimate, devices: int
) -> StudySection:
    """Build the section with the table; `searched` is the optimiser's result, mg, for `devices`."""
    apart = found.vector_errors(UNDAMPED)
    lost = float(np.mean(apart > 10 * found.vector_errors("planar")))
    table: list[tuple[str, list[str]]] = []
    for name, words in _DESCRIPTIONS.items():
        vector = simulated.median_estimate(found.vector_errors(name) / simulated.MILLI)
        # Without damping, the numbers differ from machine to machine.
        digits = 1 if name == UNDAMPED else 3
        norm = simulated.median_estimate(found.norms(name) / simulated.MILLI)
        cells = format_all((norm.value, vector.value, vector.percentile_95), digits)
        table.append((f"{name}: {words}", cells))
    of_search = ["as damped", *format_all((searched.value, searched.percentile_95))]
    table.append((f"global: the same norms, {devices} devices, with the largest error", of_search))
    best, plain = (
        simulated.median_estimate(found.vector_errors(name) / simulated.MILLI)
        for name in ("joint", "planar")
    )
    return TEXT.section(
        StudyTable("Errors, mg: rms norm error at the groups, and rms vector error on 300 "
            "fresh poses",
              "estimator", ("norms, median", "vectors, median", "vectors, 95 %"),
              table),
        joint=shown(best.value),
        planar=shown(plain.value),
        lost=lost,
    )  # fmt: skip


RANK_TEXT = read_section_text("inercal.studies.ship_model", "rank")
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
    f = simulated.nominal_force(multi_angle_plan(reading, about))
    model = AffineModel.of(IDENTITY_PARAMETERS)
    j, turns = norm_jacobian(model, f), rotation_directions(model)
    moved = np.linalg.norm(j @ turns.T, axis=0) / np.linalg.norm(turns, axis=1)
    turn = exp_so3(_ROTATION_ANGLE * np.ones(3) / np.sqrt(3))
    away = norm_residuals(AffineModel(turn, np.zeros(3)), f, (f**2).sum(-1))
    left = free_directions(simulated.SENSOR, model, f, np.zeros((3 * len(f), 3 * len(f))))
    return PlanInformation(left, float(moved.max() / np.linalg.norm(j)), float(np.abs(away).max()))


def rank_section() -> StudySection:
    """Build the section about the rank."""
    found = {name: plan_information(*plan) for name, plan in PLANS.items()}
    ranks = {name: one.left.rank for name, one in found.items()}
    blind = found["dihedral"].left.unobserved
    named = _free_direction_names(found["dihedral"].left)
    findings = (
        RANK_TEXT.judge("always", max(ranks.values()), 0.0,
            "any rotation of M and p keeps every norm: there are three null directions of "
            "twelve for any data"),
        RANK_TEXT.judge("enough", ranks["azimuth"], 0.0,
            "norms provide no information on rotations, however many groups there are"),
        RANK_TEXT.judge("datum", len(blind), 0.0,
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
    return RANK_TEXT.section(
        *findings,
        StudyTable("Rank of 16 equations in 12 unknowns, readings without error",
              "two tilts read as", ("rank", "rotations free", "also free"), table),
        turned=_bound_text(turned),
        gauge=_bound_text(gauge),
    )  # fmt: skip


def damped_section(found: EstimatorComparison) -> StudySection:
    """Build the section about the damped least squares."""
    norms, vectors = (
        [simulated.median_estimate(of(name) / simulated.MILLI) for name in ("damped", "planar")]
        for of in (found.norms, found.vector_errors)
    )
    worse = (found.vector_errors("damped") > found.vector_errors("planar")).mean()
    findings = (
        DAMPING_TEXT.judge("fits", *simulated.median_ratio(*norms),
            f"{shown(norms[1].value)} mg before, {shown(norms[0].value)} "
            "mg after: the minimised quantity decreases"),
        DAMPING_TEXT.judge("betters", *simulated.median_ratio(*vectors),
            f"{shown(vectors[1].value)} mg before, {shown(vectors[0].value)} mg after; the vector "
            f"error increases for {worse:.0%} of the devices"),
    )  # fmt: skip
    return DAMPING_TEXT.section(*findings)


def _free_direction_names(left: FreeDirections) -> str:
    words = (one.words.partition(":")[0] for one in left.unobserved)
    return "; ".join(one.removeprefix("the plan's own ") for one in words)


def _bound_text(x: float) -> str:
    return f"less than {shown(10.0 ** np.ceil(np.log10(max(x, 1e-16))), 1)}"
