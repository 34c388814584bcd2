"""From a recording to observations: marks, their checks, and means over sections."""

from inercal.segments.against_plan import check_against_plan, check_turn_ends
from inercal.segments.attitudes import as_found, held, unflawed
from inercal.segments.average import observe
from inercal.segments.detect import find_marks, find_sections, search_sections
from inercal.segments.dwells import average_dwells, find_dwells
from inercal.segments.halves import jumps, within_rests
from inercal.segments.levels import scatter
from inercal.segments.marks import check_marks, marks_from_labels
from inercal.segments.rests import FoundRests, find_rests, judged_levels
from inercal.segments.stationary_states import find_stands, left_out
from inercal.segments.stillness import require_still
from inercal.segments.table_steps import (
    Turned,
    find_holds,
    find_turns,
    long_enough,
    numbered_holds,
)
from inercal.segments.transitions import between_rests

__all__ = [
    "FoundRests",
    "Turned",
    "as_found",
    "average_dwells",
    "between_rests",
    "check_against_plan",
    "check_marks",
    "check_turn_ends",
    "find_dwells",
    "find_holds",
    "find_marks",
    "find_rests",
    "find_sections",
    "find_stands",
    "find_turns",
    "held",
    "judged_levels",
    "jumps",
    "left_out",
    "long_enough",
    "marks_from_labels",
    "numbered_holds",
    "observe",
    "require_still",
    "scatter",
    "search_sections",
    "unflawed",
    "within_rests",
]
