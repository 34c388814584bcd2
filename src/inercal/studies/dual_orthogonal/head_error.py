"""The head's error by method: heads with errors of several sizes, with the same random draws."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from inercal.basics.arrays import Array
from inercal.studies.claim import format_significant
from inercal.studies.dual_orthogonal.simulated_head import rms_ratio
from inercal.studies.dual_orthogonal.studied_methods import EVERY_FACE, method_errors
from inercal.studies.rms import Rms, rms
from inercal.studies.section_texts import read_section_text
from inercal.studies.stages import Call
from inercal.studies.study_content import Chart, Curve, StudyPanel, StudySection, StudyTable

TEXT = read_section_text("inercal.studies.dual_orthogonal", "head")

HEAD_ERRORS = (0.5, 1.0, 3.0, 10.0)  # ″ rms
SHOWN_METHODS = ("single", "dual, Bayes", "patent", "joint", EVERY_FACE)
_CASES = (*((name, head) for name in SHOWN_METHODS for head in HEAD_ERRORS), ("patent", 0.0))


@dataclass(frozen=True, eq=False)
class HeadComparison:
    """RMS of K0 by method and size of the head, µg, and the patent's of 10″ over a perfect one."""

    k0: dict[str, list[Rms]]
    perfect_head_ratio: Rms
    head_change: float  # µg, RMS change of the patent's K0 by the head of 10″


def head_calls(trials: int, seed: int) -> list[Call]:
    """Return the calls, one a method and head, that `combine_heads` needs."""
    return [partial(_bias_error, name, head, trials, seed) for name, head in _CASES]


def combine_heads(found: Sequence[Array]) -> HeadComparison:
    """Return the errors of K0 by method and size of the head, from the results of the calls."""
    error = dict(zip(_CASES, found, strict=True))
    k0 = {name: [rms(error[name, head]) for head in HEAD_ERRORS] for name in SHOWN_METHODS}
    none, worst = error["patent", 0.0], error["patent", HEAD_ERRORS[-1]]
    return HeadComparison(k0, rms_ratio(worst, none), rms(worst - none).value)


def _bias_error(name: str, head: float, trials: int, seed: int) -> Array:
    return method_errors(name, trials, seed, head=head)["K0"]


def section(found: HeadComparison) -> StudySection:
    """Return the section of the head's error."""
    alone = found.k0["single"][HEAD_ERRORS.index(3.0)]
    findings = (
        TEXT.judge("free", found.perfect_head_ratio.value, found.perfect_head_ratio.u,
            f"it moves the K0 of a trial by {format_significant(found.head_change)} µg"),
        TEXT.judge("alone", alone.value, alone.u,
            f"a head of 3″; one of 0.5″ makes {format_significant(found.k0['single'][0].value)} "
            "µg"),
    )  # fmt: skip
    sizes = np.array(HEAD_ERRORS)
    lines = [
        Curve(name, sizes, np.array([x.value for x in values])) for name, values in found.k0.items()
    ]
    return TEXT.section(
        findings,
        (
            StudyTable("RMS of K0, µg, by the head's error (rms)", "method",
                  [f"{head:g}″" for head in HEAD_ERRORS],
                  [(name, [format_significant(x.value, 3) for x in k0])
                   for name, k0 in found.k0.items()]),
        ),
        (
            Chart("head", "RMS of K0 by the head's error; the same draws throughout.",
                  [StudyPanel("", "head's error, ″ rms", "RMS of K0, µg", lines)]),
        ),
    )  # fmt: skip
