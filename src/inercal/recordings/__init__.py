"""Recordings: file readers, the audit, rests and sections, and section means with covariance.

A `Recording` is in the sensor's output units; `Observations` are in SI units. Both may have leading
axes for trials, `(..., n, m)`. All trials have the same times and labels.
"""

from inercal.recordings.observations import Observations, Transitions, join_observations
from inercal.recordings.rounding_errors import ReadingSteps, RoundedChannel, add_rounding
from inercal.recordings.samples import (
    GAP_FACTOR,
    STAMP_ROUNDING,
    Finding,
    Indices,
    Mark,
    Recording,
    Severity,
    merge_findings,
    merge_messages,
    sample_count,
)
from inercal.recordings.temperature import ahead_of_lag, temperature_rate
from inercal.recordings.track import AngleQuality, Track, join_tracks

__all__ = [
    "GAP_FACTOR",
    "STAMP_ROUNDING",
    "AngleQuality",
    "Finding",
    "Indices",
    "Mark",
    "Observations",
    "ReadingSteps",
    "Recording",
    "RoundedChannel",
    "Severity",
    "Track",
    "Transitions",
    "add_rounding",
    "ahead_of_lag",
    "join_observations",
    "join_tracks",
    "merge_findings",
    "merge_messages",
    "sample_count",
    "temperature_rate",
]
