"""What several calibrations of one sensor say together: its mean, and its next use.

A session's U holds the noise and the bench of that session. From day to day, from mount to mount
and from one power cycle to the next a sensor scatters besides; that shows in repeated sessions
alone.
"""

from inercal.repeatability.repeated_sessions import (
    Owner,
    Repeatability,
    Scope,
    StatedUncertainty,
    repeat,
)
from inercal.repeatability.sessions import RepeatedSession

__all__ = ["Owner", "Repeatability", "RepeatedSession", "Scope", "StatedUncertainty", "repeat"]
