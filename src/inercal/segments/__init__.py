"""From a recording to observations: marks, their checks, and means over sections."""

from inercal.segments.against_plan import check_against_plan, check_turn_ends
from inercal.segments.average import observe
from inercal.segments.detect import find_marks
from inercal.segments.marks import check_marks, marks_from_labels

__all__ = [
    "check_against_plan",
    "check_marks",
    "check_turn_ends",
    "find_marks",
    "marks_from_labels",
    "observe",
]
