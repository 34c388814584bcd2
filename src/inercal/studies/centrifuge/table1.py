"""Table 1: the printed outputs against the design, and what screening finds without the truth."""

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate import Cauchy, least_squares
from inercal.methods.centrifuge_norm.problems import by_norm
from inercal.methods.centrifuge_norm.screening import Suspect, screen
from inercal.studies.centrifuge import experiment
from inercal.studies.centrifuge.experiment import BENCH, TRUTH, outputs, steps
from inercal.studies.claim import shown
from inercal.studies.section import Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "table1")

_PLACE = 1e-6  # V, one unit in the last printed place
_THRESHOLD, _SUSPECT = 2.385, 6.0  # deviations; 2.385: 95 % efficient for normal noise
_SLIP = _PLACE  # the last digit may be cut or rounded


@dataclass(frozen=True, eq=False)
class Printed:
    """The table as printed and after the screening's repairs, (60, 3) V each."""

    printed: Array
    repaired: Array
    suspects: tuple[Suspect, ...]


def as_printed() -> Array:
    """Return Table 1 as printed, all signs with it, (60, 3) V."""
    text = files("inercal.studies.centrifuge").joinpath("table1.csv").read_text(encoding="utf-8")
    return np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)[:, 3:]


def repair(printed: Array) -> Printed:
    """Screen the table, told nothing of the truth, and make each repair that is the only one."""
    made, spins = experiment.sensor(), steps()
    suspects = screen(experiment.observations(printed, made), made, BENCH, spins)
    repaired = printed.copy()
    for suspect in suspects:
        if len(suspect.repairs) == 1:
            for axis, value in suspect.repairs[0].after.items():
                repaired[suspect.row, made.channels.index(axis)] = value
    return Printed(printed, repaired, suspects)


def one_shot(found: Printed) -> int:
    """Return how many sound rows a robust fit of fixed threshold holds for wrong.

    It begins where the nominal sensor is and stays where the wrong rows bend it; screening lets the
    threshold fall step by step instead.
    """
    made, spins = experiment.sensor(), steps()
    asked = by_norm(experiment.observations(found.printed, made), made, BENCH, spins)
    fit = least_squares(asked, Cauchy(_THRESHOLD))
    sound = (found.printed == found.repaired).all(axis=1)
    return int(np.sum((np.abs(fit.whitened) > _SUSPECT) & sound))


def section() -> Section:
    """Return the section of Table 1."""
    found, design = repair(as_printed()), outputs(TRUTH, steps())
    printed = found.printed
    off = np.abs(printed - design)
    wrong = off > _SLIP
    lost = wrong & (np.abs(printed + design) <= _SLIP)
    alike, after = int((~wrong).sum()), int((np.abs(found.repaired - design) <= _SLIP).sum())
    worst = float(np.abs(found.repaired - design).max())
    slipped = int((np.abs(found.repaired - design) > _PLACE / 2 * (1 + 1e-6)).sum())
    rms = float(np.sqrt(np.mean((found.repaired - design) ** 2)))
    felt = experiment.force(steps())
    named = "; ".join(s.in_words() for s in found.suspects[:2])
    findings = (
        WORDS.judge("signs", alike, 0.0,
            f"{int(lost.sum())} entries lost their minus sign, one each in "
            f"{int(lost.any(axis=1).sum())} rows, and {int((wrong & ~lost).sum())} differ "
            "otherwise"),
        WORDS.judge("repaired", after, 0.0,
            f"screening names {len(found.suspects)} rows, each with its one repair ({named}; …); "
            f"then no entry is further than {shown(worst)} V from the design, {slipped} by more "
            "than rounding"),
        WORDS.judge("noise", rms, _PLACE / np.sqrt(12),
            f"the repaired table departs from the design by {shown(rms)} V rms, which is the "
            "rounding of six decimals: it holds no noise"),
        WORDS.judge("positive", felt.min(), 0.0,
            f"{int((felt < -1e-9).sum())} of {felt.size} components of the design are negative; "
            "the right root is the one with f → −Δ as D → 0, the printed one"),
    )  # fmt: skip
    return WORDS.section(findings, (_table(found, design, lost),), sound=one_shot(found))


def _table(found: Printed, design: Array, lost: NDArray[np.bool_]) -> Table:
    words = {
        s.row: " or ".join(f"{r.kind} of {', '.join(r.after)}" for r in s.repairs)
        for s in found.suspects
    }
    rows: list[tuple[str, list[str]]] = []
    for k, (as_is, made) in enumerate(zip(found.printed, design, strict=True)):
        # One entry has a seventh decimal in print.
        cells = [
            text
            for p, x in zip(as_is, made, strict=True)
            for text in (f"{p:.6f}" if p == round(p, 6) else f"{p:.7f}", f"{x:.6f}")
        ]
        name = f"ω{'₁₂₃'[k // 20]}, {k % 20 + 1}"
        rows.append((name, [*(c.replace("-", "−") for c in cells), words.get(k, "")]))
    heads = [f"N_a{axis}\n{what}" for axis in "xyz" for what in ("printed", "design")]
    marked = frozenset((int(k), 2 * int(i)) for k, i in np.argwhere(lost))
    return Table(
        "All 180 entries, V; those that lost their sign stand out",
        "rate, position",
        (*heads, "screening:\nrepair"),
        rows,
        marked,
        folded=True,
    )
