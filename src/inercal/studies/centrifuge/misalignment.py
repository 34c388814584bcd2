"""Compute the effect of ignored misalignments over the full range of Fig. 4.

The norm changes if axes lean towards one another, but not if the triad rotates. The source's six
equal angles are a pure rotation, the only choice without an effect.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.centrifuge_norm import closed_formulas, ml
from inercal.studies import study
from inercal.studies.centrifuge import simulated_centrifuge as simulated
from inercal.studies.claim import shown

TEXT = study.read_section_text("inercal.studies.centrifuge", "misalignment")

ANGLES = np.array([2e-4, 4e-4, 6e-4, 8e-4, 10e-4])


@dataclass(frozen=True, eq=False)
class IgnoredMisalignment:
    """Errors of S, b and D at the five angles, (5, 3, 3), by estimator and estimated part of Φ."""

    non_orthogonality: dict[str, Array]
    turn: dict[str, Array]


def symmetric_ml_errors(device: simulated.SimulatedTriad) -> Array:
    """Return the errors of S, b and D, (3, 3), if the symmetric part of Φ is also estimated."""
    spins, result = simulated.steps(), simulated.sensor("misalignment", symmetric=True)
    found = ml(
        simulated.observations(simulated.outputs(device, spins), result),
        result,
        simulated.BENCH,
        spins,
    )
    named = dict(zip(found.names, found.value.tolist(), strict=True))
    nine = [named[name] for name in simulated.sensor().coefficients]
    return simulated.coefficients_as_printed(np.array(nine)) - simulated.TRUTH.values


def _device_errors(device: simulated.SimulatedTriad) -> dict[str, Array]:
    found = simulated.estimator_errors(simulated.outputs(device, simulated.steps()))
    return found | {"ml, Φ found": symmetric_ml_errors(device)}


def ignored_misalignment_errors() -> IgnoredMisalignment:
    """Return the effects of ignored misalignments over the range of Fig. 4."""

    def over(devices: list[simulated.SimulatedTriad]) -> dict[str, Array]:
        found = [_device_errors(device) for device in devices]
        return {name: np.stack([one[name] for one in found]) for name in found[0]}

    gammas = ANGLES.tolist()
    return IgnoredMisalignment(
        over([simulated.non_orthogonal_triad(g) for g in gammas]),
        over([simulated.rotated_triad(g) for g in gammas]),
    )


def norm_change_shares(gamma: float) -> tuple[float, Array]:
    """Return the components of the change in |f|² that a non-orthogonality causes.

    To first order the change is Σ −2γ·2 uᵢ uⱼ with u = (N − b)/S. It consists of products NᵢNⱼ,
    which (13) does not contain, first powers of N, and a constant. The regression then distributes
    the products among its powers.

    Returns
    -------
    float
        Share of the first powers in the sum of the rms values of the three components.
    (4,) array
        Shares of C₁ to C₄ in the change found by the regression, each as |ΔC| times the rms of its
        power.
    """
    spins = simulated.steps()
    norm2 = (np.array([s.rate for s in spins]) ** 2 / simulated.G) ** 2 + 1
    straight, leaning = (
        simulated.outputs(simulated.TRUTH, spins),
        simulated.outputs(simulated.non_orthogonal_triad(gamma), spins),
    )
    n, b = straight / simulated.TRUTH.scale, simulated.TRUTH.bias / simulated.TRUTH.scale
    pairs = ((0, 1), (0, 2), (1, 2))
    parts = (
        sum(n[:, i] * n[:, j] for i, j in pairs),
        -sum(n[:, i] * b[j] + n[:, j] * b[i] for i, j in pairs),
        np.array(sum(b[i] * b[j] for i, j in pairs)),
    )
    rms = np.array([np.sqrt(np.mean(np.square(part))) for part in parts])
    size = np.sqrt(np.mean(closed_formulas.regression_matrix(straight) ** 2, axis=0))
    change = (
        np.abs(
            simulated.regress_squared_norms(leaning, norm2)
            - simulated.regress_squared_norms(straight, norm2)
        )
        * size
    )
    groups = change[1:].reshape(4, 3).sum(axis=1)
    return float(rms[1] / rms.sum()), groups / groups.sum()


def least_pattern_errors(gamma: float) -> tuple[int, Array]:
    """Return the number of patterns of Φ's symmetric part, and the smallest errors, (3,).

    In a pattern, each pair of axes leans by γ, by −γ or not at all. The errors of a pattern are the
    largest |ΔS|, |Δb| and |ΔD| of `paper`; the result is the minimum over the patterns.
    """
    spins = simulated.steps()
    found: list[Array] = []
    for xy, xz, yz in product((-1, 0, 1), repeat=3):
        if xy or xz or yz:
            phi = np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
            output = simulated.outputs(simulated.misaligned_triad(gamma * phi), spins)
            error = simulated.closed_form_errors(closed_formulas.paper, output)
            found.append(np.nanmax(np.abs(error), axis=-1))
    return len(found), np.min(found, axis=0)


def largest_axis_errors(errors: Array) -> Array:
    """Return the largest |ΔS|, |Δb| and |ΔD| at each angle, (5, 3), over axes with a root."""
    return np.nanmax(np.abs(errors), axis=-1)


def section(clean: Array) -> study.StudySection:
    """Build the section about Fig. 4.

    Parameters
    ----------
    clean : (3, 3) array
        Errors of `paper` without misalignment.
    """
    found = ignored_misalignment_errors()
    paper, exact = (
        largest_axis_errors(found.non_orthogonality["paper"]),
        largest_axis_errors(found.non_orthogonality["ml"]),
    )
    rest = np.abs(clean).max(axis=1)
    share, folded = norm_change_shares(ANGLES[0])
    patterns, at_least = least_pattern_errors(ANGLES[0])
    rootless = int(np.isnan(found.non_orthogonality["paper"]).any(axis=(1, 2)).sum())
    turn = largest_axis_errors(found.turn["paper"] - clean).max()
    small = [
        TEXT.judge(
            f"small_{q}", paper[:, k].max(), rest[k],
            f"(16) to (22) have errors of {shown(paper[:, k].min())} to {shown(paper[:, k].max())} "
            f"{simulated.UNITS[q]} over the range, ml with nine parameters by "
            f"{shown(exact[:, k].min())} to {shown(exact[:, k].max())}; of {patterns} patterns of "
            f"leaning axes, the most favourable one gives {shown(at_least[k])} at 2·10⁻⁴ rad",
        )
        for k, q in enumerate("SbD")
    ]  # fmt: skip
    ratio = paper[:, :2] / paper[:, 1:]
    relative = np.nanmax(np.abs(found.non_orthogonality["paper"]) / simulated.TRUTH.values, axis=-1)
    ordering = [
        TEXT.judge(claim, ratio[:, k].mean(), np.ptp(ratio[:, k]) / 2,
            f"the ratio is between {shown(ratio[:, k].min())} and {shown(ratio[:, k].max())} over "
            f"the range; relative to the coefficients at 2·10⁻⁴ rad: S {shown(relative[0, 0])}, b "
            f"{shown(relative[0, 1])}, D {shown(relative[0, 2])}")
        for k, claim in enumerate(("first", "second"))
    ]  # fmt: skip
    growth = np.diff(paper, axis=0) / paper[:-1]
    grows = TEXT.judge("grows", growth.min(), 0.0,
        f"the largest errors of S, b and D grow by {growth.min():.0%} to {growth.max():.0%} from "
        "each angle to the next",
    )  # fmt: skip
    powers = zip(folded, ("first", "second", "third", "fourth"), strict=True)
    mainly = TEXT.judge("mainly", share, 0.0,
        "misalignments change |f|² by products of two outputs, which (13) does not contain; the "
        f"first powers are {share:.1%} of the change, and the regression distributes the products "
        "among all powers, "
        + ", ".join(f"{x:.0%} into the {name}" for x, name in powers),
    )  # fmt: skip
    findings = (*small, grows, *ordering, mainly)
    return TEXT.section(
        *findings,
        _table(found),
        _chart(found),
        rootless=rootless,
        angles=len(ANGLES),
        turn=shown(turn),
        recovered=shown(largest_axis_errors(found.non_orthogonality["ml, Φ found"]).max()),
    )


def _table(found: IgnoredMisalignment) -> study.StudyTable:
    rows: list[tuple[str, list[str]]] = []
    for what, errors in (("non-orthogonality", found.non_orthogonality), ("rotation", found.turn)):
        for name, values in errors.items():
            largest = largest_axis_errors(values)
            cells = [shown(x) for k in range(3) for x in (largest[0, k], largest[-1, k])]
            rows.append((f"{what}: {name}", cells))
    heads = [f"|Δ{q}| at\n{g}" for q in "SbD" for g in ("2·10⁻⁴ rad", "10⁻³ rad")]
    return study.StudyTable(
        "Largest errors of S (V/g), b (g) and D (1/g) among the axes that have a root",
        "misalignment, estimator", heads, rows,
    )  # fmt: skip


def _chart(found: IgnoredMisalignment) -> study.Chart:
    def lines(k: int) -> list[study.Curve]:
        kept = ("paper", "series", "ml")
        return [
            study.Curve(
                name, ANGLES * 1e4, largest_axis_errors(found.non_orthogonality[name])[:, k]
            )
            for name in kept
        ] + [study.Curve("claimed", ANGLES[[0, -1]] * 1e4, np.full(2, 1e-8))]

    return study.Chart(
        "misalignment",
        "Largest errors of S, b and D when a non-orthogonality of γ is ignored, by estimator, and "
        "the bound that the source claims. Numbers cannot be read from the printed figure.",
        [
            study.StudyPanel("", "γ, 10⁻⁴ rad", f"largest |Δ{q}|, {simulated.UNITS[q]}", lines(k))
            for k, q in enumerate("SbD")
        ],
    )  # fmt: skip
