"""States of a rate table's recording: what is none is named, with the reason."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.segments import find_dwells
from inercal.recordings.segments.stationary_states import (
    find_stationary_states,
    omitted_state_findings,
)

RATE_HZ = 50.0


def session(*held: tuple[str, float, float]) -> Recording:
    """Return a recording of rates held: label, r/min, s; 4 s of spinning up lie between."""
    rates, labels = [np.zeros(0)], []
    last = 0.0
    for label, rpm, seconds in held:
        up = np.linspace(last, rpm, round(4 * RATE_HZ)) if rpm != last else np.zeros(0)
        rates += [up, np.full(round(seconds * RATE_HZ), rpm)]
        labels += [label] * (up.size + rates[-1].size)
        last = rpm
    rate = np.concatenate(rates) * pi / 30
    data = np.random.default_rng(0).standard_normal((rate.size, 3))
    time = np.arange(rate.size) / RATE_HZ
    names = np.array(labels)
    return Recording(time, data, ("ax", "ay", "az"), ("g",) * 3, names, readback={"arm_rate": rate})


def said(recording: Recording) -> list[str]:
    dwells, flawed = find_dwells(recording, "table")
    stands, also = find_stationary_states(recording)
    marks: list[Mark] = [*(dwell.mark for dwell in dwells), *stands]
    found = omitted_state_findings(recording, marks, flawed + also)
    assert all((one.severity, one.what) == ("warning", "states") for one in found)
    return [one.message for one in found]


FULL = (("XY", 0.0, 8.0), ("XY", 46.0, 12.0), ("XY", 86.0, 9.0), ("XY", 0.0, 3.0))


def test_nothing_is_said_of_a_session_whose_states_are_all_used():
    assert said(session(*FULL)) == []


def test_dwells_with_too_few_turns_are_named_with_what_they_have():
    brief = [("YX", 46.0, 3.0), ("ZY", 46.0, 3.2), ("ZY", 0.0, 2.0)]
    (words,) = said(session(*FULL, *brief))
    assert "YX at 46 rpm, ZY at 46 rpm (1.2 to 1.3 turns" in words


def test_a_rest_that_was_all_of_a_mounting_is_named():
    (words,) = said(session(*FULL, ("YX", 0.0, 4.0), ("XY", 0.0, 1.0)))
    assert "YX at rest (1.9 s" in words


def test_a_mounting_in_which_the_table_is_never_steady_is_named():
    made = session(*FULL, ("YX", 30.0, 0.0), ("YX", 0.0, 0.0), ("XY", 0.0, 1.0))
    (words,) = said(made)
    assert "YX (never steady" in words


def test_a_recording_that_ends_during_a_dwell_is_reported():
    first, last = said(session(*FULL[:2], ("XY", 86.0, 2.0)))
    assert "XY at 86 rpm (" in first
    assert "end of the recording" in first
    assert "under XY" in last


def test_a_gap_within_a_dwell_is_the_reason():
    made = session(*FULL, ("YX", 46.0, 7.0), ("YX", 0.0, 2.0))
    inside = int(np.flatnonzero(made.labels == "YX")[0]) + round((4 + 3.5) * RATE_HZ)
    late = np.where(np.arange(made.time.size) >= inside, 30.0, 0.0)
    (words,) = said(replace(made, time=made.time + late))
    assert "YX at 46 rpm (1." in words
    assert "next to a gap" in words


def test_a_gap_from_one_mounting_to_the_next_while_the_table_turns_is_reported():
    made = session(*FULL, ("YX", 46.0, 12.0), ("YX", 0.0, 6.0), ("ZY", 0.0, 6.0))
    kept = np.ones(made.time.size, dtype=bool)
    second = np.flatnonzero(made.labels == "YX")
    kept[second[800:]] = False
    (words,) = said(made.take(kept))
    assert "under YX" in words
    # Where the table rests on both sides no state was lost: the sensor was mounted again.
    third = int(np.flatnonzero(made.labels == "ZY")[0])
    late = np.where(np.arange(made.time.size) >= third, 300.0, 0.0)
    assert said(replace(made, time=made.time + late)) == []


def test_a_rest_on_stuck_samples_is_left_out_with_a_finding():
    made = session(*FULL)
    stuck = Finding("warning", "stuck", "ay holds 0 in samples 100 to 300", "ay", 100, 300)
    marks, found = find_stationary_states(replace(made, findings=(stuck,)))
    assert marks == ()
    assert [one.what for one in found] == ["dwell"]
    assert found[0].start == pytest.approx(RATE_HZ)


def test_a_single_sample_at_a_steady_rate_is_no_state():
    recording = session(*FULL)
    assert recording.span(3, 4) == pytest.approx(1 / RATE_HZ)
    assert recording.span(3, 3) == 0
    words = said(session(*FULL, ("YX", 46.0, 1 / RATE_HZ)))
    assert "YX (never steady or at rest)" in words[0]
