"""A verdict has at most six short lines, whatever was found; its explanation has all of it."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from tests.calibration.short_lines import KEY, require_short, require_toml

from inercal.basics.keys import CoefficientName
from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Advice, Change
from inercal.calibration import explanation
from inercal.calibration.best_cause import PlainAdvisor, SuspectedCause, changes_text
from inercal.calibration.explanation import (
    CHECKS,
    Addition,
    ExplanationSection,
    customer_sections,
    doubtful_additions,
    first_fit,
    fit,
    fit_list,
    without_operator_words,
)
from inercal.calibration.grade import assess, grade_estimate
from inercal.calibration.suspect_text import cause_line
from inercal.calibration.verdict import _first_line, verdict  # pyright: ignore[reportPrivateUsage]
from inercal.estimation import Candidate, Estimate, Problem, least_squares
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.residual_scatter import ScatterModel
from inercal.estimation.result import ResidualGroup
from inercal.estimation.scores import CandidateKind, ModelTest
from inercal.physics.sensors import G0, Sensor, axes_along, imu, triad
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.physics.sensors.coefficient_tables import TABLES
from inercal.recordings import Finding

SD, ROWS = 1e-4 * G0, 40
LONG = "a_very_long_name_of_a_position_that_somebody_generated_" * 5


def fitted(
    size: float, names: dict[str, str], sensor: Sensor, seed: int = 1, sd: float = SD
) -> Estimate:
    """Return a fit whose readings hold the first of several candidates, `names` with kinds."""
    rng = np.random.default_rng(seed)
    p = len(sensor.coefficients)
    design, extra = (rng.standard_normal((ROWS, k)) * G0 for k in (p, len(names)))
    y = SD * rng.standard_normal(ROWS) + size * extra[:, 0]

    def candidates(_: np.ndarray) -> list[Candidate]:
        # Every candidate has the direction of the first: no test distinguishes them.
        columns = extra[:, [0]] + 1e-3 * extra
        return [
            Candidate(name, kind, (name,), ("rad",), columns[:, [k]])  # pyright: ignore[reportArgumentType]
            for k, (name, kind) in enumerate(names.items())
        ]

    return least_squares(
        Problem(
            sensor.coefficients, np.zeros(p), lambda x: (y - x @ design.T, design),
            np.full(ROWS, sd), sensor.unit_scale, candidates=candidates,
        )
    )  # fmt: skip


SENSOR = triad("t", "f", "a").with_coefficients("bias", "scale")
CANDIDATES = {
    "coefficient": ("ax.k2", "ay.k2", "az.k3", "ax.kip", "ay.kip", "az.kip", "ax.koo"),
    "bench": ("radius", f"{LONG}[x]", "prior of ax.k0"),
    "row": (LONG, "r1", "r2"),
    "time": ("drift of ax", f"change within {LONG} (ax)"),
}
FINDINGS = [
    Finding(severity, f"{kind}{k}", f"{LONG}{k}: {'something is wrong ' * words}; check the {LONG}")
    for k, (severity, kind, words) in enumerate(
        product(("warning", "refused", "note"), ("gap", "unseen"), (1, 30))
    )
]


@pytest.mark.parametrize("kind", CANDIDATES)
@pytest.mark.parametrize("size", [0.0, 1e-2, 1e3, 1e9])
@pytest.mark.parametrize("findings", [(), FINDINGS], ids=["", "findings"])
def test_extreme_findings_sizes_and_names_leave_six_short_lines(
    kind: str, size: float, findings: list[Finding]
):
    names = dict.fromkeys(CANDIDATES[kind], kind)
    expected = {
        name: Parameter(name, "rad", 1e-6, "run", meaning=LONG * (name != "radius"))
        for name in CANDIDATES["bench"]
    }
    found = fitted(size, names, SENSOR)
    notes = tuple(f"{LONG} {k}" for k in range(40))
    said = verdict(replace(found, notes=notes), SENSOR, findings, expected, tuple(names))
    require_short(said)
    require_short(verdict(found, SENSOR, findings, expected, added=f"added: {LONG}, k2, k3"))
    for message in (*notes, *(one.message for one in findings if one.severity == "warning")):
        assert any(message in line for line in said.statements)


@pytest.mark.parametrize("most", range(40, 100))
def test_a_line_is_not_cut_within_brackets(most: int):
    text = "the check standard was out of control on 2026-08-01 (of ax.k0; T²): look for it; wait"
    short = explanation.fit(text, most)
    assert len(short) <= most
    assert short.count("(") == short.count(")")


def test_many_groups_with_huge_scatter_leave_six_short_lines():
    groups = tuple(
        ResidualGroup(f"{LONG}{k}", "m/s²", ("a",), np.zeros((1, 1)), np.ones((1, 1)), 1e12, 30,
                      ScatterModel(excess=310.0))
        for k in range(8)
    )  # fmt: skip
    said = verdict(
        replace(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), groups=groups), SENSOR, ()
    )
    require_short(said)
    assert said.grade == "unreliable"
    assert sum("an additional scatter of 310 m/s²" in line for line in said.statements) == 8


def test_huge_uncertainties_of_all_coefficients_are_one_short_line_and_many_explained():
    whole = imu().with_coefficients(*(line.name for table in TABLES.values() for line in table))
    p = len(whole.coefficients)
    found = Estimate.from_closed_form(whole.coefficients, np.zeros(p), np.eye(p) * 1e18, np.ones(p))
    said = verdict(replace(found, dof=3, chi2=np.array(2.0)), whole, ())
    require_short(said)
    (section,) = [one for one in said.explanation if one.heading == explanation.UNCERTAINTIES]
    assert len(section.lines) > 15


def test_a_cause_is_in_words_with_its_size_what_it_explains_and_what_to_paste():
    found = fitted(3e-4, {"ax.k2": "coefficient"}, SENSOR)
    said = verdict(found, SENSOR, (), possible=("ax.k2",))
    assert said.suspect is not None
    (line,) = [one for one in said.lines if one.startswith("Most likely cause: ")]
    assert "second-order nonlinearity of the x accelerometer (ax.k2), " in line
    assert 'Next: set in the run file: [method] also = ["ax.k2"]' in said.lines
    before, after = found.score_tests.chi2, said.suspect.remaining_chi2
    (drop,) = [one for one in said.statements if one.startswith("χ² would drop from ")]
    first, second = (
        float(text.replace(" ", ""))
        for text in re.fullmatch(r"χ² would drop from ([\d. ]+) to ([\d. ]+)\.", drop).groups()  # pyright: ignore[reportOptionalMemberAccess]
    )
    assert (first, second) == (pytest.approx(before, rel=0.01), pytest.approx(after, rel=0.01))


@pytest.mark.parametrize(
    "changes",
    [
        (Change("method.prior", "gx.scale", "0 ± 4000 ppm"),),
        (Change("method", "also", ("k2", "ax.kip")), Change("sensor", "form", "tilted")),
        (Change("bench", "harmonics", ["2 ″", "1 ″"]), Change("bench", "readback", False)),
    ],
)
def test_keys_to_paste_are_toml(changes: tuple[Change, ...]):
    require_toml(f"set in the run file: {changes_text(changes)}", changes)


@pytest.mark.parametrize(("share", "is_cause"), [(1e-8, True), (0.2, False), (None, False)])
def test_a_partial_cause_is_fitted_before_it_is_called_partial(share: float | None, is_cause: bool):
    # A large effect that is not linear: the single step of the score test leaves too much.
    found = fitted(1.0, {"ax.k2": "coefficient"}, SENSOR)
    tests = found.score_tests
    (score,) = tests.scores
    scores = (replace(score, chi2=0.6 * tests.chi2),)
    found = replace(found, scoring=LazyValue(lambda: replace(tests, scores=scores)))
    plain, change = PlainAdvisor((), "row"), Change("method", "also", ("ax.k2",))

    class Tried(PlainAdvisor):
        def on_cause(self, cause: SuspectedCause) -> Advice:
            if share is None:  # the fit is refused, or explains less than the step predicts
                return plain.on_cause(cause)
            return Advice(cause.name, (change,), chi2=share * tests.chi2)

    said = verdict(found, SENSOR, (), possible=("ax.k2",), advisor=Tried(("ax.k2",), "row"))
    require_short(said)
    words = "second-order nonlinearity of the x accelerometer (ax.k2)"
    if is_cause:
        assert f"Most likely cause: {words}." in said.lines
        assert said.suspect is not None
        assert said.suspect.remaining_chi2 == 1e-8 * tests.chi2
    else:
        assert any(line.startswith(f"Partial cause: {words}") for line in said.lines)
    advised = 'Next: set in the run file: [method] also = ["ax.k2"]' in said.lines
    assert advised == (share is not None)


def test_a_cause_found_in_the_data_precedes_a_scale_factor_far_from_nominal():
    far = fitted(0.0, {"r1": "row"}, SENSOR)
    far = replace(far, value=np.where(np.array(far.names) == "ax.k1", 72.0, far.value))
    lost = Finding("warning", "slip", "rows are lost", cause="at least 53 samples lost at 51 s")
    said = verdict(far, SENSOR, (lost,))
    assert "73 times nominal" in said.lines[0]
    assert "Most likely cause: at least 53 samples lost at 51 s." in said.lines


def test_rows_that_cannot_be_told_apart_are_named_together():
    rows = {"r1": "row", "r2": "row"}
    said = verdict(fitted(3e-4, rows, SENSOR), SENSOR, ())
    assert "Most likely cause: wrong readings in r2 or r1." in said.lines
    assert any(one.startswith("Next: ") and "r2 or r1" in one for one in said.lines)
    many = {f"r{k}": "row" for k in range(9)}
    said = verdict(fitted(3e-4, many, SENSOR), SENSOR, ())
    assert any("or one of 8 other rows" in one for one in said.lines)


@pytest.mark.parametrize(("size", "named"), [(1.0, True), (0.0, False)])
def test_a_scale_factor_far_from_nominal_names_the_row_that_causes_it(size: float, named: bool):
    found = fitted(size, {"r1": "row"}, SENSOR)
    value = found.value.copy()
    value[found.names.index("ax.k1")] = 4.8
    said = verdict(replace(found, value=value), SENSOR, ())
    (cause,) = [one for one in said.lines if one.startswith("Most likely cause: ")]
    (step,) = [one for one in said.lines if one.startswith("Next: ")]
    assert ("r1" in cause, "r1" in step) == (named, named)


def test_every_effect_that_is_not_detectable_is_counted_once_and_listed():
    unseen = [Finding("note", "unseen", f"effect {k}: 3 µg; repeat it", "ax") for k in range(3)]
    said = verdict(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), SENSOR, unseen)
    (section,) = [one for one in said.explanation if one.heading == explanation.UNDETECTABLE]
    assert [one.message for one in unseen] == list(section.lines[-3:])
    assert said.lines[-1].startswith(f"{len(section.lines)} effects are not detectable")


@pytest.mark.parametrize("table", TABLES)
def test_every_coefficient_has_words_with_its_key_and_its_axis(table: str):
    sensor = Sensor("nine axes", (*imu().axes, *axes_along("xyz", "m", "m")))
    axis = {"f": "ax", "w": "gx", "m": "mx"}[table]
    kind = {"f": "accelerometer", "w": "gyro", "m": "magnetometer"}[table]
    for line in TABLES[table]:
        words = coefficient_words(sensor, f"{axis}.{line.name}")
        assert words.endswith(f" ({axis}.{line.name})")
        assert f"of the x {kind}" in words
        assert line.meaning.split()[0].rstrip(",") in words
    grouped = coefficient_words(sensor, "g", ("gx.g_i", "gy.g_p"))
    assert grouped == "sensitivity of the gyros to acceleration (g)"


def test_a_customer_reads_neither_keys_nor_options_nor_next_steps():
    found = fitted(3e-4, {"ax.k2": "coefficient"}, SENSOR)
    findings = [Finding("warning", "gap", "the data have gaps; state them in [data] gaps")]
    changed = [Finding("warning", "g", "odd", changes=(Change("method", "also", ("ax.k2",)),))]
    said = verdict(found, SENSOR, [*findings, *changed], possible=("ax.k2",))
    assert any(KEY.search(line) for line in said.statements)
    sections = customer_sections(said.explanation)
    kept = [line for section in sections for line in section.lines]
    assert "the data have gaps" in kept
    assert not [line for line in kept if KEY.search(line)]
    assert explanation.NEXT_STEPS not in [one.heading for one in sections]


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("g is 9.8 m/s²; check [bench] gravity", "g is 9.8 m/s²"),
        ("State it in the run file.", ""),
        ("It drifts. Use --explain to see why. U includes it.", "It drifts. U includes it."),
        ("the interval is [0, 1]", "the interval is [0, 1]"),
    ],
)
def test_clauses_of_an_operator_are_left_out(text: str, kept: str):
    assert without_operator_words(text) == kept


def test_lines_are_shortened_at_clauses_words_or_at_last_anywhere():
    assert fit("short") == "short"
    assert fit("one thing is said here; another is said there", 30) == "one thing is said here"
    assert fit("many words that go on and on", 12) == "many words…"
    assert len(fit("x" * 500)) == 100
    assert fit_list("U: ", ["a", "b"]) == "U: a, b."
    assert fit_list("U: ", ["a" * 60, "b" * 60]) == f"U: {'a' * 60}, 1 more not shown."
    assert first_fit("x" * 101, "y") == "y"


def test_a_file_without_lines_and_headings_has_its_notes():
    from inercal.calibration.verdict_object import VerdictRecord, recorded_verdict

    old = VerdictRecord.model_validate(
        {
            "grade": "reservations",
            "reasons": ["a check warns: gap"],
            "tests": [],
            "suspect": None,
        }
    )
    read = recorded_verdict(old, ("one", "two"))
    assert read.lines == ("Usable with reservations: a check warns: gap",)
    assert read.explanation == (ExplanationSection(explanation.NOTES, ("one", "two")),)
    assert read.warned == ("gap",)


WHOLE = imu().with_coefficients(*(line.name for table in TABLES.values() for line in table))


@pytest.mark.parametrize("kind", ["coefficient", "bench", "time", "row"])
def test_a_shift_of_any_coefficient_is_stated_with_its_size(kind: CandidateKind):
    plain = fitted(3e-4, {"r1": kind}, SENSOR)
    assessment = assess(plain, len(SENSOR.coefficients), ())
    assert assessment.best is not None
    for name in WHOLE.coefficients:
        found = replace(
            assessment,
            best=replace(
                assessment.best,
                shifted_coefficient=name,
                shift=1234.0,
                kind=kind,
                is_sufficient=False,
            ),
        )
        graded = grade_estimate(plain, WHOLE, found, (), ())
        (reason,) = [one for one in graded.reasons if " shifts " in one]
        line = _first_line("Not to be relied on", reason)
        assert line.endswith(" by 1200 U."), line
        assert name in line or coefficient_words(WHOLE, name).partition(" (")[0] in line


def test_a_cause_is_named_and_its_size_is_stated_if_its_words_are_long():
    plain = fitted(3e-4, {"ax.k2": "coefficient"}, SENSOR)
    found = assess(plain, len(SENSOR.coefficients), ())
    assert found.suspect is not None
    for name in WHOLE.coefficients:
        same = tuple(one for one in WHOLE.coefficients if one[2:] == name[2:])
        for word, components in ((name, (name,)), (CoefficientName(name).term, same)):
            one = replace(
                found.suspect,
                name=word,
                components=components,
                units=("1",) * len(components),
                sizes=(1.0,) * len(components),
                sds=(1e-3,) * len(components),
            )
            line = cause_line(replace(found, best=one), WHOLE, {})
            assert word in line, line
            assert not line.endswith("…"), line
            assert line.count("(") == line.count(")"), line


@pytest.mark.parametrize(
    ("text", "left"),
    [
        (
            "gx is at the end of its range in samples 5812 to 5858 (55.727 s to 56.168 s) here",
            "gx is at the end of its range in samples 5812 to 5858",
        ),
        (
            "1319 gaps, 6.8 s lost in all, 0.01 s in the longest, after the sample 46282 (1.3 s)",
            "1319 gaps, 6.8 s lost in all, 0.01 s in the longest",
        ),
        (
            "the temperature rises with time (correlation 0.999, a lot), so a drift cannot be seen",
            "the temperature rises with time (correlation 0.999, a lot)",
        ),
        (
            "everything in these means is right, but what follows takes that back in many words",
            "everything in these means is right, but what follows takes that back in…",
        ),
    ],
)
def test_a_shortened_line_ends_where_a_statement_ends(text: str, left: str):
    assert fit(text, 75) == left


def test_many_causes_as_good_as_an_added_group_are_counted_before_they_are_listed():
    causes = ("k2_dT", "k1_prime", "ax.k1_prime", "kio")
    one = Addition("k2", ("ax.k2",), 900.0, 20, 18.0, 19, causes)
    (finding,) = doubtful_additions((one,))
    assert all(cause in finding.message for cause in causes)
    said = verdict(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), SENSOR, (finding,))
    assert "4 other causes" in said.lines[0]
    assert not said.lines[0].endswith("…")


def test_uncertainties_of_one_group_in_several_units_name_their_coefficients():
    sensor = triad("t", "f", "a").with_coefficients("bias", "k2", "k3")
    said = verdict(fitted(0.0, {"ax.k1": "coefficient"}, sensor), sensor, ())
    (section,) = [one for one in said.explanation if one.heading == explanation.UNCERTAINTIES]
    assert [line.partition(":")[0] for line in section.lines] == [
        "accelerometer bias",
        "accelerometer nonlinearity (k2)",
        "accelerometer nonlinearity (k3)",
    ]


@pytest.mark.parametrize("added", ["", "Added to the model: something."])
@pytest.mark.parametrize("rows", [("ax.k2",), ("ax.k2", "ay.k2", "az.k3")])
def test_warnings_stay_in_the_lines_beside_a_cause_of_the_residuals(
    rows: tuple[str, ...], added: str
):
    found = fitted(3e-4, dict.fromkeys(rows, "coefficient"), SENSOR)
    warnings = [Finding("warning", "gravity", "g is odd"), Finding("warning", "stuck", "az stays")]
    said = verdict(found, SENSOR, warnings, possible=rows, added=added)
    require_short(said)
    assert any(line.startswith("Most likely cause: ") for line in said.lines)
    assert any(line.startswith("Next: ") for line in said.lines)
    for one in warnings:
        assert sum(one.message in line for line in said.lines) == 1
    # Without a cause, the first line states the first warning, and a line the other.
    said = verdict(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), SENSOR, warnings)
    assert warnings[0].message in said.lines[0]
    assert sum(warnings[1].message in line for line in said.lines[1:]) == 1


def test_lost_samples_are_told_in_the_explanation_and_do_not_lower_the_grade():
    told = [Finding("note", "gap", "lost"), Finding("note", "jitter", "steps vary")]
    said = verdict(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), SENSOR, told)
    without = verdict(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), SENSOR, ())
    listed = {one.heading: one.lines for one in said.explanation}
    assert listed[CHECKS] == ("lost",)
    assert (said.grade, said.lines) == (without.grade, without.lines)


@pytest.mark.parametrize(
    "name",
    [
        "residuals: innovations of the gyros' filter, mean of each step",
        "residuals: innovations of the accelerometers' filter, mean of each step",
        "residuals: accelerometers",
        f"residuals: {LONG}",
        "mean innovations of the accelerometers in each step",
        "correlation of the accelerometers' innovations between steps",
        "noise slower than the sections",
        f"burst within {LONG} (gy)",
        f"change within {LONG} (ax)",
    ],
)
def test_a_shortened_reason_keeps_its_verb(name: str):
    tests = (ModelTest(name, 60.0, 20),)
    found = replace(fitted(0.0, {"ax.k2": "coefficient"}, SENSOR), tests=tests)
    said = verdict(found, SENSOR, ())
    assert said.grade == "reservations"
    assert re.search(r" (rejects|are|change)\b", said.lines[0])
