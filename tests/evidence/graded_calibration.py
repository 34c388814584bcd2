"""What a generator made, handed to inercal, and what inercal says of it."""

import math
import re
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from tests.calibration.short_lines import require_short
from tests.evidence.visibility_model import Files

from inercal.basics.errors import InercalError
from inercal.calibration.detectability import undetectable_causes
from inercal.calibration.explanation import UNDETECTABLE, Addition
from inercal.pipeline import Outcome, calibrate

Grade = Literal["consistent", "reservations", "unreliable", "refused"]
TOTAL = "χ²"  # of the estimate, among its groups of residuals
_LIMIT = ("cannot detect", "not detectable")
_CHANGE = re.compile(r"change within (.+) \((\w+)\)")
_DRIFT = re.compile(r"drift common to all sections \((\w+)\)")


@dataclass(frozen=True)
class GradedCalibration:
    """The verdict in short.

    Parameters
    ----------
    grade : str
        Of the three, or that the data were refused.
    first : tuple of str
        Names of the suspect and of its components, or those that a refusal names.
    group : tuple of str
        These and the candidates that the data cannot tell from it.
    nees : float
        (error)ᵀ covariance⁻¹ (error) over the number of coefficients; NaN where refused.
    words : str
        The verdict's first line, or the refusal.
    std : mapping of str to float
        Standard uncertainty of each coefficient, SI.
    chi : float
        Norm of the whitened residual.
    limits : tuple of str
        The statements of the verdict that say what the data cannot tell.
    unseen : mapping of str to float
        Coefficients of which they say a size that shifts another by 5 u, and that size, SI.
    errors : mapping of str to float
        Error of each coefficient over its standard uncertainty.
    p_values : mapping of str to float
        Of "χ²" of the estimate and of each group of its residuals, by the group's name; of those
        that have degrees of freedom.
    additions : tuple of Addition
        What `also = "auto"` added.
    """

    grade: Grade
    first: tuple[str, ...]
    group: tuple[str, ...]
    nees: float
    words: str
    std: Mapping[str, float] = field(default_factory=dict[str, float])
    chi: float = math.nan
    limits: tuple[str, ...] = ()
    unseen: Mapping[str, float] = field(default_factory=dict[str, float])
    errors: Mapping[str, float] = field(default_factory=dict[str, float])
    p_values: Mapping[str, float] = field(default_factory=dict[str, float])
    additions: tuple[Addition, ...] = ()

    def limits_name(self, what: str) -> bool:
        """Return whether a limitation has a word, by itself or behind an axis: "a.k2"."""
        return any(re.search(rf"(?<!\w){re.escape(what)}(?!\w)", line) for line in self.limits)


def calibrate_files(
    files: Files, truth: dict[str, float], also: str | None = None
) -> GradedCalibration:
    """Return what inercal makes of a run's files; `truth` are coefficients by name, SI."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            raw = content.encode() if isinstance(content, str) else content
            (Path(folder) / name).write_bytes(raw)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                outcome = calibrate(Path(folder) / "run.toml", also=also)
        except InercalError as error:
            words = str(error).replace(folder, "")
            # A refusal may name the keys that are wrong: "[bench] latitude".
            named = tuple(name.rpartition("] ")[2] for name in error.names)
            return GradedCalibration("refused", named, named, math.nan, words)
    require_short(outcome.verdict)
    first, group = suspect_names(outcome)
    found = outcome.calibration
    std = dict(zip(found.sensor.coefficients, found.std.tolist(), strict=True))
    chi = float(np.sqrt(np.sum(outcome.estimate.chi2)))
    nees, verdict = _nees(outcome, truth), outcome.verdict
    sizes = {one.component: one.size for one in undetectable_causes(outcome.estimate, found.sensor)}
    limits = tuple(
        line
        for heading, lines in verdict.explanation
        for line in lines
        if heading == UNDETECTABLE or any(word in line for word in _LIMIT)
    )
    errors = {
        name: (value - truth.get(name, 0.0)) / std[name]
        for name, value in zip(std, found.values.tolist(), strict=True)
    }
    said = verdict.lines[0]
    return GradedCalibration(
        verdict.grade,
        first,
        group,
        nees,
        said,
        std,
        chi,
        limits,
        sizes,
        errors,
        _p_values(outcome),
        outcome.additions,
    )


def suspect_names(outcome: Outcome) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the suspect and its components, and of those it cannot be told from.

    Where no score test names one, a test within sections that rejects the model names its cause in
    its own name, which the verdict prints as its reason: the first is that of the smallest p-value.
    """
    suspect = outcome.verdict.suspect
    if suspect is None:
        rejected = sorted(
            (test for test in outcome.verdict.tests if test.rejects), key=lambda test: test.p_value
        )
        named = [names for test in rejected if (names := _section_causes(test.name))]
        return (named[0], tuple(sum(named, ()))) if named else ((), ())
    members = {score.name: score.components for score in outcome.estimate.score_tests.scores}
    alike = [part for name in suspect.indistinguishable for part in (name, *members.get(name, ()))]
    first = (suspect.name, *suspect.components)
    return first, (*first, *alike)


def _section_causes(test: str) -> tuple[str, ...]:
    """Return the causes that the name of a test within sections says."""
    if change := _CHANGE.fullmatch(test):
        section, channel = change.groups()
        return (section, f"{channel}[{section}]")
    if drift := _DRIFT.fullmatch(test):
        channel = drift.group(1)
        kind = {"a": "accelerometers", "g": "gyros"}[channel[0]]
        return (f"drift of {kind}", f"drift of {channel}")
    return ()


def _p_values(outcome: Outcome) -> dict[str, float]:
    estimate = outcome.estimate
    found = {TOTAL: float(estimate.p_value)} if estimate.dof > 0 else {}
    return found | {one.name: one.p_value for one in estimate.groups if one.dof > 0}


def _nees(outcome: Outcome, truth: dict[str, float]) -> float:
    calibration = outcome.calibration
    names = calibration.sensor.coefficients
    error = calibration.values - np.array([truth.get(name, 0.0) for name in names])
    weighed = np.linalg.solve(calibration.covariance, error)
    return float(error @ weighed) / len(names)
