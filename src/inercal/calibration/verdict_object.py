"""Convert the verdict to and from JSON, with sizes in SI units."""

from math import nan
from typing import Any, cast

from pydantic import Field

from inercal.basics.documents import Count, Measured, Positive, Record, attributes, record_object
from inercal.basics.errors import InputError
from inercal.basics.run_file_advice import Advice, Change
from inercal.calibration.best_cause import SuspectedCause
from inercal.calibration.detectability import UndetectableCause
from inercal.calibration.explanation import NOTES, UNCERTAINTIES, Addition, ExplanationSection, fit
from inercal.calibration.grade import GRADE_WORDS, HypothesisTest, NoiseFactor, Verdict
from inercal.estimation.scores import CandidateKind
from inercal.recordings import RoundedChannel

# How reasons and notes begin in files that state neither warnings nor an explanation.
_WARNS, _LARGEST = "a check warns: ", "expanded uncertainties (k = 2) are at most: "


class _Test(Record):
    name: str
    chi2: Measured
    dof: Count
    p_value: Measured
    p_among_all: Measured


class _Component(Record):
    name: str
    value: Measured
    std: Measured
    unit: str


class _Shift(Record):
    coefficient: str
    in_U: Measured


class _Remaining(Record):
    chi2: Measured
    dof: Count
    p_value: Measured


class _Change(Record):
    section: str
    key: str
    value: str | float | int | bool | list[str]


class _Advice(Record):
    reason: str
    changes: list[_Change]
    action: str
    chi2: float | None


class _Cause(Record):
    name: str
    kind: str
    components: list[_Component]
    chi2: Measured
    dof: Count
    p_value: Measured
    remaining: _Remaining | None = None
    largest_shift: _Shift
    not_told_from: list[str]


class _NoiseFactor(Record):
    what: str
    channel: str | None
    factor: Measured


class _RoundedChannel(Record):
    channel: str
    step: Positive
    noise: float
    dead_band: bool
    std: Positive


class _Addition(Record):
    group: str
    coefficients: list[str]
    chi2_before: Positive
    dof_before: Count
    chi2_after: Positive
    dof_after: Count
    indistinguishable: list[str]


class _UndetectableCause(Record):
    name: str
    component: str
    size: Measured


class _Section(Record):
    heading: str
    lines: list[str]


class VerdictRecord(Record):
    """The verdict in a calibration file; earlier versions do not write fields with a default."""

    grade: str
    word: str = ""
    reasons: list[str]
    lines: list[str] = Field(default_factory=list[str])
    explanation: list[_Section] = Field(default_factory=list[_Section])
    tests: list[_Test]
    suspect: _Cause | None
    best_cause: _Cause | None = None
    advice: list[_Advice] = Field(default_factory=list[_Advice])
    scatter: Measured = nan
    noise: list[_NoiseFactor] = Field(default_factory=list[_NoiseFactor])
    rounding: list[_RoundedChannel] | None = None
    additions: list[_Addition] = Field(default_factory=list[_Addition])
    warned: list[str] | None = None
    undetectable: list[_UndetectableCause] | None = None


