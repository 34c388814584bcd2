"""The head's error against the method: heads of several sizes meet the same draws."""

from dataclasses import dataclass

import numpy as np

from inercal.arrays import Array
from inercal.studies.claim import shown
from inercal.studies.dual_orthogonal.experiment import ratio
from inercal.studies.dual_orthogonal.methods import FACES, tried
from inercal.studies.rms import Rms, rms
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.dual_orthogonal", "head")

HEADS = (0.5, 1.0, 3.0, 10.0)  # ″ rms
SHOWN = ("single", "dual, Bayes", "patent", "joint", FACES)


@dataclass(frozen=True, eq=False)
class Heads:
    """RMS of K0 by method and size of the head, µg, and the patent's of 10″ over a perfect one."""

    k0: dict[str, list[Rms]]
    kept: Rms
    moved: float  # µg, RMS of what the head of 10″ changes of the patent's K0


def compare(trials: int, seed: int) -> Heads:
    """Return what becomes of K0."""

    def error(name: str, head: float) -> Array:
        return tried(name, trials, seed, head=head)["K0"]

    k0 = {name: [rms(error(name, head)) for head in HEADS] for name in SHOWN}
    none, worst = error("patent", 0.0), error("patent", HEADS[-1])
    return Heads(k0, ratio(worst, none), rms(worst - none).value)


def section(found: Heads) -> Section:
    """Return the section of the head's error."""
    alone = found.k0["single"][HEADS.index(3.0)]
    findings = (
        WORDS.judge("free", found.kept.value, found.kept.u,
            f"it moves the K0 of a trial by {shown(found.moved)} µg"),
        WORDS.judge("alone", alone.value, alone.u,
            f"a head of 3″; one of 0.5″ makes {shown(found.k0['single'][0].value)} µg"),
    )  # fmt: skip
    sizes = np.array(HEADS)
    lines = [
        Line(name, sizes, np.array([x.value for x in values])) for name, values in found.k0.items()
    ]
    return WORDS.section(
        findings,
        (
            Table("RMS of K0, µg, by the head's error (rms)", "method",
                  [f"{head:g}″" for head in HEADS],
                  [(name, [shown(x.value, 3) for x in k0]) for name, k0 in found.k0.items()]),
        ),
        (
            Chart("head", "RMS of K0 by the head's error; the same draws throughout.",
                  [Panel("", "head's error, ″ rms", "RMS of K0, µg", lines)]),
        ),
    )  # fmt: skip
