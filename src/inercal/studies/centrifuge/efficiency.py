"""Study how efficient the estimators are, what the plans determine, and which plan is better."""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.centrifuge_norm import RATES, closed_formulas
from inercal.physics.plan import Spin
from inercal.studies import study
from inercal.studies.centrifuge import simulated_centrifuge as simulated
from inercal.studies.claim import format_all, shown

TEXT = study.read_section_text("inercal.studies.centrifuge", "efficiency")

TERM_COUNT = 13
_SINGULAR = 1e-10


def rank_and_condition(spins: tuple[Spin, ...]) -> tuple[int, float]:
    """Return the rank and the scaled condition number of the thirteen columns in (15)."""
    rows = closed_formulas.regression_matrix(simulated.outputs(simulated.TRUTH, spins))
    singular = np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[1]
    return int(np.sum(singular > _SINGULAR * singular[0])), float(singular[0] / singular[-1])


def least_observable_terms(spins: tuple[Spin, ...]) -> str:
    """Return the three terms in (15) that the dwells separate worst, as text."""
    rows = closed_formulas.regression_matrix(simulated.outputs(simulated.TRUTH, spins))
    vector = np.abs(np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[2][-1])
    terms = ["1", *(f"N_{axis}{power}" for power in ("", "²", "³", "⁴") for axis in simulated.AXES)]
    largest: list[int] = np.argsort(-vector)[:3].tolist()
    return ", ".join(terms[k] for k in largest)


def known_attitude_bound() -> Array:
    """Return the Cramér–Rao bound for S, b and D, (3, 3), with exactly known attitudes."""
    spins = simulated.steps()
    return simulated.stated_deviations(
        simulated.ml_estimate(
            simulated.outputs(simulated.TRUTH, spins), spins, replace(simulated.BENCH, indexing=0.0)
        )
    )


def full_circle_bound() -> Array:
    """Return the bound for S, b and D, (3, 3), with the same number of dwells on a full circle."""
    spins = simulated.steps("full-circle")
    return simulated.stated_deviations(
        simulated.ml_estimate(simulated.outputs(simulated.TRUTH, spins), spins)
    )


def section(trials: simulated.CentrifugeTrials) -> study.StudySection:
    """Build the section about efficiency and the counting rule."""
    known, round_ = known_attitude_bound(), full_circle_bound()
    once = simulated.steps(rates=RATES[:1]) * 3
    twice, thrice = simulated.steps(rates=RATES[:2]), simulated.steps()
    plans = {
        "half circle at one rate, with each dwell repeated three times": once,
        "half circle at two rates": twice,
        "half circle at three rates, as printed": thrice,
        "full circle at three rates": simulated.steps("full-circle"),
    }
    ranks = {name: (spins, *rank_and_condition(spins)) for name, spins in plans.items()}
    of_once, of_twice = (rank for _, rank, _ in list(ranks.values())[:2])
    sets = {
        **{f"{name}, scatter": trials.std(name) for name in simulated.ESTIMATORS},
        "bound: norms": trials.bound,
        "bound: attitudes known": known,
        "bound: full circle, norms": round_,
    }
    ratio = trials.std("ml") / trials.bound
    fewest = len(twice) if of_twice == TERM_COUNT else len(thrice)
    findings = (
        TEXT.judge("enough", of_once, 0.0,
            f"{len(once)} dwells at one rate have rank {of_once} of {TERM_COUNT}"),
        TEXT.judge("needed", fewest, 0.0,
            f"{len(twice)} dwells at two rates have rank {of_twice} of {TERM_COUNT}: the rates and "
            "the attitudes matter, and the condition number shows how well they determine the "
            "terms"),
    )  # fmt: skip
    heads = [f"{q}_a{axis}" for q in simulated.QUANTITIES for axis in simulated.AXES]
    best = trials.bound / round_
    chi2, n = trials.chi2, len(trials.chi2)
    return TEXT.section(
        *findings,
        study.StudyTable("Standard deviations of S (V/g), b (g) and D (1/g)", "", heads,
              [(name, format_all(value.ravel(), 3)) for name, value in sets.items()]),
        study.StudyTable("How well the plans determine the 13 terms of (13)", "plan",
              ("dwells", "rank", "scaled\ncondition number", "worst\nseparated"),
              [(name, [str(len(spins)), str(r),
                       *((shown(c, 3), least_observable_terms(spins))
                         if r == TERM_COUNT else ("singular", ""))])
               for name, (spins, r, c) in ranks.items()]),
        study.Chart(
            "efficiency",
            "Standard deviations divided by the Cramér–Rao bound of the printed design, from "
            "norms only; 1 is the best that its data allow.",
            [
                study.StudyPanel("", "", "σ / bound",
                      [study.Curve(name.removesuffix(", scatter").removeprefix("bound: "),
                            np.arange(9.0), (value / trials.bound).ravel(), connected=False)
                       for name, value in sets.items() if name != "bound: norms"],
                      names=heads),
            ],
        ),
        low=ratio.min(),
        high=ratio.max(),
        n=n,
        expected=2 / np.sqrt(2 * n),
        chi2=chi2.mean(),
        dof=trials.dof,
        least_worse=shown(float((trials.std('paper') / trials.bound)[2].min())),
        most_worse=shown(float((trials.std('paper') / trials.bound)[2].max())),
        better_scale=best[0, 1],
        better_bend=best[2, 1]
    )  # fmt: skip
