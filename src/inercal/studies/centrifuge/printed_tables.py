"""Compare the printed outputs and estimates, Tables 1 and 2, with the design.

The outputs are screened without using the truth; the estimates are recomputed without and with
noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation import Cauchy, least_squares
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.methods.centrifuge_norm.screening import SuspectRow, screen_rows
from inercal.studies.centrifuge import simulated_centrifuge as simulated
from inercal.studies.claim import LIMIT, Claim, ClaimResult, judge_claim, shown
from inercal.studies.study import StudySection, StudyTable, read_section_text

OUTPUTS_TEXT = read_section_text("inercal.studies.centrifuge", "table1")

_LAST_DIGIT = 1e-6  # V, one unit in the last printed digit
# Standard deviations; 2.385 gives 95 % efficiency for normal noise.
_THRESHOLD, _SUSPECT = 2.385, 6.0
_ROUNDING_TOLERANCE = _LAST_DIGIT  # the last digit may be truncated or rounded


@dataclass(frozen=True, eq=False)
class ScreenedTable:
    """The table as printed and after the repairs from the screening, (60, 3) V each."""

    printed: Array
    repaired: Array
    suspects: tuple[SuspectRow, ...]


def read_printed_table() -> Array:
    """Return Table 1 exactly as printed, including all signs, (60, 3) V."""
    text = files("inercal.studies.centrifuge").joinpath("table1.csv").read_text(encoding="utf-8")
    return np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)[:, 3:]


def repair_table(printed: Array) -> ScreenedTable:
    """Screen the table without using the truth, and apply each unique repair."""
    result, spins = simulated.sensor(), simulated.steps()
    suspects = screen_rows(simulated.observations(printed, result), result, simulated.BENCH, spins)
    repaired = printed.copy()
    for suspect in suspects:
        if len(suspect.repairs) == 1:
            for axis, value in suspect.repairs[0].after.items():
                repaired[suspect.row, result.channels.index(axis)] = value
    return ScreenedTable(printed, repaired, suspects)


def count_falsely_rejected_rows(found: ScreenedTable) -> int:
    """Return the number of correct rows that a robust fit with a fixed threshold rejects.

    Such a fit starts at the nominal sensor and stays biased by the wrong rows. Screening therefore
    decreases the threshold step by step.
    """
    result, spins = simulated.sensor(), simulated.steps()
    requested = norm_problem(
        simulated.observations(found.printed, result), result, simulated.BENCH, spins
    )
    fit = least_squares(requested, Cauchy(_THRESHOLD))
    sound = (found.printed == found.repaired).all(axis=1)
    return int(np.sum((np.abs(fit.whitened) > _SUSPECT) & sound))


def outputs_section() -> StudySection:
    """Build the section about Table 1."""
    found, design = (
        repair_table(read_printed_table()),
        simulated.outputs(simulated.TRUTH, simulated.steps()),
    )
    printed = found.printed
    off = np.abs(printed - design)
    wrong = off > _ROUNDING_TOLERANCE
    lost = wrong & (np.abs(printed + design) <= _ROUNDING_TOLERANCE)
    alike, after = (
        int((~wrong).sum()),
        int((np.abs(found.repaired - design) <= _ROUNDING_TOLERANCE).sum()),
    )
    worst = float(np.abs(found.repaired - design).max())
    slipped = int((np.abs(found.repaired - design) > _LAST_DIGIT / 2 * (1 + 1e-6)).sum())
    rms = float(np.sqrt(np.mean((found.repaired - design) ** 2)))
    sensed = simulated.dwell_force(simulated.steps())
    named = "; ".join(s.describe() for s in found.suspects[:2])
    findings = (
        OUTPUTS_TEXT.judge("signs", alike, 0.0,
            f"{int(lost.sum())} entries lost their minus sign, one each in "
            f"{int(lost.any(axis=1).sum())} rows, and {int((wrong & ~lost).sum())} differ "
            "otherwise"),
        OUTPUTS_TEXT.judge("repaired", after, 0.0,
            f"screening finds {len(found.suspects)} rows, each with a unique repair ({named}; …); "
            f"after the repairs no entry is farther than {shown(worst)} V from the "
            f"design, and {slipped} by more than rounding"),
        OUTPUTS_TEXT.judge("noise", rms, _LAST_DIGIT / np.sqrt(12),
            f"the repaired table differs from the design by {shown(rms)} V rms, which "
            "is the rounding to six decimals, so it contains no noise"),
        OUTPUTS_TEXT.judge("positive", sensed.min(), 0.0,
            f"{int((sensed < -1e-9).sum())} of {sensed.size} components of the design are "
            "negative; the correct root is the printed one, with f → −Δ as D → 0"),
    )  # fmt: skip
    return OUTPUTS_TEXT.section(
        *findings, _outputs_table(found, design, lost), sound=count_falsely_rejected_rows(found)
    )


def _outputs_table(found: ScreenedTable, design: Array, lost: NDArray[np.bool_]) -> StudyTable:
    words = {
        s.row: " or ".join(f"{r.kind} of {', '.join(r.after)}" for r in s.repairs)
        for s in found.suspects
    }
    rows: list[tuple[str, list[str]]] = []
    for k, (as_is, result) in enumerate(zip(found.printed, design, strict=True)):
        # One printed entry has a seventh decimal.
        cells = [
            text
            for p, x in zip(as_is, result, strict=True)
            for text in (f"{p:.6f}" if p == round(p, 6) else f"{p:.7f}", f"{x:.6f}")
        ]
        name = f"ω{'₁₂₃'[k // 20]}, {k % 20 + 1}"
        rows.append((name, [*(c.replace("-", "−") for c in cells), words.get(k, "")]))
    heads = [f"N_a{axis}\n{what}" for axis in "xyz" for what in ("printed", "design")]
    marked = frozenset((int(k), 2 * int(i)) for k, i in np.argwhere(lost))
    return StudyTable(
        "All 180 entries, V; those that lost their sign are highlighted",
        "rate, position",
        (*heads, "screening:\nrepair"),
        rows,
        marked,
        collapsed=True,
    )


ESTIMATES_TEXT = read_section_text("inercal.studies.centrifuge", "table2")


@dataclass(frozen=True)
class PrintedEstimate:
    """One printed estimate of S, b or D for an axis, and the value of its last digit."""

    quantity: str
    axis: str
    value: float
    last_digit: float

    @property
    def name(self) -> str:
        """Return the name as in the source, such as "D_ax"."""
        return f"{self.quantity}_a{self.axis}"

    @property
    def index(self) -> tuple[int, int]:
        """Return the row and the column in (3, 3) arrays of S, b and D."""
        return simulated.QUANTITIES.index(self.quantity), simulated.AXES.index(self.axis)


PRINTED_ESTIMATES = (
    PrintedEstimate("D", "x", 5.700684e-5, 1e-11),
    PrintedEstimate("D", "y", 3.100221e-5, 1e-11),
    PrintedEstimate("D", "z", 4.500459e-5, 1e-11),
    PrintedEstimate("S", "x", 1.28999, 1e-5),
    PrintedEstimate("S", "y", 1.21001, 1e-5),
    PrintedEstimate("S", "z", 1.25996, 1e-5),
    PrintedEstimate("b", "x", 0.212999, 1e-6),
    PrintedEstimate("b", "y", 0.256004, 1e-6),
    PrintedEstimate("b", "z", 0.515972, 1e-6),
)


def estimate_claim(entry: PrintedEstimate) -> Claim:
    """Return the claim for an entry: the value for S and b, the accuracy for D."""
    if entry.quantity != "D":
        return Claim(
            entry.name, "Table 2", entry.value, simulated.UNITS[entry.quantity], kind="result",
            last_digit=entry.last_digit,
        )  # fmt: skip
    accuracy = abs(entry.value / simulated.TRUTH.values[entry.index] - 1)
    return Claim(
        f"{entry.name} accurate to {shown(accuracy)} of its value", "Table 2, "
                                                                           "(21)", accuracy,
        relation="≤", kind="result", basis="derived",
    )  # fmt: skip


def judge_estimate(entry: PrintedEstimate, trials: simulated.CentrifugeTrials) -> ClaimResult:
    """Judge an entry with the scatter of the corrected `paper` from the stated noise."""
    result, at = estimate_claim(entry), entry.index
    true, clean = simulated.TRUTH.values[at], trials.noise_free["paper"][at]
    noise, error = trials.std("paper")[at], trials.std_error("paper")[at]
    missed = entry.value - true
    if entry.quantity == "D":
        likely = trials.std("ml")[at]
        return judge_claim(
            result, noise / true, error / true,
            f"with (21), noise of 10⁻⁵ V scatters it by {shown(noise)} 1/g, "
            f"{shown(abs(noise / missed), 3)} times the printed error, and {trials.rootless:.1%} "
            f"of trials have no root; without noise (21) gives {shown(true + clean, 7)} 1/g; with "
            f"maximum likelihood, the same noise scatters it by {shown(likely)} 1/g, "
            f"{shown(abs(likely / missed), 2)} times the printed error",
        )  # fmt: skip
    text = (
        f"noise of 10⁻⁵ V scatters it by {shown(noise)}, and the printed estimate is "
        f"{shown(missed)} from the truth"
    )
    return judge_claim(result, true + clean, noise, text)


def estimates_section(trials: simulated.CentrifugeTrials) -> StudySection:
    """Build the section about Table 2."""
    count = len(trials.error["ml"])
    rows: list[tuple[str, list[str]]] = []
    for entry in PRINTED_ESTIMATES:
        at = entry.index
        true = simulated.TRUTH.values[at]
        printed = entry.value - true
        cells = [shown(true, 3), shown(entry.value, 7), shown(printed), shown(abs(printed / true))]
        cells += [shown(trials.noise_free[name][at]) for name in simulated.ESTIMATORS]
        cells += [shown(trials.std(name)[at]) for name in simulated.ESTIMATORS]
        rows.append((f"{entry.name}, {simulated.UNITS[entry.quantity]}", cells))
    needed = [
        float(trials.std("paper")[e.index] / abs(e.value - simulated.TRUTH.values[e.index]))
        for e in PRINTED_ESTIMATES
        if e.quantity == "D"
    ]
    n = len(trials.error["series"])
    findings = [judge_estimate(entry, trials) for entry in PRINTED_ESTIMATES]
    return ESTIMATES_TEXT.section(
        *findings,
        StudyTable(
            "Estimates, their errors without noise, and their scatter with it",
            "coefficient",
            (
                "truth", "printed", "printed −\ntruth", "the same,\nrelative",
                *(f"{name},\nno noise" for name in simulated.ESTIMATORS),
                *(f"{name},\nscatter" for name in simulated.ESTIMATORS),
            ),
            rows,
        ),
        n=n,
        count=count,
        rootless=trials.rootless,
        least=shown(min(needed), 2),
        most=shown(max(needed), 2),
        too_far=_unexplained_values(findings),
    )  # fmt: skip


def _unexplained_values(findings: Sequence[ClaimResult]) -> str:
    """List the values that are farther from the truth than noise explains."""
    far = [f.claim.name for f in findings if f.claim.relation == "=" and f.deviation > LIMIT]
    if not far:
        return "The other values agree with the stated noise."
    return f"However, {', '.join(far)} differ by more than the stated noise explains."
