"""Find the accuracy of each method for each coefficient, and the effect of the head's error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import Estimate
from inercal.studies import study
from inercal.studies.claim import Rms, format_all, rms, shown
from inercal.studies.dual_orthogonal.simulated_head import (
    COLUMNS,
    EVERY_FACE,
    METHODS,
    DividingHeadCase,
    estimate_errors,
    method_errors,
    nominal_bench,
    rms_ratio,
    simulate,
)

ACCURACY_TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "accuracy")
FACES_TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "faces")

JOINT_METHOD = "joint"
_CHARTED_METHODS = ("single", "dual, Bayes", "patent, no centrifuge", JOINT_METHOD, EVERY_FACE)


@dataclass(frozen=True, eq=False)
class MethodAccuracy:
    """Accuracy of the methods on one bench, by method and column, µg.

    Parameters
    ----------
    rms : mapping of str to mapping of str to Rms
    nees : mapping of str to Rms
        Mean squared error in units of the stated covariance, per coefficient; 1 if the stated
        uncertainty is correct.
    """

    rms: Mapping[str, Mapping[str, Rms]]
    nees: Mapping[str, Rms]


def method_accuracy_calls(trials: int, seed: int) -> list[study.Call]:
    """Return the calls that `combine_methods` needs, one per method."""
    return [partial(_assess_method, name, trials, seed) for name in METHODS]


def combine_methods(found: Sequence[tuple[dict[str, Rms], Rms | None]]) -> MethodAccuracy:
    """Return the accuracy of the methods with a head of 3″ from the results of the calls."""
    by_name = dict(zip(METHODS, found, strict=True))
    return MethodAccuracy(
        {name: columns for name, (columns, _) in by_name.items()},
        {name: square for name, (_, square) in by_name.items() if square is not None},
    )


def _assess_method(name: str, trials: int, seed: int) -> tuple[dict[str, Rms], Rms | None]:
    method = METHODS[name]
    case = simulate(nominal_bench(collimated=method.collimated), trials, seed)
    estimate = method(case)
    found = {column: rms(error) for column, error in estimate_errors(estimate, case).items()}
    stated = name in (JOINT_METHOD, EVERY_FACE)
    return found, _normalized_error(estimate, case) if stated else None


def _normalized_error(found: Estimate, case: DividingHeadCase) -> Rms:
    p = case.true_values.shape[-1]
    off = found.value[:, :p] - case.true_values
    weighted = np.linalg.solve(found.covariance[:, :p, :p], off[..., None])[..., 0]
    each = np.sum(off * weighted, axis=-1) / p
    return Rms(float(each.mean()), float(each.std() / np.sqrt(len(each))))


def accuracy_section(found: MethodAccuracy) -> study.StudySection:
    """Build the section with the table of methods."""
    patent, pairs = found.rms["patent, no centrifuge"], found.rms[JOINT_METHOD]
    reasons = {
        "K0": "from the four points, with each pair aligned by the autocollimator",
        "k1": f"k1 + K3 is known to {shown(patent['k1 + K3'].value)} µg, but K_A3 and K_B3 act in "
        "the same way on the readings; with K3 from a centrifuge, to 0.5 µg, k1 is known to "
        f"{shown(found.rms['patent']['k1'].value)} µg, and with the autocollimator read at every "
        f"position to {shown(found.rms[EVERY_FACE]['k1'].value)} µg without a centrifuge",
        "δ": "from g² in addition to the four points",
        "K2": f"with K3 from a centrifuge it would be {shown(found.rms['patent']['K2'].value)} µg",
        "Kip": f"from a prior of 20 µg; joint reaches {shown(pairs['Kip'].value)} µg",
    }
    findings = [
        ACCURACY_TEXT.judge(name, patent[name].value, patent[name].u, reason)
        for name, reason in reasons.items()
    ]
    rows = [(name, format_all(by_column.values(), 3)) for name, by_column in found.rms.items()]
    largest = max(x.u / x.value for by_column in found.rms.values() for x in by_column.values())
    places = np.arange(float(len(COLUMNS)))
    lines = [
        # Drawn side by side, because some methods agree.
        study.Curve(name, places + 0.1 * (k - 2),
                    np.array([x.value for x in found.rms[name].values()]), connected=False)
        for k, name in enumerate(_CHARTED_METHODS)
    ]  # fmt: skip
    return ACCURACY_TEXT.section(
        *findings,
        study.StudyTable("RMS of the errors, µg (δ µrad, k1 ppm)", "method", COLUMNS, rows),
        study.Chart("methods", "RMS of the errors by coefficient. The goal is 1 µg; values "
              "above it need a centrifuge, or a face at every position.",
              [study.StudyPanel("", "", "RMS, µg", lines, names=COLUMNS)]),
        largest=largest,
    )  # fmt: skip


def faces_section(found: MethodAccuracy) -> study.StudySection:
    """Build the section about a polygon that is read at every position."""
    few, all_ = found.rms[JOINT_METHOD], found.rms[EVERY_FACE]
    gain = {name: few[name].value / all_[name].value for name in COLUMNS}
    rows = [
        ("four positions", [shown(few[name].value, 3) for name in COLUMNS]),
        ("every position", [shown(all_[name].value, 3) for name in COLUMNS]),
        ("gain", [f"{x:.2f}" for x in gain.values()]),
    ]
    near = ", ".join(f"{x.value:.3f} ± {x.u:.3f}" for x in found.nees.values())
    return FACES_TEXT.section(
        study.StudyTable("RMS of joint, µg (δ µrad, k1 ppm), by the positions where the "
            "autocollimator is read",
              "read at", COLUMNS, rows),
        gain=gain,
        near=near,
    )  # fmt: skip


HEAD_TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "head")

HEAD_ERRORS = (0.5, 1.0, 3.0, 10.0)  # ″ rms
SHOWN_METHODS = ("single", "dual, Bayes", "patent", "joint", EVERY_FACE)
_CASES = (*((name, head) for name in SHOWN_METHODS for head in HEAD_ERRORS), ("patent", 0.0))


@dataclass(frozen=True, eq=False)
class HeadComparison:
    """RMS of K0 by method and head error, µg, and the patent's ratio for 10″ and no error."""

    k0: dict[str, list[Rms]]
    perfect_head_ratio: Rms
    head_change: float  # µg, RMS change of the patent's K0 from a head of 10″


