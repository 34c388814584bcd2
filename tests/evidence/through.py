"""What a generator made, handed to inercal, and what inercal says of it."""

import math
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from tests.evidence.model import Files

from inercal.errors import InercalError
from inercal.pipeline import Outcome, calibrate

Grade = Literal["consistent", "reservations", "unreliable", "refused"]
_ALIKE = math.cos(math.radians(30))


@dataclass(frozen=True)
class Answer:
    """The verdict in short.

    Parameters
    ----------
    grade : str
        Of the three, or that the data were refused.
    first : str
        Name of the suspect, where a test is significant; else of the candidate nearest to it.
    group : tuple of str
        It and the candidates that the data cannot tell from it.
    nees : float
        (error)ᵀ covariance⁻¹ (error) over the number of coefficients; NaN where refused.
    words : str
        The verdict's first line, or the refusal.
    std : mapping of str to float
        Standard uncertainty of each coefficient, SI.
    """

    grade: Grade
    first: str
    group: tuple[str, ...]
    nees: float
    words: str
    std: Mapping[str, float] = field(default_factory=dict[str, float])


def ask(files: Files, truth: dict[str, float]) -> Answer:
    """Return what inercal makes of a run's files; `truth` are coefficients by name, SI."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            raw = content.encode() if isinstance(content, str) else content
            (Path(folder) / name).write_bytes(raw)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                outcome = calibrate(Path(folder) / "run.toml")
        except InercalError as error:
            words = str(error).replace(folder, "")
            return Answer("refused", "", (), math.nan, words)
    first, group = suspects(outcome)
    found = outcome.calibration
    std = dict(zip(found.sensor.coefficients, found.std.tolist(), strict=True))
    return Answer(grade(outcome), first, group, _nees(outcome, truth), outcome.verdict[0], std)


def grade(outcome: Outcome) -> Grade:
    """Return the grade of an outcome: its own, or by the same rule where it has none yet."""
    own = getattr(outcome.verdict, "grade", None)
    if own is not None:
        return own
    estimate = outcome.estimate
    tests = [float(np.min(estimate.p_value))] if estimate.dof else []
    tests += [group.p_value for group in estimate.groups if group.dof]
    tests += [test.p_value for test in estimate.tests]
    scores = [estimate.scored.adjusted(score) for score in estimate.scored.scores]
    bad = min(tests, default=1.0) < 0.005 / max(len(tests), 1) or min(scores, default=1.0) < 0.005
    severities = {finding.severity for finding in outcome.findings}
    scales = [
        1 + outcome.calibration.value(name)
        for name in outcome.calibration.sensor.coefficients
        if name.partition(".")[2] in ("k1", "scale")
    ]
    if "refused" in severities or any(not 0.5 < scale < 2 for scale in scales):
        return "unreliable"
    return "reservations" if bad or "warning" in severities else "consistent"


def suspects(outcome: Outcome) -> tuple[str, tuple[str, ...]]:
    """Return the candidate of the smallest p-value, and those within 30° of it with itself."""
    if hasattr(outcome.verdict, "grade"):
        named = getattr(outcome.verdict, "suspect", None)
        return ("", ()) if named is None else (named.name, (named.name, *named.alike))
    scores = [score for score in outcome.estimate.scored.scores if score.dof]
    if not scores:
        return "", ()
    # Far out all p-values are 0: χ² over degrees of freedom then decides.
    best = min(scores, key=lambda score: (score.p_value, -score.chi2 / score.dof))
    alike = tuple(score.name for score in scores if score.cosine(best) > _ALIKE)
    return best.name, tuple(dict.fromkeys((best.name, *alike)))


def _nees(outcome: Outcome, truth: dict[str, float]) -> float:
    calibration = outcome.calibration
    names = calibration.sensor.coefficients
    error = calibration.values - np.array([truth.get(name, 0.0) for name in names])
    weighed = np.linalg.solve(calibration.covariance, error)
    return float(error @ weighed) / len(names)
