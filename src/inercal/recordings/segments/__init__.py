"""Convert a recording to observations: find and check marks, then average over sections."""

from inercal.recordings.segments.attitudes import (
    holds_from_marks,
    holds_from_observations,
    transitions_between_rests,
    valid_marks,
)
from inercal.recordings.segments.dwells import average_dwells, find_dwells
from inercal.recordings.segments.motion_thresholds import scatter
from inercal.recordings.segments.plan_check import (
    check_against_plan,
    check_marks,
    check_turn_ends,
    marks_from_labels,
)
from inercal.recordings.segments.rest_changes import (
    bias_jump_test,
    changes_within_rests,
    require_still,
)
from inercal.recordings.segments.rest_detection import RestDetection, find_rests, find_thresholds
from inercal.recordings.segments.section_detection import faces_up, find_sections, search_sections
from inercal.recordings.segments.section_means import average_sections

__all__ = [
    "RestDetection",
    "average_dwells",
    "average_sections",
    "bias_jump_test",
    "changes_within_rests",
    "check_against_plan",
    "check_marks",
    "check_turn_ends",
    "faces_up",
    "find_dwells",
    "find_rests",
    "find_sections",
    "find_thresholds",
    "holds_from_marks",
    "holds_from_observations",
    "marks_from_labels",
    "require_still",
    "scatter",
    "search_sections",
    "transitions_between_rests",
    "valid_marks",
]
