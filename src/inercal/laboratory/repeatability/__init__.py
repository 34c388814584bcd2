"""What several calibrations of one sensor say together: its mean, and its next use.

The U of one session holds its noise and its bench. A sensor also scatters from day to day, from
mounting to mounting and from power cycle to power cycle: only repeated sessions show that.
"""

from inercal.laboratory.repeatability.effects import Owner, Scope
from inercal.laboratory.repeatability.repeated_sessions import (
    Repeatability,
    StatedUncertainty,
    repeat,
)
from inercal.laboratory.repeatability.sessions import RepeatedSession

__all__ = ["Owner", "Repeatability", "RepeatedSession", "Scope", "StatedUncertainty", "repeat"]
