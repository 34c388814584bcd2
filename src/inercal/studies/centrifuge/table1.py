"""Table 1: the printed outputs against the design, and the screening without the truth."""

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation import Cauchy, least_squares
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.methods.centrifuge_norm.screening import SuspectRow, screen_rows
from inercal.studies.centrifuge import simulated_centrifuge
from inercal.studies.centrifuge.simulated_centrifuge import BENCH, TRUTH, outputs, steps
from inercal.studies.claim import format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import StudySection, StudyTable

TEXT = read_section_text("inercal.studies.centrifuge", "table1")

_LAST_DIGIT = 1e-6  # V, one unit in the last printed place
_THRESHOLD, _SUSPECT = 2.385, 6.0  # deviations; 2.385: 95 % efficient for normal noise
_ROUNDING_TOLERANCE = _LAST_DIGIT  # the last digit may be cut or rounded


@dataclass(frozen=True, eq=False)
class ScreenedTable:
    """The table as printed and after the screening's repairs, (60, 3) V each."""

    printed: Array
    repaired: Array
    suspects: tuple[SuspectRow, ...]


def read_printed_table() -> Array:
    """Return Table 1 as printed, all signs with it, (60, 3) V."""
    text = files("inercal.studies.centrifuge").joinpath("table1.csv").read_text(encoding="utf-8")
    return np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)[:, 3:]


def repair_table(printed: Array) -> ScreenedTable:
    """Screen the table without the truth, and apply each repair that has no alternative."""
    result, spins = simulated_centrifuge.sensor(), steps()
    suspects = screen_rows(simulated_centrifuge.observations(printed, result), result, BENCH, spins)
    repaired = printed.copy()
    for suspect in suspects:
        if len(suspect.repairs) == 1:
            for axis, value in suspect.repairs[0].after.items():
                repaired[suspect.row, result.channels.index(axis)] = value
    return ScreenedTable(printed, repaired, suspects)


def count_falsely_rejected_rows(found: ScreenedTable) -> int:
    """Return how many correct rows a robust fit of fixed threshold rejects.

    It begins where the nominal sensor is and stays where the wrong rows bend it; screening lets the
    threshold fall step by step instead.
    """
    result, spins = simulated_centrifuge.sensor(), steps()
    requested = norm_problem(
        simulated_centrifuge.observations(found.printed, result), result, BENCH, spins
    )
    fit = least_squares(requested, Cauchy(_THRESHOLD))
    sound = (found.printed == found.repaired).all(axis=1)
    return int(np.sum((np.abs(fit.whitened) > _SUSPECT) & sound))


def section() -> StudySection:
    """Return the section of Table 1."""
    found, design = repair_table(read_printed_table()), outputs(TRUTH, steps())
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
    sensed = simulated_centrifuge.dwell_force(steps())
    named = "; ".join(s.describe() for s in found.suspects[:2])
    findings = (
        TEXT.judge("signs", alike, 0.0,
            f"{int(lost.sum())} entries lost their minus sign, one each in "
            f"{int(lost.any(axis=1).sum())} rows, and {int((wrong & ~lost).sum())} differ "
            "otherwise"),
        TEXT.judge("repaired", after, 0.0,
            f"screening names {len(found.suspects)} rows, each with its one repair ({named}; …); "
            f"then no entry is further than {format_significant(worst)} V from the design, "
            f"{slipped} by more than rounding"),
        TEXT.judge("noise", rms, _LAST_DIGIT / np.sqrt(12),
            f"the repaired table departs from the design by {format_significant(rms)} V rms, which "
            "is the rounding of six decimals: it holds no noise"),
        TEXT.judge("positive", sensed.min(), 0.0,
            f"{int((sensed < -1e-9).sum())} of {sensed.size} components of the design are "
            "negative; "
            "the right root is the one with f → −Δ as D → 0, the printed one"),
    )  # fmt: skip
    return TEXT.section(
        findings, (_table(found, design, lost),), sound=count_falsely_rejected_rows(found)
    )


def _table(found: ScreenedTable, design: Array, lost: NDArray[np.bool_]) -> StudyTable:
    words = {
        s.row: " or ".join(f"{r.kind} of {', '.join(r.after)}" for r in s.repairs)
        for s in found.suspects
    }
    rows: list[tuple[str, list[str]]] = []
    for k, (as_is, result) in enumerate(zip(found.printed, design, strict=True)):
        # One entry has a seventh decimal in print.
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
        "All 180 entries, V; those that lost their sign stand out",
        "rate, position",
        (*heads, "screening:\nrepair"),
        rows,
        marked,
        collapsed=True,
    )
