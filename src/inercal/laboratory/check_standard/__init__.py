"""Chart a check standard, which is a sensor that is measured before each job.

The first days of the sensor are the reference, and each later day is compared with the reference.
The bench is in control if the sensor still gives the same results as in the reference, within its
noise and its day-to-day scatter.
"""

from inercal.laboratory.check_standard.charts import (
    CheckedSession,
    CheckPoint,
    ControlCharts,
    Episode,
    control_charts,
)

__all__ = ["CheckPoint", "CheckedSession", "ControlCharts", "Episode", "control_charts"]
