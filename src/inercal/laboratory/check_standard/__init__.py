"""A check standard: a sensor that is measured before each job, and the control charts of it.

The sensor is known from its first days, the reference. A later day is compared with it: the bench
is in control where the sensor reads what it read then, within its noise and its scatter from day
to day.
"""

from inercal.laboratory.check_standard.charts import (
    CheckedSession,
    CheckPoint,
    ControlCharts,
    Episode,
    control_charts,
)

__all__ = ["CheckPoint", "CheckedSession", "ControlCharts", "Episode", "control_charts"]
