"""Differential evolution replaces the commercial optimiser: equal norms, but other sensors."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from inercal.methods.ship_multi_angle.norm_equations import (
    GOAL,
    Bounds,
    SearchOptions,
    SearchResult,
    damped_solution,
    search,
)
from inercal.methods.ship_planar import fit_level_states
from inercal.physics.sensors.affine import AffineModel
from inercal.studies import study
from inercal.studies.claim import shown
from inercal.studies.ship_model import simulated_rate_table as simulated

TEXT = study.read_section_text("inercal.studies.ship_model", "optimiser")

BOUNDS = {"default": Bounds(), "wide": Bounds(scale=1.0, cross=1.0, bias=1.0)}
_BOUNDS_TEXTS = {"default": "±10 %, ±0.2 g", "wide": "±100 %, ±1 g"}
_SECONDS, _GENERATIONS = 30.0, 400
_WITHIN = 0.01


class OptimiserComparison(NamedTuple):
    """Results for one device: both searches, the damped solution and their errors, g."""

    searches: dict[str, SearchResult]
    vector_error: dict[str, float]
    solution_distance: float  # difference between the default search and the damped solution
    cost_ratio: float  # ratio of their sums of squares
    norm: float  # rms error of their norms
    largest: dict[str, float]  # relative vector error in a fresh pose


def search_calls(case: simulated.ShipModelCase, devices: int, seed: int) -> list[study.Call]:
    """Return the calls that search for the first devices, one for each device and bounds."""
    # Each device has its own seed, because the null directions are random.
    return [
        partial(
            search,
            case.readings[k, case.group_rows],
            case.squared_norm,
            SearchOptions(bounds, 1000 * seed + k, _SECONDS),
            generations=_GENERATIONS,
        )
        for k in range(devices)
        for bounds in BOUNDS.values()
    ]


def compare_searches(
    case: simulated.ShipModelCase, seed: int, results: Sequence[SearchResult]
) -> list[OptimiserComparison]:
    """Return the comparisons of the first devices from the results of the calls."""
    by_device = (results[k : k + len(BOUNDS)] for k in range(0, len(results), len(BOUNDS)))
    return [
        _compare(case.single_device(k), seed, dict(zip(BOUNDS, found, strict=True)))
        for k, found in enumerate(by_device)
    ]


def _compare(
    case: simulated.ShipModelCase, seed: int, found: dict[str, SearchResult]
) -> OptimiserComparison:
    poses = simulated.random_pose_forces(seed)
    start = fit_level_states(case.readings[case.level_rows], case.nominal[case.level_rows]).model
    done = damped_solution(case.readings[case.group_rows], case.squared_norm, start)
    force = np.linalg.norm(poses, axis=-1)

    def off(model: AffineModel) -> float:
        return float(simulated.vector_rms(model, case.device, seed))

    def read(model: AffineModel):
        return simulated.calibration_errors(model, case.device, poses)

    return OptimiserComparison(
        found,
        {name: off(one.model) for name, one in found.items()} | {"damped": off(done.model)},
        float(simulated.rms_length(read(found["default"].model) - read(done.model))),
        found["default"].cost / float(done.cost),
        float(simulated.norm_rms(done.model, case)),
        {
            name: float((np.linalg.norm(read(one.model), axis=-1) / force).max())
            for name, one in found.items()
        },
    )


def median_of_few(values: Sequence[float]) -> simulated.MedianEstimate:
    """Return the median of a few values, its error from their scatter, and the largest value."""
    e = np.array(values)
    # For normal values, the median scatters 1.25 times as much as the mean.
    return simulated.MedianEstimate(
        float(np.median(e)), float(1.25 * e.std(ddof=1) / np.sqrt(len(e))), float(e.max())
    )


def section(searched: Sequence[OptimiserComparison]) -> study.StudySection:
    """Build the section about the optimiser."""
    off = {name: median_of_few([one.vector_error[name] for one in searched]) for name in BOUNDS}
    largest = {name: 100 * max(one.largest[name] for one in searched) for name in BOUNDS}
    ratio = median_of_few([one.cost_ratio for one in searched])
    apart = median_of_few([one.solution_distance / simulated.MILLI for one in searched])
    norm = float(np.median([one.norm for one in searched])) / simulated.MILLI
    worst = max(one.searches["default"].worst for one in searched)
    goals = ", ".join(str(one.searches["default"].goal or "none") for one in searched)
    findings = [
        TEXT.judge("met", 100 * worst, 0.0,
            f"this is the largest of {len(searched)} devices after polishing; before it, they met "
            f"the goal at generations {goals}"),
        *(TEXT.judge(f"far_{name}", largest[name], 0.0,
                f"rms {shown(off[name].value)} g (median), up to {shown(off[name].percentile_95)} "
                "g, while the norm errors are at most  "
                f"{shown(100 * max(w.searches[name].worst for w in searched))} %")
          for name in BOUNDS),
        TEXT.judge("same", ratio.value, np.hypot(ratio.u, _WITHIN / 2),
            "within 1 % is considered similar; both reach the same minimum"),
        TEXT.judge("verifies", apart.value, norm,
            f"u is the norm error of either, {shown(norm)} mg; a triad rotated in any "
            "way has the same sum, so two programs can agree on it and both be wrong"),
    ]  # fmt: skip
    rows = [
        (f"{k + 1}", [f"{one.cost_ratio:.6f}", shown(one.norm / simulated.MILLI),
                      shown(one.vector_error["damped"] / simulated.MILLI),
                      shown(one.vector_error["default"] / simulated.MILLI),
                      shown(one.vector_error["wide"] / simulated.MILLI),
                      shown(one.solution_distance / simulated.MILLI)])
        for k, one in enumerate(searched)
    ]  # fmt: skip
    return TEXT.section(
        *findings,
        study.StudyTable(
              "Results by device, mg, with the ratio of the sums of squares", "device",
              ("sum, optimiser\nover damped", "norms", "vectors,\ndamped",
               "vectors,\noptimiser", "vectors,\nwide bounds", "optimiser\nto damped"), rows),
        _history(searched[0]),
    )  # fmt: skip


def _history(one: OptimiserComparison) -> study.Chart:
    def lines(what: str) -> list[study.Curve]:
        return [
            study.Curve(_BOUNDS_TEXTS[name], np.array([float(g.number) for g in found.history]),
                 np.array([100 * g.worst if what == "worst" else g.cost for g in found.history]))
            for name, found in one.searches.items()
        ]  # fmt: skip

    last = float(max(len(found.history) for found in one.searches.values()))
    goal = study.Curve("goal", np.array([1.0, last]), np.full(2, 100 * GOAL))
    return study.Chart(
        "history",
        "The optimiser's progress for one device, as in the source's Fig. 6: the best member after "
        "each generation, before polishing. The goal is met long before the end, and says nothing "
        "about the accuracy of the coefficients.",
        [
            study.StudyPanel(
                "", "generation", "largest error of a norm, %", [*lines("worst"), goal]
            ),
            study.StudyPanel("", "generation", "sum of squares, g⁴", lines("cost")),
        ],
    )
