"""All results of a calibration run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import Parameter
from inercal.benches import Bench
from inercal.benches.characteristics import Characteristic
from inercal.benches.kind_definition import Kind
from inercal.benches.report_data import Plot, ReportInput
from inercal.calibration import Calibration
from inercal.calibration.additions import Addition
from inercal.calibration.display import to_html
from inercal.calibration.grade import Verdict
from inercal.estimation import Estimate
from inercal.methods import Remarks
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.pipeline.temperature_fit import TemperatureFit
from inercal.recordings import Finding
from inercal.recordings.data import EstimatorInput
from inercal.recordings.segments import RestDetection
from inercal.runfile import Run

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import Generation, SearchHistory


class FittedRun(NamedTuple):
    """A run after its temperature orders were chosen, with its data and its estimate.

    `stated` is the run before its temperature orders were chosen.
    """

    stated: Run
    run: Run
    inputs: EstimatorInput
    thermal: TemperatureFit | None
    bench: Bench
    expected: Mapping[str, Parameter]
    estimate: Estimate
    findings: tuple[Finding, ...]
    remarks: Remarks
    generations: "tuple[Generation, ...]"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Outcome(ReportInput):
    """All results of a calibration run, including the data that the report of its bench needs.

    Parameters
    ----------
    calibration : Calibration
    kind : Kind
        Kind of bench.
    findings : tuple of Finding
        Findings of the audit and of the checks against the plan.
    verdict : Verdict
        The grade, the reasons, a few lines in plain words, and an explanation.
    rests : RestDetection or None
        Thresholds and marks, if rests were detected without a plan.
    search : SearchHistory or None
        History of the search, if the estimator searches.
    temperature_fit : TemperatureFit or None
        Soaks, orders and prediction errors, if temperatures were stated or tested.
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

    @property
    def additions(self) -> tuple[Addition, ...]:
        """The coefficients that `also = "auto"` added, in order."""
        return self.verdict.additions

    @property
    def characteristics(self) -> tuple[Characteristic, ...]:
        """Hysteresis, threshold and the like of each axis, if the data can show them."""
        return self.kind.characteristics(self)

    def _repr_html_(self) -> str:
        return to_html(self.calibration)

    @property
    def sensor(self) -> Sensor:
        """The sensor with its estimated coefficients."""
        return self.calibration.sensor

    def sensed_motion(self, w: Array | None = None) -> Motion:
        """Return the motion that the sensor measures; see `ReportInput.sensed_motion`."""
        seen = self.observations
        dT = seen.temperature_offset(self.sensor.reference_temperature)
        output = self.sensor.to_output(seen.mean)
        return self.calibration.correct(output, w=w, dw=np.zeros((1, 3)), dT=dT)
