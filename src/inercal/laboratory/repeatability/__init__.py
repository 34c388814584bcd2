"""Combine several calibrations of a sensor into a mean and the uncertainty of its next use.

The U of one session includes its noise and its bench. A sensor also scatters from day to day, from
mounting to mounting and from power cycle to power cycle, which only repeated sessions can show.
"""

from inercal.laboratory.repeatability.effects import Owner, Scope
from inercal.laboratory.repeatability.repeated_sessions import (
    Repeatability,
    StatedUncertainty,
    repeat,
)
from inercal.laboratory.repeatability.sessions import RepeatedSession

__all__ = ["Owner", "Repeatability", "RepeatedSession", "Scope", "StatedUncertainty", "repeat"]
