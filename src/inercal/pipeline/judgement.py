"""Whether a result is to be relied on, in a word."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inercal.pipeline import Outcome

_DOUBTFUL = 2.0  # Birge ratio: more than this, and the stated noise or model is not to be believed


@dataclass(frozen=True)
class Judgement:
    """The verdict box: its colour ("good", "care" or "bad"), a word, and the lines."""

    tone: str
    word: str
    lines: tuple[str, ...]


def judge(outcome: "Outcome") -> Judgement:
    """Return the verdict with its colour.

    "bad": the fit did not converge, the audit refused something, a scale is far from nominal, or
    the Birge ratio, of filters that of their innovations, doubled uncertainties. "care": a warning,
    residuals larger than stated, or no residuals to judge by. Else "good".
    """
    estimate = outcome.estimate
    severities = {finding.severity for finding in outcome.findings}
    scales = [
        1 + outcome.calibration.value(name)
        for name in outcome.calibration.sensor.coefficients
        if name.partition(".")[2] in ("k1", "scale")
    ]
    far = any(not 0.5 < scale < 2 for scale in scales)
    if not estimate.converged or "refused" in severities or far or estimate.doubt > _DOUBTFUL:
        return Judgement("bad", "Not to be relied on as it is", outcome.verdict)
    if not estimate.dof:
        return Judgement("care", "Usable, but untested", outcome.verdict)
    if "warning" in severities or not estimate.consistent:
        return Judgement("care", "Usable, with reservations", outcome.verdict)
    return Judgement("good", "Consistent with noise and bench as stated", outcome.verdict)
