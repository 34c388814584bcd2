"""The next steps of a verdict: what to check, repeat or state, as sentences and as advice."""

import re
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from inercal.basics.keys import ErrorName
from inercal.basics.run_file_advice import Advice
from inercal.calibration import explanation
from inercal.calibration.best_cause import (
    CHANGE_PREFIX,
    STATED_WITH_A_SIGN,
    Advisor,
    changes_text,
    is_estimable,
)
from inercal.calibration.detectability import UndetectableCause
from inercal.calibration.explanation import fit, sentence
from inercal.calibration.grade import Assessment
from inercal.estimation.scores import (
    BURST_AT,
    COMMON_DRIFT,
    HYSTERESIS,
    SIGNIFICANCE_LEVEL,
    SLOW_NOISE,
    STEP,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding

OPPOSITE_SIGN = "opposite sign"
"""`Finding.what` for a quantity that the sensors show with the opposite sign."""
COARSE_READINGS = "coarse readings"
"""`Finding.what` for rounding errors that a method does not include."""
WRONG_SOAK = "soak"
"""`Finding.what` for a soak that alone disagrees with the model."""
SOAK_OR_ORDER = "soak or order"
"""`Finding.what` for terms that no soak would test, which a wrong temperature would also cause."""
CAUSES = {
    OPPOSITE_SIGN: "the accelerometers or the gyros have the wrong sign",
    COARSE_READINGS: "rounding, whose errors this method does not include",
    SOAK_OR_ORDER: "a wrong temperature of one soak, a change of the sensor, or a higher order",
    WRONG_SOAK: "the temperature of this soak is wrong, or the sensor changed in it",
}  # by `Finding.what`: no other cause can be tested while one of these is present
# How the last clause of a finding begins if it says what to do.
_REMEDY = re.compile(
    "(?:check|compare|correct|find|give|let|look|measure|name|record|remove|repeat|set|state|take"
    "|use|wait) "
)
_REMEDIES_BY_KIND = {"gap": "record again, or check the cable and port of the sensor"}
_AGAIN = "measure it again, or "


class NextStep(NamedTuple):
    """A next step: a sentence and, if any, the advice as data.

    The lines of a verdict contain only steps that are `needed`, because these can improve the
    grade.
    """

    text: str
    advice: Advice | None = None
    needed: bool = True

    @property
    def has_keys(self) -> bool:
        """Whether the step contains keys to paste into a run file."""
        return self.advice is not None and bool(self.advice.changes)


def steps_on_cause(
    assessment: Assessment,
    advisor: Advisor,
    far: Sequence[str],
    row_word: str,
    main: str,
    possible: Collection[str],
) -> Iterator[NextStep]:
    """Yield next steps about the cause of large residuals."""
    if far:
        look = f"Look at the readings of “{main}”; check" if main else "Check"
        yield NextStep(
            f"{look} the connection of this axis, and its sign, unit and scale in the run file."
        )
    row, suspect, best = assessment.row, assessment.suspect, assessment.best
    if suspect is None and best is not None:
        explains = best.chi2 > best.remaining_chi2
        magnetic = best.name.startswith(STEP) and explains
        if magnetic or best.name.startswith(HYSTERESIS):
            suspect = best  # it hides all other causes
        elif explains and is_estimable(best, possible) and advisor.on_cause(best).changes:
            suspect = best
        elif explains and best.name in STATED_WITH_A_SIGN:
            suspect = best  # its sign may be wrong in the run file, whatever else is wrong
    rejecting = [one.name for one in assessment.rejecting_tests]
    slow = ()
    if any(name.startswith(COMMON_DRIFT) for name in rejecting):
        slow = (
            NextStep("Let the sensor warm up, keep its temperature constant, and record again."),
        )
    elif SLOW_NOISE in rejecting:
        slow = (NextStep("Wait longer after each move before you average, or record for longer."),)
    yield from slow if suspect is None else ()
    if suspect is not None:
        advice = advisor.on_cause(suspect)
        place = ErrorName(suspect.components[0]).place if len(suspect.components) == 1 else ""
        again = f"measure it again at {place}, or, for all places, " if place else _AGAIN
        again = again if suspect.kind == "bench" and not suspect.changes else ""
        if "latitude" in suspect.indistinguishable:
            again = "check the sign of the latitude, or "
        text = f"{again}{_changes_words(advice)}" if advice.changes else advice.action
        yield NextStep(f"{sentence(text)}{'' if advice.changes else '.'}", advice)
    elif row is not None and row.adjusted < SIGNIFICANCE_LEVEL:
        yield NextStep(f"Look at the readings of “{row.name}”, and repeat this {row_word}.")
    yield from slow if suspect is not None else ()
    for name in rejecting:
        if name.startswith(BURST_AT):
            yield NextStep("Check whether the labels are some rows early or late.")
        elif name.startswith((CHANGE_PREFIX, "burst ")):
            where = name.partition(" ")[2]
            yield NextStep(f"Check whether the sensor was touched {where}, and repeat it.")


def steps_on_undetectable(
    unseen: Sequence[UndetectableCause], sensor: Sensor, advisor: Advisor, possible: Collection[str]
) -> Iterator[NextStep]:
    """Yield a step that makes the method estimate undetectable coefficients, if it can."""
    free = [one.name for one in unseen if one.component in possible]
    if free and (advice := advisor.on_coefficients(free)):
        changes = _changes_words(advice)
        some = "Some" if ", " in advice.reason else "One"
        text = f"{some} of the effects that are not detectable can be estimated: {changes}"
        yield NextStep(text, advice, needed=False)


def steps_on_findings(
    findings: Sequence[Finding], advisor: Advisor, steps: Sequence[NextStep]
) -> Iterator[NextStep]:
    """Yield steps that resolve findings: changes that add coefficients, or other remedies."""
    given = {word for one in steps if one.advice for word in one.advice.coefficients}
    for finding in sorted(findings, key=lambda one: not (one.cause or one.what in CAUSES)):
        advice = Advice(finding.what, finding.changes)
        if set(advice.coefficients) - given and (tried := advisor.on_changes(advice)):
            yield NextStep(sentence(_changes_words(tried)), tried)
        elif finding.severity != "note" or finding.what in CAUSES:
            remedy = finding.message.rpartition("; ")[2]
            if not _REMEDY.match(remedy):
                remedy = _REMEDIES_BY_KIND.get(finding.what, "")
            if remedy:
                yield NextStep(f"{sentence(remedy)}.")


def _changes_words(advice: Advice) -> str:
    return f"set in the run file: {changes_text(advice.changes)}"


def next_line(steps: Sequence[NextStep], warnings: Sequence[str], *, only: bool) -> str:
    """Return a line with the first necessary step; keys to paste are never shortened.

    Without such a step, the first of the warnings is named, if `only` they reduce the grade.
    """
    if not (steps and steps[0].needed):
        if warnings and only:
            return fit(f"{explanation.NEXT}resolve the warning: {warnings[0]}")
        also = ", and read the warnings" if warnings else ""
        return f"{explanation.NEXT}check the stated noise and bench{also}."
    text = f"{explanation.NEXT}{steps[0].text[:1].lower()}{steps[0].text[1:]}"
    return text if steps[0].has_keys else fit(text)
