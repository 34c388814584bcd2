"""Fig. 4: what ignored misalignments do, over its whole range.

The norm sees axes that lean towards one another; it does not see the triad turned. The source's six
angles all alike are a pure rotation, the one choice that does no harm.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from inercal.arrays import Array
from inercal.methods.centrifuge_norm import closed, ml
from inercal.studies.centrifuge import experiment
from inercal.studies.centrifuge.experiment import (
    BENCH,
    TRUTH,
    UNITS,
    G,
    Triad,
    as_printed,
    by_formulas,
    by_ml,
    leaning,
    non_orthogonal,
    outputs,
    regression,
    steps,
    turned,
)
from inercal.studies.claim import shown
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "misalignment")

ANGLES = np.array([2e-4, 4e-4, 6e-4, 8e-4, 10e-4])


@dataclass(frozen=True, eq=False)
class Ignored:
    """Errors of S, b, D, (5, 3, 3), over the angles, by estimator and by what was found of Φ."""

    lean: dict[str, Array]
    turn: dict[str, Array]


def symmetric_ml(device: Triad) -> Array:
    """Return the errors of S, b, D, (3, 3), with the symmetric part of Φ estimated besides."""
    spins, made = steps(), experiment.sensor("misalignment", symmetric=True)
    found = ml(experiment.observations(outputs(device, spins), made), made, BENCH, spins)
    named = dict(zip(found.names, found.value.tolist(), strict=True))
    nine = [named[name] for name in experiment.sensor().coefficients]
    return as_printed(np.array(nine)) - TRUTH.values


def _errors(device: Triad) -> dict[str, Array]:
    spins = steps()
    output = outputs(device, spins)
    return {
        "paper": by_formulas(closed.paper, output, spins) - TRUTH.values,
        "series": by_formulas(closed.series, output, spins) - TRUTH.values,
        "ml": as_printed(by_ml(output, spins).value) - TRUTH.values,
        "ml, Φ found": symmetric_ml(device),
    }


def ignored() -> Ignored:
    """Return what misalignments over the range of Fig. 4 do."""

    def over(devices: list[Triad]) -> dict[str, Array]:
        found = [_errors(device) for device in devices]
        return {name: np.stack([one[name] for one in found]) for name in found[0]}

    gammas = ANGLES.tolist()
    return Ignored(over([non_orthogonal(g) for g in gammas]), over([turned(g) for g in gammas]))


def shares(gamma: float) -> tuple[float, Array]:
    """Return how the change of |f|² by a non-orthogonality is made up.

    It is, to the first order, Σ −2γ·2 uᵢ uⱼ with u = (N − b)/S: products NᵢNⱼ, which (13) lacks,
    first powers of N, and a constant. The regression then folds the products into its powers.

    Returns
    -------
    float
        Share of the first powers in the sum of the rms of the three.
    (4,) array
        Shares of C₁ to C₄ in what the regression finds changed, each by |ΔC| times the rms of its
        power.
    """
    spins = steps()
    norm2 = (np.array([s.rate for s in spins]) ** 2 / G) ** 2 + 1
    straight, leaning = outputs(TRUTH, spins), outputs(non_orthogonal(gamma), spins)
    n, b = straight / TRUTH.scale, TRUTH.bias / TRUTH.scale
    pairs = ((0, 1), (0, 2), (1, 2))
    parts = (
        sum(n[:, i] * n[:, j] for i, j in pairs),
        -sum(n[:, i] * b[j] + n[:, j] * b[i] for i, j in pairs),
        np.array(sum(b[i] * b[j] for i, j in pairs)),
    )
    rms = np.array([np.sqrt(np.mean(np.square(part))) for part in parts])
    size = np.sqrt(np.mean(closed.design(straight) ** 2, axis=0))
    change = np.abs(regression(leaning, norm2) - regression(straight, norm2)) * size
    groups = change[1:].reshape(4, 3).sum(axis=1)
    return float(rms[1] / rms.sum()), groups / groups.sum()


def least(gamma: float) -> tuple[int, Array]:
    """Return how many patterns of Φ's symmetric part there are, and the least errors, (3,).

    Each pair of axes leans by γ, by −γ or not at all; of each pattern the largest |ΔS|, |Δb| and
    |ΔD| of `paper` counts, and the pattern that does least harm.
    """
    spins = steps()
    found: list[Array] = []
    for xy, xz, yz in product((-1, 0, 1), repeat=3):
        if xy or xz or yz:
            phi = np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
            output = outputs(leaning(gamma * phi), spins)
            error = by_formulas(closed.paper, output, spins) - TRUTH.values
            found.append(np.nanmax(np.abs(error), axis=-1))
    return len(found), np.min(found, axis=0)


def worst(errors: Array) -> Array:
    """Return the largest |ΔS|, |Δb|, |ΔD| at each angle, (5, 3); axes without a root left out."""
    return np.nanmax(np.abs(errors), axis=-1)


def section(clean: Array) -> Section:
    """Return the section of Fig. 4.

    Parameters
    ----------
    clean : (3, 3) array
        Errors of `paper` without misalignment.
    """
    found = ignored()
    paper, exact = worst(found.lean["paper"]), worst(found.lean["ml"])
    rest = np.abs(clean).max(axis=1)
    share, folded = shares(ANGLES[0])
    patterns, at_least = least(ANGLES[0])
    rootless = int(np.isnan(found.lean["paper"]).any(axis=(1, 2)).sum())
    turn = worst(found.turn["paper"] - clean).max()
    small = [
        WORDS.judge(
            f"small_{q}", paper[:, k].max(), rest[k],
            f"(16) to (22) err by {shown(paper[:, k].min())} to {shown(paper[:, k].max())} "
            f"{UNITS[q]} over the range, ml with nine parameters by {shown(exact[:, k].min())} to "
            f"{shown(exact[:, k].max())}; of {patterns} patterns of leaning axes the kindest makes "
            f"{shown(at_least[k])} at 2·10⁻⁴ rad",
        )
        for k, q in enumerate("SbD")
    ]  # fmt: skip
    ratio = paper[:, :2] / paper[:, 1:]
    relative = np.nanmax(np.abs(found.lean["paper"]) / TRUTH.values, axis=-1)
    ordering = [
        WORDS.judge(claim, ratio[:, k].mean(), np.ptp(ratio[:, k]) / 2,
            f"it lies between {shown(ratio[:, k].min())} and {shown(ratio[:, k].max())} over the "
            f"range; relative to the coefficients at 2·10⁻⁴ rad: S {shown(relative[0, 0])}, "
            f"b {shown(relative[0, 1])}, D {shown(relative[0, 2])}")
        for k, claim in enumerate(("first", "second"))
    ]  # fmt: skip
    growth = np.diff(paper, axis=0) / paper[:-1]
    grows = WORDS.judge("grows", growth.min(), 0.0,
        f"the largest errors of S, b and D grow by {growth.min():.0%} to {growth.max():.0%} from "
        "each angle to the next",
    )  # fmt: skip
    powers = zip(folded, ("first", "second", "third", "fourth"), strict=True)
    mainly = WORDS.judge("mainly", share, 0.0,
        "misalignments change |f|² by products of two outputs, which (13) does not have; the first "
        f"powers make {share:.1%} of it, and the regression folds the products into all powers, "
        + ", ".join(f"{x:.0%} into the {name}" for x, name in powers),
    )  # fmt: skip
    return WORDS.section(
        (*small, grows, *ordering, mainly),
        (_table(found),),
        (_chart(found),),
        rootless=rootless,
        angles=len(ANGLES),
        turn=shown(turn),
        recovered=shown(worst(found.lean["ml, Φ found"]).max()),
    )


def _table(found: Ignored) -> Table:
    rows: list[tuple[str, list[str]]] = []
    for what, errors in (("non-orthogonality", found.lean), ("rotation", found.turn)):
        for name, values in errors.items():
            largest = worst(values)
            cells = [shown(x) for k in range(3) for x in (largest[0, k], largest[-1, k])]
            rows.append((f"{what}: {name}", cells))
    heads = [f"|Δ{q}| at\n{g}" for q in "SbD" for g in ("2·10⁻⁴ rad", "10⁻³ rad")]
    return Table(
        "Largest errors of S (V/g), b (g) and D (1/g) over the axes that have a root",
        "misalignment, estimator", heads, rows,
    )  # fmt: skip


def _chart(found: Ignored) -> Chart:
    def lines(k: int) -> list[Line]:
        kept = ("paper", "series", "ml")
        return [Line(name, ANGLES * 1e4, worst(found.lean[name])[:, k]) for name in kept] + [
            Line("claimed", ANGLES[[0, -1]] * 1e4, np.full(2, 1e-8))
        ]

    return Chart(
        "misalignment",
        "Largest errors of S, b and D when a non-orthogonality of γ is ignored, by estimator, and "
        "the bound that the source claims. The printed figure is not readable to digits.",
        [
            Panel("", "γ, 10⁻⁴ rad", f"largest |Δ{q}|, {UNITS[q]}", lines(k))
            for k, q in enumerate("SbD")
        ],
    )  # fmt: skip