def head_calls(trials: int, seed: int) -> list[study.Call]:
    """Return the calls that `combine_heads` needs, one per method and head."""
    return [partial(_bias_error, name, head, trials, seed) for name, head in _CASES]


def combine_heads(found: Sequence[Array]) -> HeadComparison:
    """Return the errors of K0 by method and head error, from the results of the calls."""
    error = dict(zip(_CASES, found, strict=True))
    k0 = {name: [rms(error[name, head]) for head in HEAD_ERRORS] for name in SHOWN_METHODS}
    none, worst = error["patent", 0.0], error["patent", HEAD_ERRORS[-1]]
    return HeadComparison(k0, rms_ratio(worst, none), rms(worst - none).value)


def _bias_error(name: str, head: float, trials: int, seed: int) -> Array:
    return method_errors(name, trials, seed, head=head)["K0"]


def head_section(found: HeadComparison) -> study.StudySection:
    """Build the section about the head's error."""
    alone = found.k0["single"][HEAD_ERRORS.index(3.0)]
    findings = (
        HEAD_TEXT.judge("free", found.perfect_head_ratio.value, found.perfect_head_ratio.u,
            f"it changes the K0 of a trial by {shown(found.head_change)} µg"),
        HEAD_TEXT.judge("alone", alone.value, alone.u,
            "with a head of 3″; with a head of 0.5″ it is "
            f"{shown(found.k0['single'][0].value)} µg"),
    )  # fmt: skip
    sizes = np.array(HEAD_ERRORS)
    lines = [
        study.Curve(name, sizes, np.array([x.value for x in values]))
        for name, values in found.k0.items()
    ]
    return HEAD_TEXT.section(
        *findings,
        study.StudyTable("RMS of K0, µg, by the head's error (rms)", "method",
              [f"{head:g}″" for head in HEAD_ERRORS],
              [(name, format_all(k0, 3)) for name, k0 in found.k0.items()]),
        study.Chart("head", "RMS of K0 against the head's error, with the same random draws "
              "for all heads.",
              [study.StudyPanel("", "head's error, ″ rms", "RMS of K0, µg", lines)]),
    )  # fmt: skip
