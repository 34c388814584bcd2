"""Compare the estimators on the same devices by their norm errors and vector errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.ship_multi_angle import damped, joint, planar, planar_norm
from inercal.methods.ship_multi_angle.norm_equations import norm_jacobian, norm_residuals
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel
from inercal.studies.claim import format_all, format_significant
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
        (),
        (
            StudyTable("Errors, mg: rms norm error at the groups, and rms vector error on 300 "
                "fresh poses",
                  "estimator", ("norms, median", "vectors, median", "vectors, 95 %"),
                  table),
        ),
        joint=format_significant(best.value),
        planar=format_significant(plain.value),
        lost=lost,
    )  # fmt: skip
