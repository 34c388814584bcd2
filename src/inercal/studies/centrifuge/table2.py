"""Table 2: the printed estimates, recomputed without noise and with it."""

from collections.abc import Sequence
from dataclasses import dataclass

from inercal.studies.centrifuge.experiment import AXES, QUANTITIES, TRUTH, UNITS
from inercal.studies.centrifuge.trials import ESTIMATORS, Trials
from inercal.studies.claim import LIMIT, Claim, Finding, judge, shown
from inercal.studies.section import Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "table2")


@dataclass(frozen=True)
class Entry:
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
    def place(self) -> tuple[int, int]:
        """Row and column in (3, 3) arrays of S, b, D."""
        return QUANTITIES.index(self.quantity), AXES.index(self.axis)


PRINTED = (
    Entry("D", "x", 5.700684e-5, 1e-11),
    Entry("D", "y", 3.100221e-5, 1e-11),
    Entry("D", "z", 4.500459e-5, 1e-11),
    Entry("S", "x", 1.28999, 1e-5),
    Entry("S", "y", 1.21001, 1e-5),
    Entry("S", "z", 1.25996, 1e-5),
    Entry("b", "x", 0.212999, 1e-6),
    Entry("b", "y", 0.256004, 1e-6),
    Entry("b", "z", 0.515972, 1e-6),
)


def claim(entry: Entry) -> Claim:
    """Return the claim of an entry: S and b as values, D by the accuracy shown."""
    if entry.quantity != "D":
        return Claim(
            entry.name, "Table 2", entry.value, UNITS[entry.quantity], kind="result",
            last_digit=entry.last_digit,
        )  # fmt: skip
    accuracy = abs(entry.value / TRUTH.values[entry.place] - 1)
    return Claim(
        f"{entry.name} right to {shown(accuracy)} of itself", "Table 2, (21)", accuracy,
        relation="≤", kind="result", basis="derived",
    )  # fmt: skip


def finding(entry: Entry, trials: Trials) -> Finding:
    """Return an entry beside what `paper`, mended, reaches with the stated noise."""
    made, at = claim(entry), entry.place
    true, clean = TRUTH.values[at], trials.clean["paper"][at]
    noise, error = trials.std("paper")[at], trials.std_error("paper")[at]
    missed = entry.value - true
    if entry.quantity == "D":
        return judge(
            made, noise / true, error / true,
            f"by (21) noise of 10⁻⁵ V scatters it by {shown(noise)} 1/g, "
            f"{shown(abs(noise / missed), 3)} times the printed error, and "
            f"{trials.rootless:.1%} of trials have no root; without noise (21) gives "
            f"{shown(true + clean, 7)} 1/g",
        )  # fmt: skip
    text = (
        f"noise of 10⁻⁵ V scatters it by {shown(noise)}, the printed estimate is "
        f"{shown(missed)} from the truth"
    )
    return judge(made, true + clean, noise, text)


def section(trials: Trials) -> Section:
    """Return the section of Table 2."""
    count = len(trials.error["ml"])
    rows: list[tuple[str, list[str]]] = []
    for entry in PRINTED:
        at = entry.place
        true = TRUTH.values[at]
        printed = entry.value - true
        cells = [shown(true, 3), shown(entry.value, 7), shown(printed), shown(abs(printed / true))]
        cells += [shown(trials.clean[name][at]) for name in ESTIMATORS]
        cells += [shown(trials.std(name)[at]) for name in ESTIMATORS]
        rows.append((f"{entry.name}, {UNITS[entry.quantity]}", cells))
    needed = [
        float(trials.std("paper")[e.place] / abs(e.value - TRUTH.values[e.place]))
        for e in PRINTED
        if e.quantity == "D"
    ]
    n = len(trials.error["series"])
    findings = [finding(entry, trials) for entry in PRINTED]
    return WORDS.section(
        findings,
        (
            Table(
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
        least=shown(min(needed), 2),
        most=shown(max(needed), 2),
        too_far=_too_far(findings),
    )  # fmt: skip


def _too_far(findings: Sequence[Finding]) -> str:
    """Return which values are further from the truth than noise explains, in words."""
    far = [f.claim.name for f in findings if f.claim.relation == "=" and f.off > LIMIT]
    if not far:
        return "The other values agree with the stated noise."
    return f"Yet {', '.join(far)} are further off than the stated noise explains."
