"""Combine several calibrations of a sensor into a mean and the uncertainty of its next use.

The U of one session includes the noise and the errors of the bench. The results of a sensor also
scatter from day to day, from mounting to mounting and from power cycle to power cycle. Only
repeated sessions can show this scatter.
"""

from inercal.laboratory.repeatability.repeated_sessions import (
    Repeatability,
    StatedUncertainty,
    repeat,
)
from inercal.laboratory.repeatability.sessions import Owner, RepeatedSession, Scope

__all__ = ["Owner", "Repeatability", "RepeatedSession", "Scope", "StatedUncertainty", "repeat"]
