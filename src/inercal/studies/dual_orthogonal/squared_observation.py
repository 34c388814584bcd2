"""Which combinations the g² observation cannot separate, and the errors of its linear form.

To first order z = ½(y_A² + y_B² − 1) = A(θ) c (`methods.dual_orthogonal.g_squared`), with harmonics
up to the fourth. This linear form neglects products of coefficients.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi, sqrt
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.benches.dividing_head.bench import Index, position_plan
from inercal.benches.dividing_head.passes import matches_any_angle
from inercal.methods.dual_orthogonal import g_squared
from inercal.physics.sensors import G0
from inercal.studies import study
from inercal.studies.claim import Rms, format_all, rms, shown
from inercal.studies.dual_orthogonal import simulated_head as simulated
from inercal.studies.study import StudySection, StudyTable, read_section_text

TEXT = read_section_text("inercal.studies.dual_orthogonal", "observation")

HARMONICS = ("1", "sin θ", "cos θ", "sin 2θ", "cos 2θ", "sin 3θ", "cos 3θ", "cos 4θ")
SHOWN_METHODS = ("dual, Bayes", "patent", "joint", simulated.EVERY_FACE)
_SINGULAR = 1e-10


def matrix_rank(rows: Array) -> int:
    """Return the rank of a matrix."""
    singular = np.linalg.svd(rows)[1]
    return int(np.sum(singular > _SINGULAR * singular[0]))


def null_space_dimensions(n: int = 12) -> tuple[int, int, float]:
    """Return the number of undetermined combinations (K3 unknown, known) and the largest |A v|."""
    rows = g_squared.design_matrix(2 * np.pi * np.arange(n) / n)
    without = [k for k, name in enumerate(g_squared.TERMS) if not name.endswith("k3")]
    vectors = [
        [weights.get(name, 0.0) for name in g_squared.TERMS]
        for _, weights in g_squared.NULL_DIRECTIONS
    ]
    every, known = (p.shape[1] - matrix_rank(p) for p in (rows, rows[:, without]))
    return every, known, float(np.abs(rows @ np.array(vectors).T).max())


def linear_form_errors(case: simulated.DividingHeadCase) -> Array:
    """Return the errors of the linear form in the harmonics of z, (trials, 8) µg."""
    theta = np.array([step.angle for step in case.steps])
    y = case.observations.mean / G0
    z = (np.sum(y**2, axis=-1) - 1) / 2
    waves = np.stack(
        [np.ones_like(theta)]
        + [f(k * theta) for k in (1, 2, 3) for f in (np.sin, np.cos)]
        + [np.cos(4 * theta)],
        axis=-1,
    )
    true = _true_terms(case) @ g_squared.design_matrix(theta).T
    return (z - true) @ np.linalg.pinv(waves).T / simulated.MICRO


def _true_terms(case: simulated.DividingHeadCase) -> Array:
    """Return the true coefficients in the order of `g_squared.TERMS`, (trials, 11) g."""
    delta = case.truth["delta_o"][:, 1] - case.truth["delta_o"][:, 0]
    by_name = {f"{axis}.{term}": value[:, k]
               for term, value in case.truth.items() for k, axis in enumerate("ab")}  # fmt: skip
    return np.stack([(by_name | {"delta": delta})[name] for name in g_squared.TERMS], axis=-1)


@dataclass(frozen=True, eq=False)
class FormErrors:
    """Errors of the linear form by harmonic, and error of the exact form, in µg."""

    linear: list[Rms]
    exact: float


def compare_forms(sizes: dict[str, float], trials: int, seed: int) -> FormErrors:
    """Return the errors of both forms for noise-free readings with a head of 3″."""
    level = replace(simulated.nominal_bench(collimated="none"), lean=0.0)
    case = simulated.simulate(level, trials, seed, sizes=sizes, noise=0.0)
    off = linear_form_errors(case)
    seen = g_squared.compare_with_gravity(
        simulated.SENSOR, case.observations.mean, case.true_values, G0
    )
    return FormErrors(
        [rms(off[:, k]) for k in range(len(HARMONICS))],
        float(np.sqrt(np.mean(seen.residual**2))) / G0 / simulated.MICRO,
    )


def section(trials: int, seed: int) -> StudySection:
    """Build the section about the g² observation."""
    open_, known, left = null_space_dimensions()
    small, large = (
        compare_forms(simulated.SIZES, trials, seed),
        compare_forms(simulated.LARGE_SIZES, trials, seed),
    )
    findings = [
        TEXT.judge("dependent", known, 0.0,
            f"with K3 unknown there are {open_}, the third being k1 against K3: rank "
            f"{len(g_squared.TERMS) - open_} of {len(g_squared.TERMS)}")
    ]  # fmt: skip
    for claim, form in (("products", small), ("large_products", large)):
        k = max(range(len(HARMONICS)), key=lambda k: form.linear[k].value)
        worst = form.linear[k]
        findings.append(
            TEXT.judge(claim, worst.value, worst.u,
                f"the RMS of its error in the coefficient of {HARMONICS[k]}, the worst; the "
                f"error of the exact form ‖f̂‖ = g is {shown(form.exact)} µg")
        )  # fmt: skip
    nulls = "; ".join(
        f"{words}: ({', '.join(map(_source_symbol, weights))}) = "
        f"({', '.join(f'{x:g}'.replace('-', '−') for x in weights.values())})"
        for words, weights in g_squared.NULL_DIRECTIONS
    )
    return TEXT.section(
        *findings,
        StudyTable(
            "Error of the linear form in each harmonic of z, RMS, µg", "coefficients",
            HARMONICS,
            [(words, format_all(form.linear))
             for words, form in (("nominal", small), ("large", large))],
        ),
        _size_table(trials, seed),
        nulls=nulls,
        left=shown(left, 1),
    )  # fmt: skip


def _source_symbol(name: str) -> str:
    """Return a coefficient in the notation of the source: "K_A0" for "a.k0"."""
    axis, term = CoefficientName(name).parts
    return f"{'k' if term == 'k1' else 'K'}_{axis.upper()}{term[1:]}"


def _size_table(trials: int, seed: int) -> StudyTable:
    """Return the table that compares large coefficients with nominal ones, from the same draws."""
    rows: list[tuple[str, list[str]]] = []
    for method in SHOWN_METHODS:
        small = simulated.method_errors(method, trials, seed, sizes=simulated.SIZES)
        large = simulated.method_errors(method, trials, seed, sizes=simulated.LARGE_SIZES)
        cells = [
            f"{shown(rms(large[name]).value, 3)} "
            f"({simulated.rms_ratio(large[name], small[name]).value:.3f})"
            for name in simulated.COLUMNS
        ]
        rows.append((method, cells))
    return StudyTable(
        "RMS with large coefficients, µg; in brackets, divided by that with nominal ones", "method",
        simulated.COLUMNS, rows,
    )  # fmt: skip


STEP_TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "step")

COUNTS = (6, 7, 8, 9, 10, 12, 16, 18, 24)
CLAIMED_COUNTS = range(9, 19)  # numbers of positions in a turn, for steps from 40° to 20°
CLAIMED_BEST = 12
_DUAL_TRIAL_RATIO = 8  # trials per trial of dual, which solves trials one by one at eight positions
_CHART_MAXIMUM = 1.0  # µg, largest value in the chart


def positions_with_cardinals(n: int) -> tuple[Index, ...]:
    """Return n evenly spaced positions, plus the cardinal positions that are missing among them."""
    steps = position_plan(n)
    lacking = [
        Index(f"c{k}", k * pi / 2)
        for k in range(4)
        if not matches_any_angle(k * pi / 2, [step.angle for step in steps])
    ]
    return tuple(sorted((*steps, *lacking), key=lambda step: step.angle))


def judged_errors(
    name: str, steps: Sequence[Index], trials: int, seed: int, noise: float = simulated.NOISE
) -> Array | None:
    """Return the errors in `JUDGED_COLUMNS`, (trials, 9) µg, or None if the method fails."""
    try:
        found = simulated.method_errors(name, trials, seed, steps, noise=noise)
    except NotObserved:
        return None
    return np.concatenate(
        [found[column].reshape(trials, -1) for column in simulated.JUDGED_COLUMNS], axis=1
    )


@dataclass(frozen=True, eq=False)
class StepEffect:
    """Effect of a step: errors by method variant, as in `judged_errors`.

    Parameters
    ----------
    n, rank : int
        Number of evenly spaced positions, and the rank of g².
    dual : array or None
    equal_per_position, equal_in_total : mapping of str to array or None
        Errors by method variant, with the same number of readings at each position or in total.
    """

    n: int
    rank: int
    dual: Array | None
    equal_per_position: Mapping[str, Array | None]
    equal_in_total: Mapping[str, Array | None]


_WITH_CARDINALS = "patent, cardinals added"
_PLANS = {
    "patent": ("patent", position_plan),
    _WITH_CARDINALS: ("patent", positions_with_cardinals),
    "joint": ("joint", position_plan),
    simulated.EVERY_FACE: (simulated.EVERY_FACE, position_plan),
}


def step_calls(trials: int, seed: int) -> list[study.Call]:
    """Return the calls that `section` needs: first one per step, then one per plan."""
    effects = [partial(_step_effect, n, trials, seed) for n in reversed(COUNTS)]
    plans = (position_plan, positions_with_cardinals)
    return [*effects, *(partial(_serving_counts, plan, seed) for plan in plans)]


def _serving_counts(plan: Callable[[int], Sequence[Index]], seed: int) -> list[int]:
    """Return the claimed numbers of positions for which the patent's method accepts a plan."""
    return [n for n in CLAIMED_COUNTS if judged_errors("patent", plan(n), 20, seed) is not None]


