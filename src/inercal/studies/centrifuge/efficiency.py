"""How well each estimator uses the data, what a plan determines, and a better plan."""

from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.methods.centrifuge_norm import closed
from inercal.methods.centrifuge_norm.plans import RATES
from inercal.plan import Spin
from inercal.studies.centrifuge.experiment import (
    AXES,
    BENCH,
    QUANTITIES,
    TRUTH,
    by_ml,
    outputs,
    stated,
    steps,
)
from inercal.studies.centrifuge.trials import ESTIMATORS, Trials
from inercal.studies.claim import shown
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "efficiency")

TERMS = 13
_SINGULAR = 1e-10


def rank(spins: tuple[Spin, ...]) -> tuple[int, float]:
    """Return the rank of the thirteen columns of (15), and their scaled condition number."""
    rows = closed.design(outputs(TRUTH, spins))
    singular = np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[1]
    return int(np.sum(singular > _SINGULAR * singular[0])), float(singular[0] / singular[-1])


def weakest(spins: tuple[Spin, ...]) -> str:
    """Return the three terms of (15) that the dwells tell apart worst, in words."""
    rows = closed.design(outputs(TRUTH, spins))
    vector = np.abs(np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[2][-1])
    terms = ["1", *(f"N_{axis}{power}" for power in ("", "²", "³", "⁴") for axis in AXES)]
    largest: list[int] = np.argsort(-vector)[:3].tolist()
    return ", ".join(terms[k] for k in largest)


def known_attitudes() -> Array:
    """Return the Cramér–Rao bound of S, b, D, (3, 3), where the attitudes are known exactly."""
    spins = steps()
    return stated(by_ml(outputs(TRUTH, spins), spins, replace(BENCH, indexing=0.0)))


def full_circle() -> Array:
    """Return the bound of S, b, D, (3, 3), of as many dwells all round the circle."""
    spins = steps("full-circle")
    return stated(by_ml(outputs(TRUTH, spins), spins))


def section(trials: Trials) -> Section:
    """Return the section of efficiency and of the counting rule."""
    known, round_ = known_attitudes(), full_circle()
    once = steps(rates=RATES[:1]) * 3
    twice, thrice = steps(rates=RATES[:2]), steps()
    ranks = {
        "half circle, one rate, each dwell three times": (once, *rank(once)),
        "half circle, two rates": (twice, *rank(twice)),
        "half circle, three rates, as printed": (thrice, *rank(thrice)),
        "full circle, three rates": (steps("full-circle"), *rank(steps("full-circle"))),
    }
    _, of_once, _ = ranks["half circle, one rate, each dwell three times"]
    _, of_twice, _ = ranks["half circle, two rates"]
    sets = {
        **{f"{name}, scatter": trials.std(name) for name in ESTIMATORS},
        "bound: norms": trials.bound,
        "bound: attitudes known": known,
        "bound: full circle, norms": round_,
    }
    ratio = trials.std("ml") / trials.bound
    fewest = len(twice) if of_twice == TERMS else len(thrice)
    findings = (
        WORDS.judge("enough", of_once, 0.0,
            f"{len(once)} dwells at one rate have rank {of_once} of {TERMS}"),
        WORDS.judge("needed", fewest, 0.0,
            f"{len(twice)} dwells at two rates have rank {of_twice} of {TERMS}: the rates and "
            "the attitudes decide, and the condition number says how well"),
    )  # fmt: skip
    heads = [f"{q}_a{axis}" for q in QUANTITIES for axis in AXES]
    best = trials.bound / round_
    chi2, n = trials.chi2, len(trials.chi2)
    return WORDS.section(
        findings,
        (
            Table("Standard deviations of S (V/g), b (g) and D (1/g)", "", heads,
                  [(name, [shown(x, 3) for x in value.ravel()]) for name, value in sets.items()]),
            Table("What the plans determine of the 13 terms of (13)", "plan",
                  ("dwells", "rank", "scaled\ncondition number", "worst told\napart"),
                  [(name, [str(len(spins)), str(r),
                           *((shown(c, 3), weakest(spins)) if r == TERMS else ("singular", ""))])
                   for name, (spins, r, c) in ranks.items()]),
        ),
        (
            Chart(
                "efficiency",
                "Standard deviations over the Cramér–Rao bound of the printed design, by norms "
                "alone; 1 is the best that its data allow.",
                [
                    Panel("", "", "σ / bound",
                          [Line(name.removesuffix(", scatter").removeprefix("bound: "),
                                np.arange(9.0), (value / trials.bound).ravel(), joined=False)
                           for name, value in sets.items() if name != "bound: norms"],
                          names=heads),
                ],
            ),
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
