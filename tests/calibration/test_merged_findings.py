"""Findings of one event are one, and a verdict has no line and no reason twice."""

import numpy as np

from inercal.calibration.verdict import verdict
from inercal.estimation import Estimate
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, merge_findings, merge_messages


def warned(*findings: Finding) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the reasons and lines of a verdict on nothing but findings."""
    estimate = Estimate.from_closed_form((), np.zeros(0), np.zeros((0, 0)), np.ones(0))
    found = verdict(estimate, Sensor("none", ()), merge_findings(findings))
    return found.reasons, found.statements


def test_two_reports_of_one_gap_are_one_finding_with_both_texts():
    audit = Finding("warning", "gap", "1 gap, 43 s lost in all", None, 412, 414)
    track = Finding("warning", "gap", "no sample for 43 s: initialised again", None, 412, 414)
    (one,) = merge_findings([audit, track])
    assert (one.what, one.start, one.stop) == ("gap", 412, 414)
    assert one.merged == (audit, track)
    assert audit.message in one.message
    assert track.message in one.message


def test_two_gaps_stay_two_findings_and_are_one_reason():
    first = Finding("warning", "gap", "a: cause", None, 10, 12)
    second = Finding("warning", "gap", "b: cause", None, 90, 92)
    assert merge_findings([first, second]) == (first, second)
    reasons, lines = warned(first, second)
    assert "a: cause (and 1 more)" in reasons
    assert not any("b: cause" in one for one in reasons)
    assert "a: cause" in lines
    assert "b: cause" in lines


def test_a_gap_leads_to_the_connection_and_not_to_the_stated_noise():
    gap = Finding("warning", "gap", "1 gap, 43 s lost in all, after sample 412", None, 412, 414)
    steps = dict.fromkeys(warned(gap)[1])
    assert any("cable" in line and "record again" in line.lower() for line in steps)
    assert not any("stated noise" in line for line in steps)


def test_nineteen_equal_lines_are_one_that_says_how_many():
    equal = [Finding("warning", "slip", "a packet is lost", None, k, k + 1) for k in range(19)]
    (one,) = merge_findings(equal)
    assert len(one.merged) == 19
    assert (one.start, one.stop) == (0, 19)
    _, lines = warned(*equal)
    assert sum("a packet is lost" in line for line in lines) == 1
    assert any("19" in line for line in lines)


def test_many_places_of_one_cause_are_one_line_with_all_places():
    messages = [f"rest r{k} is left out: it is clipped" for k in range(9)]
    (line,) = merge_messages(messages)
    assert all(f"rest r{k} " in line for k in range(9))
    assert line.count("it is clipped") == 1
    assert merge_messages(messages[:3]) == tuple(messages[:3])


def test_findings_of_other_kinds_severities_channels_and_factors_stay_apart():
    findings = (
        Finding("warning", "gap", "x", None, 0, 5),
        Finding("note", "gap", "x", None, 0, 5),
        Finding("warning", "outlier", "x", "ax", 0, 5),
        Finding("warning", "outlier", "y", "ay", 0, 5),
        Finding("warning", "noise", "n", "ax", factor=2.0),
        Finding("warning", "noise", "n", "ax", factor=3.0),
    )
    assert merge_findings(findings) == findings