def _step_effect(n: int, trials: int, seed: int) -> StepEffect:
    each: dict[str, Array | None] = {}
    total: dict[str, Array | None] = {}
    for way, (name, plan) in _PLANS.items():
        visited = plan(n)
        each[way] = judged_errors(name, visited, trials, seed)
        # The same total number of readings as with BEST positions, distributed among the positions.
        shared = simulated.NOISE * sqrt(len(visited) / CLAIMED_BEST)
        total[way] = judged_errors(name, visited, trials, seed, shared)
    rank = matrix_rank(g_squared.design_matrix(2 * pi * np.arange(n) / n))
    dual = judged_errors(
        "dual, Bayes", position_plan(n), max(trials // _DUAL_TRIAL_RATIO, 20), seed
    )
    return StepEffect(n, rank, dual, each, total)


def ratio_to_best_other_step(by_count: Mapping[int, Array | None]) -> tuple[Rms, int]:
    """Return the RMS at 30° over the smallest at other steps, and that step's positions."""
    others = {n: e for n, e in by_count.items() if e is not None and n != CLAIMED_BEST}
    n = min(others, key=lambda k: rms(others[k]).value)
    here = by_count[CLAIMED_BEST]
    assert here is not None
    return simulated.rms_ratio(here, others[n]), n


def best_step(by_count: Mapping[int, Array | None]) -> tuple[float, float, str]:
    """Return the step with the smallest RMS, °, its standard uncertainty and the reason.

    If another step is better than 30°, the uncertainty is chosen so that the two steps differ by as
    many uncertainties as their RMS ratio differs from one, because the Monte Carlo error may make a
    wrong step appear best.
    """
    over, n = ratio_to_best_other_step(by_count)
    words = f"RMS at 30° over that at {360 / n:g}° is {over.value:.3f} ± {over.u:.3f} (k = 1)"
    if over.value <= 1:
        return 360 / CLAIMED_BEST, 0.0, words
    return 360 / n, abs(360 / CLAIMED_BEST - 360 / n) * over.u / (over.value - 1), words


def step_section(results: Sequence[Any]) -> study.StudySection:
    """Build the section about the step from the results of the calls."""
    *effects, serving, helped = results
    found: list[StepEffect] = effects[::-1]
    why = (
        f"{len(serving)} of {len(CLAIMED_COUNTS)} even steps work: the four points are included "
        f"only in {' and '.join(map(str, serving))} positions; with the cardinal positions added, "
        f"{len(helped)} work"
    )
    findings = [
        STEP_TEXT.judge(claim, 360 / n, 0.0, why)
        for claim, n in (("finest", max(serving)), ("coarsest", min(serving)))
    ]
    for claim in ("each", "total"):
        added = {
            s.n: (s.equal_per_position if claim == "each" else s.equal_in_total)[_WITH_CARDINALS]
            for s in found
        }
        at, u, words = best_step(added)
        text = f"{words}; cardinal positions are added if a step does not include them"
        findings.append(STEP_TEXT.judge(claim, at, u, text))
    finer, here = found[-1], next(s for s in found if s.n == CLAIMED_BEST)
    full = next(s.n for s in found if s.rank == max(t.rank for t in found))
    fewest = next(s.n for s in found if s.equal_per_position["patent"] is not None)
    return STEP_TEXT.section(
        *findings,
        _step_table(found),
        _step_chart(found),
        full=full,
        full_step=360 / full,
        fewest=fewest,
        finer=finer.n,
        reached=_rms_cell(finer.equal_in_total[simulated.EVERY_FACE]),
        here=_rms_cell(here.equal_in_total[simulated.EVERY_FACE]),
    )


def _rms_cell(e: Array | None) -> str:
    return "refused" if e is None else shown(rms(e).value, 3)


def _step_table(found: Sequence[StepEffect]) -> study.StudyTable:
    rows = [
        (f"{s.n}, {360 / s.n:.4g}°",
         [str(s.rank), _rms_cell(s.dual),
          *(_rms_cell(by[way])
            for way in _PLANS for by in (s.equal_per_position, s.equal_in_total))])
        for s in found
    ]  # fmt: skip
    heads = [f"{way},\n{what}" for way in _PLANS for what in ("same at each", "same in total")]
    return study.StudyTable(
        "Rank of g² and RMS, µg, by the number of positions",
        "positions, step", ("rank", "dual, Bayes", *heads), rows,
    )  # fmt: skip


def _step_chart(found: Sequence[StepEffect]) -> study.Chart:
    def lines(totals: bool) -> list[study.Curve]:
        result: list[study.Curve] = []
        for way in (_WITH_CARDINALS, "joint", simulated.EVERY_FACE):
            values = [(s.equal_in_total if totals else s.equal_per_position)[way] for s in found]
            kept = [(k, rms(e).value) for k, e in enumerate(values) if e is not None]
            x, y = np.array([(k, value) for k, value in kept if value < _CHART_MAXIMUM]).T
            result.append(study.Curve(way.removesuffix(", cardinals added"), x, y))
        return result

    names = [str(s.n) for s in found]
    return study.Chart(
        "step",
        "RMS against the number of positions, with the same number of readings at each (left) or "
        "in total (right). For patent, cardinal positions are added; joint without both pairs, "
        f"which exceeds {_CHART_MAXIMUM:g} µg, is omitted.",
        [
            study.StudyPanel("", "", "RMS, µg", lines(totals), log_y=False, names=names)
            for totals in (False, True)
        ],
    )
