"""Table 2: the printed estimates, recomputed without noise and with it."""

from collections.abc import Sequence
from dataclasses import dataclass

from inercal.studies.centrifuge.centrifuge_trials import ESTIMATORS, CentrifugeTrials
from inercal.studies.centrifuge.simulated_centrifuge import AXES, QUANTITIES, TRUTH, UNITS
from inercal.studies.claim import LIMIT, Claim, ClaimResult, format_significant, judge_claim
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import StudySection, StudyTable

TEXT = read_section_text("inercal.studies.centrifuge", "table2")


@dataclass(frozen=True)
class PrintedEstimate:
    """One printed estimate: S, b or D of an axis, and the value of its last digit."""

    quantity: str
    axis: str
    value: float
    last_digit: float

    @property
    def name(self) -> str:
        """As the source writes it: "D_ax"."""
        return f"{self.quantity}_a{self.axis}"

    @property
    def index(self) -> tuple[int, int]:
        """Row and column in (3, 3) arrays of S, b, D."""
        return QUANTITIES.index(self.quantity), AXES.index(self.axis)


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
    """Return the claim of an entry: S and b as values, D by the accuracy shown."""
    if entry.quantity != "D":
        return Claim(
            entry.name, "Table 2", entry.value, UNITS[entry.quantity], kind="result",
            last_digit=entry.last_digit,
        )  # fmt: skip
    accuracy = abs(entry.value / TRUTH.values[entry.index] - 1)
    return Claim(
        f"{entry.name} right to {format_significant(accuracy)} of itself", "Table 2, "
                                                                           "(21)", accuracy,
        relation="≤", kind="result", basis="derived",
    )  # fmt: skip


def judge_estimate(entry: PrintedEstimate, trials: CentrifugeTrials) -> ClaimResult:
    """Return an entry with the scatter of `paper`, corrected, by the stated noise."""
    result, at = estimate_claim(entry), entry.index
    true, clean = TRUTH.values[at], trials.noise_free["paper"][at]
    noise, error = trials.std("paper")[at], trials.std_error("paper")[at]
    missed = entry.value - true
    if entry.quantity == "D":
        likely = trials.std("ml")[at]
        return judge_claim(
            result, noise / true, error / true,
            f"by (21) noise of 10⁻⁵ V scatters it by {format_significant(noise)} 1/g, "
            f"{format_significant(abs(noise / missed), 3)} times the printed error, and "
            f"{trials.rootless:.1%} of trials have no root; without noise (21) gives "
            f"{format_significant(true + clean, 7)} 1/g; by maximum likelihood the same noise "
            f"scatters it by {format_significant(likely)} 1/g, "
            f"{format_significant(abs(likely / missed), 2)} times the printed error",
        )  # fmt: skip
    text = (
        f"noise of 10⁻⁵ V scatters it by {format_significant(noise)}, the printed estimate is "
        f"{format_significant(missed)} from the truth"
    )
    return judge_claim(result, true + clean, noise, text)


def section(trials: CentrifugeTrials) -> StudySection:
    """Return the section of Table 2."""
    count = len(trials.error["ml"])
    rows: list[tuple[str, list[str]]] = []
    for entry in PRINTED_ESTIMATES:
        at = entry.index
        true = TRUTH.values[at]
        printed = entry.value - true
        cells = [
            format_significant(true, 3),
            format_significant(entry.value, 7),
            format_significant(printed),
            format_significant(abs(printed / true)),
        ]
        cells += [format_significant(trials.noise_free[name][at]) for name in ESTIMATORS]
        cells += [format_significant(trials.std(name)[at]) for name in ESTIMATORS]
        rows.append((f"{entry.name}, {UNITS[entry.quantity]}", cells))
    needed = [
        float(trials.std("paper")[e.index] / abs(e.value - TRUTH.values[e.index]))
        for e in PRINTED_ESTIMATES
        if e.quantity == "D"
    ]
    n = len(trials.error["series"])
    findings = [judge_estimate(entry, trials) for entry in PRINTED_ESTIMATES]
    return TEXT.section(
        findings,
        (
            StudyTable(
                "Estimates, their errors without noise, and their scatter with it",
                "coefficient",
                (
                    "truth", "printed", "printed −\ntruth", "the same,\nrelative",
                    *(f"{name},\nno noise" for name in ESTIMATORS),
                    *(f"{name},\nscatter" for name in ESTIMATORS),
                ),
                rows,
            ),
        ),
        n=n,
        count=count,
        rootless=trials.rootless,
        least=format_significant(min(needed), 2),
        most=format_significant(max(needed), 2),
        too_far=_unexplained_values(findings),
    )  # fmt: skip


def _unexplained_values(findings: Sequence[ClaimResult]) -> str:
    """Return which values are further from the truth than noise explains, in words."""
    far = [f.claim.name for f in findings if f.claim.relation == "=" and f.deviation > LIMIT]
    if not far:
        return "The other values agree with the stated noise."
    return f"Yet {', '.join(far)} are further off than the stated noise explains."
