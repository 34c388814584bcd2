"""All results of a calibration run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import Parameter
from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.benches.report_data import Plot
from inercal.calibration import Calibration
from inercal.calibration.display import to_html
from inercal.calibration.grade import Verdict
from inercal.estimation import Estimate
from inercal.physics.motion import Motion
from inercal.physics.plan import Step
from inercal.pipeline.temperature_fit import TemperatureFit
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.segments import RestDetection

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import SearchHistory


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """All results of a calibration run, for reports and for inspection.

    Parameters
    ----------
    calibration : Calibration
    estimate : Estimate
        With the bench's nuisances and the residuals.
    observations : Observations
    steps : tuple of Step
        Of each observation.
    bench : Bench
    kind : Kind
        Of the bench.
    expected : mapping of str to Parameter
        The bench's parameters that act on these steps, by full name, as they were stated.
    recording : Recording or None
        None when the data are a table of means.
    marks : tuple of Mark
    findings : tuple of Finding
        Of the audit and of the checks against the plan.
    verdict : Verdict
        The grade, its reasons, few lines in plain words, and all that explains them.
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
    estimate: Estimate
    observations: Observations
    steps: tuple[Step, ...]
    bench: Bench
    kind: Kind[Any, Any]
    expected: Mapping[str, Parameter]
    recording: Recording | None
    marks: tuple[Mark, ...]
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

    def sensed_motion(self, w: Array | None = None) -> Motion:
        """Return the motion that the calibrated sensor measured, at the temperatures of the means.

        Parameters
        ----------
        w : (r, 3) array, optional
            Angular rate where the sensor has no gyros, rad/s.
        """
        sensor, seen = self.calibration.sensor, self.observations
        dT = seen.temperature_offset(sensor.reference_temperature)
        output = sensor.to_output(seen.mean)
        return self.calibration.correct(output, w=w, dw=np.zeros((1, 3)), dT=dT)
