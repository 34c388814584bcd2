"""Store the results of a calibration run, and show what a refused run contains."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.benches import Bench
from inercal.benches.characteristics import Characteristic
from inercal.benches.kind_definition import Kind
from inercal.benches.report_data import Plot, ReportInput
from inercal.calibration import Calibration
from inercal.calibration.display import to_html
from inercal.calibration.explanation import Addition
from inercal.calibration.grade import Verdict
from inercal.estimation import Estimate
from inercal.methods import Remarks
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.pipeline.temperature_fit import TemperatureFit
from inercal.recordings import Finding, Recording
from inercal.recordings.data import EstimatorInput
from inercal.recordings.data.recording_loader import load_recording
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
    characteristics : tuple of Characteristic
        Hysteresis, threshold and the like of each axis, if the data can show them.
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
    characteristics: tuple[Characteristic, ...] = ()

    def __repr__(self) -> str:
        return f"<Outcome: {repr(self.calibration).strip('<>')}>"

    @property
    def additions(self) -> tuple[Addition, ...]:
        """The coefficients that `also = "auto"` added, in order."""
        return self.verdict.additions

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
        # Magnetometers are the last axes and are observed apart; they do not act on the others.
        apart = len(self.sensor.axes) - len(seen.channels)
        output = self.sensor.to_output(np.pad(seen.mean, ((0, 0), (0, apart))))
        return self.calibration.correct(output, w=w, dw=np.zeros((1, 3)), dT=dT)


def true_coefficients(calibration: Calibration, truth: Mapping[str, float]) -> Mapping[str, float]:
    """Return the true coefficients by full name, in SI and in the frame of the calibration.

    [sensor.truth] states coefficients in the mounting frame. In the symmetric frame, the same
    sensor has different misalignments, and slightly different scale factors and biases. Only
    bias, scale factor and misalignment can be rotated. If there are other terms, the true
    coefficients are returned as stated.

    Parameters
    ----------
    calibration : Calibration
    truth : mapping of str to float
        Stated true coefficients, SI; missing coefficients are zero.
    """
    names = calibration.sensor.coefficients
    stated: dict[str, float] = {name: truth.get(name, 0.0) for name in names}
    if calibration.frame != "symmetric":
        return stated
    true = replace(calibration, values=np.array(list(stated.values())), frame="mount")
    try:
        rotated = true.in_frame("symmetric")
    except InputError:
        return stated
    return {name: rotated.value(name) for name in names}


@dataclass(frozen=True, eq=False)
class InspectedRecording:
    """A recording, with the rests that were detected in it.

    Parameters
    ----------
    recording : Recording
    rests : RestDetection
        Detected rests; there are no marks if no rest was detected.
    """

    recording: Recording
    rests: RestDetection


def inspect_refused_recording(run: Run) -> InspectedRecording | None:
    """Return the recording and the rests of a run that could not be calibrated.

    Return None if there is no recording, if it cannot be read, or if the bench has no rests.
    """
    if run.data.kind == "means" or run.kind.rests is None:
        return None
    try:
        recording = load_recording(run)
        return InspectedRecording(recording, run.kind.rests(run, recording))
    except InputError:
        return None
