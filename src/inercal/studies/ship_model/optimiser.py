"""The commercial optimiser's part, by differential evolution: the same norms, another sensor."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.methods.ship_multi_angle.evolution import GOAL, Bounds, Found, Options, search
from inercal.methods.ship_multi_angle.norms import damped
from inercal.methods.ship_planar import level
from inercal.sensors.affine import Affine
from inercal.studies.claim import shown
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.ship_model.experiment import (
    MILLI,
    Case,
    Median,
    errors,
    fresh,
    length,
    norm_rms,
    vector_rms,
)
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "optimiser")

BOUNDS = {"default": Bounds(), "wide": Bounds(scale=1.0, cross=1.0, bias=1.0)}
_WORDS = {"default": "±10 %, ±0.2 g", "wide": "±100 %, ±1 g"}
_SECONDS, _GENERATIONS = 30.0, 400
_WITHIN = 0.01


class Searched(NamedTuple):
    """One device: both searches, the damped solution, and how far each is off, g."""

    found: dict[str, Found]
    off: dict[str, float]
    apart: float  # of the default search and the damped solution
    ratio: float  # of their sums of squares
    norm: float  # rms error of their norms
    largest: dict[str, float]  # relative error as a vector in a fresh pose


def compare(case: Case, devices: int, seed: int) -> list[Searched]:
    """Return what becomes of the first devices."""
    # Chance decides the null directions: each search has its own.
    return [_one(case.one(k), seed, 1000 * seed + k) for k in range(devices)]


def _one(case: Case, seed: int, chance: int) -> Searched:
    a, poses = case.readings[case.groups], fresh(seed)
    start = level(case.readings[case.level], case.nominal[case.level]).model
    done = damped(a, case.square, start)
    found = {
        name: search(a, case.square, Options(bounds, chance, _SECONDS), generations=_GENERATIONS)
        for name, bounds in BOUNDS.items()
    }

    force = np.linalg.norm(poses, axis=-1)

    def off(model: Affine) -> float:
        return float(vector_rms(model, case.device, seed))

    def read(model: Affine):
        return errors(model, case.device, poses)

    return Searched(
        found,
        {name: off(one.model) for name, one in found.items()} | {"damped": off(done.model)},
        float(length(read(found["default"].model) - read(done.model))),
        found["default"].cost / float(done.cost),
        float(norm_rms(done.model, case)),
        {
            name: float((np.linalg.norm(read(one.model), axis=-1) / force).max())
            for name, one in found.items()
        },
    )


def few(values: Sequence[float]) -> Median:
    """Return the median of few values, its error by their scatter, and the largest."""
    e = np.array(values)
    # Of few normal values the median scatters 1.25 times as much as the mean.
    return Median(
        float(np.median(e)), float(1.25 * e.std(ddof=1) / np.sqrt(len(e))), float(e.max())
    )


def section(searched: Sequence[Searched]) -> Section:
    """Return the section of the optimiser."""
    off = {name: few([one.off[name] for one in searched]) for name in BOUNDS}
    largest = {name: 100 * max(one.largest[name] for one in searched) for name in BOUNDS}
    ratio = few([one.ratio for one in searched])
    apart = few([one.apart / MILLI for one in searched])
    norm = float(np.median([one.norm for one in searched])) / MILLI
    worst = max(one.found["default"].worst for one in searched)
    goals = ", ".join(str(one.found["default"].goal or "none") for one in searched)
    findings = [
        WORDS.judge("met", 100 * worst, 0.0,
            f"of {len(searched)} devices, polished; before that met at generations {goals}"),
        *(WORDS.judge(f"far_{name}", largest[name], 0.0,
                f"rms {shown(off[name].value)} g in the median, up to {shown(off[name].high)} g, "
                "where the norms err by no more than "
                f"{shown(100 * max(w.found[name].worst for w in searched))} %")
          for name in BOUNDS),
        WORDS.judge("same", ratio.value, np.hypot(ratio.u, _WITHIN / 2),
            "1 % counts as similar; they have one least sum, and reach it"),
        WORDS.judge("verifies", apart.value, norm,
            f"u is the {shown(norm)} mg by which either errs in the norms; a triad turned "
            "by any rotation has the same sum, so that two programs can agree on it and both "
            "be wrong"),
    ]  # fmt: skip
    rows = [
        (f"{k + 1}", [f"{one.ratio:.6f}", shown(one.norm / MILLI), shown(one.off["damped"] / MILLI),
                      shown(one.off["default"] / MILLI), shown(one.off["wide"] / MILLI),
                      shown(one.apart / MILLI)])
        for k, one in enumerate(searched)
    ]  # fmt: skip
    return WORDS.section(
        findings,
        (
            Table("Device by device, mg; sums of squares as a ratio", "device",
                  ("sum, optimiser\nover damped", "norms", "vectors,\ndamped",
                   "vectors,\noptimiser", "vectors,\nwide bounds", "optimiser\nto damped"), rows),
        ),
        (_history(searched[0]),),
    )  # fmt: skip


def _history(one: Searched) -> Chart:
    def lines(what: str) -> list[Line]:
        return [
            Line(_WORDS[name], np.array([float(g.number) for g in found.history]),
                 np.array([100 * g.worst if what == "worst" else g.cost for g in found.history]))
            for name, found in one.found.items()
        ]  # fmt: skip

    last = float(max(len(found.history) for found in one.found.values()))
    goal = Line("goal", np.array([1.0, last]), np.full(2, 100 * GOAL))
    return Chart(
        "history",
        "The optimiser's history on one device, as the source's Fig. 6: the best member after each "
        "generation, before polishing. The goal is met long before the end, and says nothing of "
        "the coefficients.",
        [
            Panel("", "generation", "largest error of a norm, %", [*lines("worst"), goal]),
            Panel("", "generation", "sum of squares, g⁴", lines("cost")),
        ],
    )
