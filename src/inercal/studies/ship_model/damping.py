"""Damping: it solves the equations short of rank, and leaves what they do not tell as it was."""

from inercal.studies.claim import Claim, judge, shown
from inercal.studies.section import Section
from inercal.studies.ship_model.estimators import Compared
from inercal.studies.ship_model.experiment import MILLI, median, over

FITS = Claim("damping betters the equations: norm error at the groups over planar's",
             "section 3.2, method 1", 1.0, "", "≤", basis="words")  # fmt: skip
BETTERS = Claim("damping raises the accuracy: vector error on fresh poses over planar's",
                "section 3.2, method 1", 1.0, "", "≤", basis="words")  # fmt: skip


def section(found: Compared) -> Section:
    """Return the section of the damped least squares."""
    norms, vectors = (
        [median(of(name) / MILLI) for name in ("damped", "planar")]
        for of in (found.norms, found.vectors)
    )
    worse = (found.vectors("damped") > found.vectors("planar")).mean()
    findings = (
        judge(FITS, *over(*norms),
              f"{shown(norms[1].value)} mg before, {shown(norms[0].value)} mg after: what is "
              "minimised falls"),
        judge(BETTERS, *over(*vectors),
              f"{shown(vectors[1].value)} mg before, {shown(vectors[0].value)} mg after; of "
              f"{worse:.0%} of the devices it is worse"),
    )  # fmt: skip
    return Section(
        "damping",
        "Damping: the norms better, the calibration worse",
        (
            "Levenberg–Marquardt starts from the planar solution. Its step has no part along a "
            "null direction, where the result is as planar was. Along the others it follows the "
            "norms, weakly told ones too: it fits the errors of the tilted mountings, and the "
            "experiment that judges by the same norms sees an improvement.",
        ),
        findings,
    )
