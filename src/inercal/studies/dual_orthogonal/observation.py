"""The g² observation: what it cannot tell apart, and what its linear form leaves out.

To first order z = ½(y_A² + y_B² − 1) = A(θ) c (`methods.dual_orthogonal.square`), with harmonics up
to the fourth. Products of coefficients are neglected there.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.keys import CoefficientName
from inercal.methods.dual_orthogonal import square
from inercal.sensors import G0
from inercal.studies.claim import shown
from inercal.studies.dual_orthogonal.experiment import (
    COLUMNS,
    LARGE,
    MICRO,
    SENSOR,
    SIZES,
    Case,
    bench,
    ratio,
    simulate,
)
from inercal.studies.dual_orthogonal.methods import FACES, tried
from inercal.studies.rms import Rms, rms
from inercal.studies.section import Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.dual_orthogonal", "observation")

HARMONICS = ("1", "sin θ", "cos θ", "sin 2θ", "cos 2θ", "sin 3θ", "cos 3θ", "cos 4θ")
SHOWN = ("dual, Bayes", "patent", "joint", FACES)
_SINGULAR = 1e-10


def rank(rows: Array) -> int:
    """Return the rank of a matrix."""
    singular = np.linalg.svd(rows)[1]
    return int(np.sum(singular > _SINGULAR * singular[0]))


def open_ranks(n: int = 12) -> tuple[int, int, float]:
    """Return how many combinations are open, K3 unknown and known, and the largest |A v|."""
    rows = square.design(2 * np.pi * np.arange(n) / n)
    without = [k for k, name in enumerate(square.TERMS) if not name.endswith("k3")]
    vectors = [[weights.get(name, 0.0) for name in square.TERMS] for _, weights in square.NULLS]
    every, known = (p.shape[1] - rank(p) for p in (rows, rows[:, without]))
    return every, known, float(np.abs(rows @ np.array(vectors).T).max())


def linear(case: Case) -> Array:
    """Return the errors of the harmonics of z by the linear form, (trials, 8) µg."""
    theta = np.array([step.angle for step in case.steps])
    y = case.seen.mean / G0
    z = (np.sum(y**2, axis=-1) - 1) / 2
    waves = np.stack(
        [np.ones_like(theta)]
        + [f(k * theta) for k in (1, 2, 3) for f in (np.sin, np.cos)]
        + [np.cos(4 * theta)],
        axis=-1,
    )
    true = _coefficients(case) @ square.design(theta).T
    return (z - true) @ np.linalg.pinv(waves).T / MICRO


def _coefficients(case: Case) -> Array:
    """Return the true coefficients in the order of `square.TERMS`, (trials, 11) g."""
    delta = case.truth["delta_o"][:, 1] - case.truth["delta_o"][:, 0]
    by_name = {f"{axis}.{term}": value[:, k]
               for term, value in case.truth.items() for k, axis in enumerate("ab")}  # fmt: skip
    return np.stack([(by_name | {"delta": delta})[name] for name in square.TERMS], axis=-1)


@dataclass(frozen=True, eq=False)
class Forms:
    """What the linear form leaves, by harmonic, and the exact one, in µg."""

    linear: list[Rms]
    exact: float


def forms(sizes: dict[str, float], trials: int, seed: int) -> Forms:
    """Return what both forms leave of readings without noise, with a head of 3″."""
    level = replace(bench(collimated="none"), lean=0.0)
    case = simulate(level, trials, seed, sizes=sizes, noise=0.0)
    off = linear(case)
    seen = square.compare(SENSOR, case.seen.mean, case.true_values, G0)
    return Forms(
        [rms(off[:, k]) for k in range(len(HARMONICS))],
        float(np.sqrt(np.mean(seen.residual**2))) / G0 / MICRO,
    )


def section(trials: int, seed: int) -> Section:
    """Return the section of the g² observation."""
    open_, known, left = open_ranks()
    small, large = forms(SIZES, trials, seed), forms(LARGE, trials, seed)
    findings = [
        WORDS.judge("dependent", known, 0.0,
            f"with K3 unknown they are {open_}, k1 against K3 being the third: rank "
            f"{len(square.TERMS) - open_} of {len(square.TERMS)}")
    ]  # fmt: skip
    for claim, form in (("products", small), ("large_products", large)):
        k = max(range(len(HARMONICS)), key=lambda k: form.linear[k].value)
        worst = form.linear[k]
        findings.append(
            WORDS.judge(claim, worst.value, worst.u,
                f"the RMS of what it adds to the coefficient of {HARMONICS[k]}, the worst; the "
                f"exact form ‖f̂‖ = g leaves {shown(form.exact)} µg")
        )  # fmt: skip
    nulls = "; ".join(
        f"{words}: ({', '.join(map(_named, weights))}) = "
        f"({', '.join(f'{x:g}'.replace('-', '−') for x in weights.values())})"
        for words, weights in square.NULLS
    )
    return WORDS.section(
        findings,
        (
            Table(
                "What the linear form adds to each harmonic of z, RMS, µg", "coefficients",
                HARMONICS,
                [(words, [shown(x.value) for x in form.linear])
                 for words, form in (("nominal", small), ("large", large))],
            ),
            _sizes(trials, seed),
        ),
        nulls=nulls,
        left=shown(left, 1),
    )  # fmt: skip


def _named(name: str) -> str:
    """Return a coefficient as the source writes it: "K_A0" of "a.k0"."""
    axis, term = CoefficientName(name).parts
    return f"{'k' if term == 'k1' else 'K'}_{axis.upper()}{term[1:]}"


def _sizes(trials: int, seed: int) -> Table:
    """Return the table of large coefficients against nominal ones, from the same draws."""
    rows: list[tuple[str, list[str]]] = []
    for method in SHOWN:
        small, large = (tried(method, trials, seed, sizes=sizes) for sizes in (SIZES, LARGE))
        cells = [
            f"{shown(rms(large[name]).value, 3)} ({ratio(large[name], small[name]).value:.3f})"
            for name in COLUMNS
        ]
        rows.append((method, cells))
    return Table(
        "RMS with large coefficients, µg; in brackets over that with nominal ones", "method",
        COLUMNS, rows,
    )  # fmt: skip
