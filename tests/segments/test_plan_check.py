"""A simulated session passes its check against the plan; the usual mistakes with it do not."""

from math import pi

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, run_file

from inercal.benches.hand.reading import nominal_plan
from inercal.physics.plan import Hold, describe_direction
from inercal.pipeline import simulate
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.segments import (
    average_sections,
    check_against_plan,
    check_turn_ends,
    marks_from_labels,
)
from inercal.runfile import Run, read

DEGREE = pi / 180


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return read(run_file(tmp_path_factory.mktemp("run"), FERRARIS))


@pytest.fixture(scope="module")
def made(run: Run) -> Recording:
    return simulate(run, seed=2)


@pytest.fixture(scope="module")
def observations(run: Run, made: Recording) -> Observations:
    return average_sections(made, run.sensor, marks_from_labels(made), nominal_plan(run))


def changed(
    observations: Observations, columns: list[int], factors: list[float], rows: dict[str, str]
) -> Observations:
    """Return the observations with columns and marks exchanged and units mistaken."""
    source = [observations.labels.index(rows.get(name, name)) for name in observations.labels]
    return Observations(
        observations.labels,
        observations.mean[source][:, columns] * factors,
        observations.covariance[source],
        observations.duration[source],
        observations.samples[source],
        observations.time[source],
        observations.channels,
    )


def check(run: Run, seen: Observations) -> tuple[Finding, ...]:
    return check_against_plan(seen, run.sensor, nominal_plan(run), run.bench.gravity.value)


def test_a_session_as_planned_has_no_finding(run: Run, observations: Observations):
    assert check(run, observations) == ()


AS_THEY_ARE, ONES = [0, 1, 2, 3, 4, 5], [1.0] * 6


@pytest.mark.parametrize(
    ("columns", "factors", "rows", "section", "hint"),
    [
        (AS_THEY_ARE, ONES, {"x_a": "y_a"}, "x_a", "wrong section"),
        (AS_THEY_ARE, ONES, {"x_p": "x_a", "x_a": "x_p"}, "x_p", "wrong section"),
        (AS_THEY_ARE, ONES, {"x_rot": "z_a"}, "x_rot", "wrong section"),
        ([1, 0, 2, 3, 4, 5], ONES, {}, "x_p", "swapped"),
        ([0, 1, 2, 5, 4, 3], ONES, {}, "x_rot", "swapped"),
        (AS_THEY_ARE, [1, -1, 1, 1, 1, 1], {}, "y_p", "reversed"),
        (AS_THEY_ARE, [1, 1, 1, *[1 / DEGREE] * 3], {}, "x_rot", "°/s taken for rad/s"),
        (AS_THEY_ARE, [1, 1, 1, *[DEGREE] * 3], {}, "x_rot", "rad/s taken for °/s"),
        (AS_THEY_ARE, [1, 1, 1, *[16.4] * 3], {}, "x_rot", "16.6 times the turn: check unit"),
        (AS_THEY_ARE, [1, 1, 1, *[0.1] * 3], {}, "x_rot", "wrong section"),
    ],
)
def test_means_that_contradict_the_plan_are_refused_by_section(
    run: Run,
    observations: Observations,
    columns: list[int],
    factors: list[float],
    rows: dict[str, str],
    section: str,
    hint: str,
):
    with refused(names=[section]) as refusal:
        check(run, changed(observations, columns, factors, rows))
    message = str(refusal.value)
    step = next(step for step in nominal_plan(run) if step.label == section)
    assert describe_direction(step.up if isinstance(step, Hold) else step.axis) in message
    assert hint in message


@pytest.mark.parametrize("columns", [[0, 1, 2, 5, 4, 3], [0, 1, 2, 4, 3, 5], [1, 0, 2, 3, 4, 5]])
def test_a_turn_that_gravity_does_not_follow_is_refused_where_turns_were_found(
    run: Run, observations: Observations, columns: list[int]
):
    seen = changed(observations, columns, ONES, {})
    # The readings name detected sections: the row of a section is what its columns read.
    renamed = {
        f"{'xyz'[k]}_{sign}": f"{'xyz'[columns[k]]}_{sign}" for k in range(3) for sign in "pa"
    }
    renamed |= {f"{'xyz'[k]}_rot": f"{'xyz'[columns[3 + k] - 3]}_rot" for k in range(3)}
    seen = changed(seen, AS_THEY_ARE, ONES, renamed)
    with refused() as refusal:
        check(run, seen)
    (name,) = refusal.value.names
    assert name.endswith("_rot")


@pytest.mark.parametrize("label", ["x_rot", "y_rot", "z_rot"])
def test_a_turn_in_the_opposite_direction_is_a_warning_that_names_it(
    run: Run, observations: Observations, label: str
):
    factors = np.ones(observations.mean.shape)
    factors[observations.labels.index(label), 3:] = -1
    backwards = Observations(
        observations.labels,
        observations.mean * factors,
        observations.covariance,
        observations.duration,
        observations.samples,
        observations.time,
        observations.channels,
    )
    (finding,) = check(run, backwards)
    assert (finding.severity, finding.what) == ("warning", "direction")
    assert label in finding.message
    assert "-360 °" in finding.message


def turn_ends(run: Run, made: Recording, label: str, start: int, stop: int) -> list[str]:
    """Return the warnings when a mark's start and stop are moved by so many samples."""
    marks = [
        Mark(m.label, m.start + start, m.stop + stop) if m.label == label else m
        for m in marks_from_labels(made)
    ]
    findings = check_turn_ends(made, run.sensor, marks, nominal_plan(run))
    assert {finding.severity for finding in findings} <= {"warning"}
    return [finding.message for finding in findings]


def test_turns_marked_from_rest_to_rest_have_no_finding(run: Run, made: Recording):
    assert turn_ends(run, made, "x_rot", 0, 0) == []


def test_a_mark_that_cuts_a_turn_short_is_a_warning(run: Run, made: Recording):
    second = 50  # samples
    (late,) = turn_ends(run, made, "y_rot", 2 * second, 0)
    assert late.startswith("section y_rot begins at sample ")
    (early,) = turn_ends(run, made, "y_rot", 0, -2 * second)
    assert early.startswith("section y_rot ends at sample ")
    assert len(turn_ends(run, made, "y_rot", second, -second)) == 2
