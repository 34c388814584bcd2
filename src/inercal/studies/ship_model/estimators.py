"""The estimators on the same devices, in the norms they see and in the vectors they are for."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inercal.arrays import Array
from inercal.methods.ship_multi_angle import damped, joint, planar, planar_norm
from inercal.methods.ship_multi_angle.norms import residual, rows
from inercal.sensors.affine import IDEAL, Affine
from inercal.studies.claim import shown
from inercal.studies.section import Section, Table
from inercal.studies.ship_model.experiment import (
    MILLI,
    SENSOR,
    Case,
    Median,
    median,
    model_of,
    norm_rms,
    simulate,
    vector_rms,
)
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "estimators")

ESTIMATORS = {"planar": planar, "damped": damped, "planar_norm": planar_norm, "joint": joint}
NONE, NAIVE = "uncalibrated", "Gauss–Newton"
_STEPS, _LOST = 20, 1e6  # of θ
_WORDS = {
    NONE: "M = 1, p = 0",
    "planar": "9 untilted states, as vectors",
    "damped": "norms of 16 groups, from planar",
    NAIVE: "the same equations, not damped",
    "planar_norm": "untilted as vectors, tilted as norms",
    "joint": "all 25 as vectors, mountings uncertain",
}


@dataclass(frozen=True, eq=False)
class Compared:
    """What each estimator makes of the same devices."""

    case: Case
    seed: int
    models: Mapping[str, Affine]

    def vectors(self, name: str) -> Array:
        """Return the rms error on fresh poses, (trials,) g."""
        return vector_rms(self.models[name], self.case.device, self.seed)

    def norms(self, name: str) -> Array:
        """Return the rms error of the groups' norms, (trials,) g."""
        return norm_rms(self.models[name], self.case)


def compare(trials: int, seed: int) -> Compared:
    """Return the estimates of so many devices."""
    case = simulate(trials, seed)
    models = {NONE: Affine.of(np.broadcast_to(IDEAL, (trials, 12)))}
    for name, estimator in ESTIMATORS.items():
        models[name] = model_of(estimator(case.seen, SENSOR, case.bench, case.steps))
    models[NAIVE] = naive(case, models["planar"])
    return Compared(case, seed, models)


def naive(case: Case, start: Affine) -> Affine:
    """Return where undamped steps lead: what rounding leaves of a null direction is divided by.

    It hangs on the rounding of the machine; a device that runs away is left where it went.
    """
    a = case.readings[..., case.groups, :]
    theta = start.theta.copy()
    for _ in range(_STEPS):
        here = np.flatnonzero(np.abs(theta).max(-1) < _LOST)
        model = Affine.of(theta[here])
        back = np.asarray(np.linalg.pinv(rows(model, a[here]), rcond=0.0), dtype=float)
        off = residual(model, a[here], case.square)
        theta[here] -= (back @ off[..., None])[..., 0]
    return Affine.of(theta)


def section(found: Compared, searched: Median, devices: int) -> Section:
    """Return the section of the table; the optimiser reaches `searched`, mg, of so many devices."""
    apart = found.vectors(NAIVE)
    lost = float(np.mean(apart > 10 * found.vectors("planar")))
    table: list[tuple[str, list[str]]] = []
    for name, words in _WORDS.items():
        vector = median(found.vectors(name) / MILLI)
        # Undamped, no two machines have the same figures.
        digits = 1 if name == NAIVE else 3
        norm = shown(median(found.norms(name) / MILLI).value, digits)
        cells = [norm, *(shown(x, digits) for x in (vector.value, vector.high))]
        table.append((f"{name}: {words}", cells))
    of_search = shown(searched.value), shown(searched.high)
    table.append(
        (f"global: the same norms, {devices} devices and the largest", ["as damped", *of_search])
    )
    best, plain = (median(found.vectors(name) / MILLI) for name in ("joint", "planar"))
    return WORDS.section(
        (),
        (
            Table("Errors, mg: rms of the groups' norms, and rms as a vector on 300 fresh poses",
                  "estimator", ("norms, median", "vectors, median", "vectors, 95 %"),
                  table),
        ),
        joint=shown(best.value),
        planar=shown(plain.value),
        lost=lost,
    )  # fmt: skip
