"""Which combinations the g² observation cannot separate, and the errors of its linear form.

To first order z = ½(y_A² + y_B² − 1) = A(θ) c (`methods.dual_orthogonal.g_squared`), with harmonics
up to the fourth. This linear form neglects products of coefficients.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.methods.dual_orthogonal import g_squared
from inercal.physics.sensors import G0
from inercal.studies.claim import Rms, format_all, format_significant, rms
from inercal.studies.dual_orthogonal import simulated_head as simulated
from inercal.studies.dual_orthogonal.studied_methods import EVERY_FACE, method_errors
from inercal.studies.study import StudySection, StudyTable, read_section_text

TEXT = read_section_text("inercal.studies.dual_orthogonal", "observation")

HARMONICS = ("1", "sin θ", "cos θ", "sin 2θ", "cos 2θ", "sin 3θ", "cos 3θ", "cos 4θ")
SHOWN_METHODS = ("dual, Bayes", "patent", "joint", EVERY_FACE)
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
                f"error of the exact form ‖f̂‖ = g is {format_significant(form.exact)} µg")
        )  # fmt: skip
    nulls = "; ".join(
        f"{words}: ({', '.join(map(_source_symbol, weights))}) = "
        f"({', '.join(f'{x:g}'.replace('-', '−') for x in weights.values())})"
        for words, weights in g_squared.NULL_DIRECTIONS
    )
    return TEXT.section(
        findings,
        (
            StudyTable(
                "Error of the linear form in each harmonic of z, RMS, µg", "coefficients",
                HARMONICS,
                [(words, format_all(form.linear))
                 for words, form in (("nominal", small), ("large", large))],
            ),
            _size_table(trials, seed),
        ),
        nulls=nulls,
        left=format_significant(left, 1),
    )  # fmt: skip


def _source_symbol(name: str) -> str:
    """Return a coefficient in the notation of the source: "K_A0" for "a.k0"."""
    axis, term = CoefficientName(name).parts
    return f"{'k' if term == 'k1' else 'K'}_{axis.upper()}{term[1:]}"


def _size_table(trials: int, seed: int) -> StudyTable:
    """Return the table that compares large coefficients with nominal ones, from the same draws."""
    rows: list[tuple[str, list[str]]] = []
    for method in SHOWN_METHODS:
        small = method_errors(method, trials, seed, sizes=simulated.SIZES)
        large = method_errors(method, trials, seed, sizes=simulated.LARGE_SIZES)
        cells = [
            f"{format_significant(rms(large[name]).value, 3)} "
            f"({simulated.rms_ratio(large[name], small[name]).value:.3f})"
            for name in simulated.COLUMNS
        ]
        rows.append((method, cells))
    return StudyTable(
        "RMS with large coefficients, µg; in brackets, divided by that with nominal ones", "method",
        simulated.COLUMNS, rows,
    )  # fmt: skip
