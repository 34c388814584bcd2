"""The data of a bench run: its samples, findings of the audit, and means over its sections.

A `Recording` has the sensor's output units; `Observations` are in SI. Both may have leading axes of
trials, `(..., n, m)`; trials share times and labels.
"""

from inercal.recording.findings import Finding, Severity
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
    Indices,
    LineBreaks,
    Mark,
    Recording,
    line_of_row,
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
    "TEMPERATURE_VARIATION",
    "AngleQuality",
    "Finding",
    "HalfSectionChanges",
    "Indices",
    "LineBreaks",
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
    "line_of_row",
    "rounded_channels",
    "rounding_notes",
    "temperature_rate",
]
