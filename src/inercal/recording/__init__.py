"""The data of a bench run: its samples, findings of the audit, and means over its sections.

A `Recording` has the sensor's output units; `Observations` are in SI. Both may have leading axes of
trials, `(..., n, m)`; trials share times and labels.
"""

from inercal.recording.findings import Finding, Severity, merge_findings, merge_messages
from inercal.recording.observations import Observations, join_observations
from inercal.recording.rounding_errors import (
    ReadingSteps,
    RoundedChannel,
    RoundingErrors,
    rounded_channels,
    rounding_notes,
)
from inercal.recording.samples import (
    GAP_FACTOR,
    STAMP_ROUNDING,
    Indices,
    Mark,
    Recording,
    sample_count,
)
from inercal.recording.temperature_course import (
    TEMPERATURE_VARIATION,
    ahead_of_lag,
    temperature_rate,
)
from inercal.recording.track import AngleQuality, Track, join_tracks
from inercal.recording.transitions import HalfSectionChanges, Transitions

__all__ = [
    "GAP_FACTOR",
    "STAMP_ROUNDING",
    "TEMPERATURE_VARIATION",
    "AngleQuality",
    "Finding",
    "HalfSectionChanges",
    "Indices",
    "Mark",
    "Observations",
    "ReadingSteps",
    "Recording",
    "RoundedChannel",
    "RoundingErrors",
    "Severity",
    "Track",
    "Transitions",
    "ahead_of_lag",
    "join_observations",
    "join_tracks",
    "merge_findings",
    "merge_messages",
    "rounded_channels",
    "rounding_notes",
    "sample_count",
    "temperature_rate",
]
