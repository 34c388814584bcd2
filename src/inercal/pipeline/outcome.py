"""All results of a calibration run."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.benches.report_data import Plot, ReportInput
from inercal.calibration import Calibration
from inercal.calibration.display import to_html
from inercal.calibration.grade import Verdict
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.pipeline.temperature_fit import TemperatureFit
from inercal.recordings import Finding
from inercal.recordings.segments import RestDetection

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import SearchHistory


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Outcome(ReportInput):
    """All results of a calibration run: what its bench reports, `ReportInput`, and the rest.

    Parameters
    ----------
    calibration : Calibration
    kind : Kind
        Of the bench.
    findings : tuple of Finding
        Of the audit and of the checks against the plan.
    verdict : Verdict
        The grade, its reasons, and lines in plain words; iteration yields the lines.
    rests : RestDetection or None
        Thresholds and marks, where rests were detected without a plan.
    search : SearchHistory or None
        Of an estimator that searches.
    temperature_fit : TemperatureFit or None
        Soaks, orders and prediction errors, where temperatures were stated or tested.
    plots : tuple of Plot
        Figures that the method adds to the report.
    """

    calibration: Calibration
    bench: Bench
    kind: Kind[Any, Any]
    findings: tuple[Finding, ...]
    verdict: Verdict
    rests: RestDetection | None = None
    search: "SearchHistory | None" = None
    temperature_fit: TemperatureFit | None = None
    plots: tuple[Plot, ...] = ()

    def __repr__(self) -> str:
        return f"<Outcome: {repr(self.calibration).strip('<>')}>"

    def _repr_html_(self) -> str:
        return to_html(self.calibration)

    @property
    def sensor(self) -> Sensor:
        """The sensor with its estimated coefficients."""
        return self.calibration.sensor

    def sensed_motion(self, w: Array | None = None) -> Motion:
        """As `ReportInput.sensed_motion`."""
        seen = self.observations
        dT = seen.temperature_offset(self.sensor.reference_temperature)
        output = self.sensor.to_output(seen.mean)
        return self.calibration.correct(output, w=w, dw=np.zeros((1, 3)), dT=dT)