def verdict_object(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as a JSON object, with sizes in SI units."""
    content: dict[str, Any] = {
        **attributes(verdict, "grade word reasons lines"),
        "explanation": [one._asdict() for one in verdict.explanation],
        "tests": [
            {
                "name": test.name,
                "chi2": test.statistic,
                "dof": test.dof,
                "p_value": test.p_value,
                "p_among_all": test.adjusted,
            }
            for test in verdict.tests
        ],
        "suspect": _cause_object(verdict.suspect),
        "best_cause": _cause_object(verdict.best),
        **attributes(verdict, "advice scatter noise warned"),
    }
    if verdict.rounding:
        content["rounding"] = verdict.rounding
    if verdict.additions:
        content["additions"] = verdict.additions
    if verdict.undetectable is not None:
        content["undetectable"] = verdict.undetectable
    return record_object(content)


def _cause_object(one: SuspectedCause | None) -> dict[str, Any] | None:
    return None if one is None else {
        "name": one.name,
        "kind": one.kind,
        "components": [
            {"name": name, "value": size, "std": sd, "unit": unit}
            for name, size, sd, unit in zip(
                one.components, one.sizes, one.sds, one.units, strict=True
            )
        ],
        "chi2": one.chi2,
        "dof": one.dof,
        "p_value": one.adjusted,
        "remaining": {
            "chi2": one.remaining_chi2,
            "dof": one.remaining_dof,
            "p_value": one.remaining_p_value,
        },
        "largest_shift": {"coefficient": one.shifted_coefficient, "in_U": one.shift},
        "not_told_from": one.indistinguishable,
    }  # fmt: skip


def recorded_verdict(record: VerdictRecord, notes: tuple[str, ...]) -> Verdict:
    """Return the verdict from a calibration file; without headings, notes are its explanation."""
    if record.grade not in GRADE_WORDS:
        raise InputError(f"verdict {record.grade!r} is not one of {', '.join(GRADE_WORDS)}")
    suspect = _recorded_cause(record.suspect)
    # Files from earlier versions do not state a best cause.
    states_best = "best_cause" in record.model_fields_set
    word = GRADE_WORDS[record.grade].capitalize()
    lines = record.lines or [fit(": ".join((word, *record.reasons[:1])))]
    sections = [ExplanationSection(**_frozen(one)) for one in record.explanation]
    if not sections:
        largest = tuple(one for one in notes if one.startswith(_LARGEST))
        others = tuple(one for one in notes if one not in largest)
        sections = [ExplanationSection(UNCERTAINTIES, largest), ExplanationSection(NOTES, others)]
    warned = record.warned
    if warned is None:
        warned = [one.removeprefix(_WARNS) for one in record.reasons if one.startswith(_WARNS)]
    return Verdict(
        record.grade,
        tuple(record.reasons),
        tuple(lines),
        tuple(one for one in sections if one.lines),
        tuple(
            HypothesisTest(t.name, t.chi2, t.dof, t.p_value, t.p_among_all) for t in record.tests
        ),
        suspect,
        _recorded_cause(record.best_cause) if states_best else suspect,
        tuple(
            Advice(a.reason, tuple(Change(**vars(c)) for c in a.changes), a.action, a.chi2)
            for a in record.advice
        ),
        record.scatter,
        tuple(NoiseFactor(**vars(one)) for one in record.noise),
        tuple(RoundedChannel(**vars(one)) for one in record.rounding or ()),
        tuple(Addition(**_frozen(one)) for one in record.additions),
        tuple(warned),
        None
        if record.undetectable is None
        else tuple(UndetectableCause(**vars(one)) for one in record.undetectable),
    )


def _frozen(one: Record) -> dict[str, Any]:
    """Return the fields of a record, with tuples instead of lists."""
    return {
        name: tuple(cast("list[Any]", of)) if isinstance(of, list) else of
        for name, of in vars(one).items()
    }


def _recorded_cause(one: _Cause | None) -> SuspectedCause | None:
    if one is None:
        return None
    left = one.remaining or _Remaining.model_construct(chi2=nan, dof=0, p_value=1.0)
    return SuspectedCause(
        name=one.name,
        kind=cast("CandidateKind", one.kind),
        components=tuple(c.name for c in one.components),
        units=tuple(c.unit for c in one.components),
        sizes=tuple(c.value for c in one.components),
        sds=tuple(c.std for c in one.components),
        chi2=one.chi2,
        dof=one.dof,
        adjusted=one.p_value,
        remaining_chi2=left.chi2,
        remaining_dof=left.dof,
        shift=one.largest_shift.in_U,
        shifted_coefficient=one.largest_shift.coefficient,
        indistinguishable=tuple(one.not_told_from),
        remaining_p_value=left.p_value,
    )
