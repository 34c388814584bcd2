"""A dividing head, as a kind of bench."""

from typing import TYPE_CHECKING

from inercal.benches.dividing_head.bench import DividingHead, mounted_sensor, sensor_in_plane
from inercal.benches.dividing_head.passes import steps_without_warm_up
from inercal.benches.dividing_head.report import describe_position, directions, plots
from inercal.benches.dividing_head.settings import DividingHeadData, DividingHeadSection, build
from inercal.benches.dividing_head.sheet import sheet
from inercal.benches.dividing_head.simulation import simulate_head_motion
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.stated_axes import StatedAxes
from inercal.physics.plan import Index
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings import Recording
from inercal.recordings.data import EstimatorInput, RunBase

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection


def _sensor(name: str, *stated: StatedAxes) -> Sensor:
    """Return the accelerometers on the head; without the key `axis` there are one or two."""
    accelerometers = next((one for one in stated if one.measures == "f"), None)
    columns = () if accelerometers is None else accelerometers.columns
    if others := [one.section for one in stated if one.measures != "f"]:
        raise key_error(
            others[0], "a dividing head is at rest during a reading; remove the section"
        )
    if accelerometers is not None and accelerometers.directions:
        return sensor_in_plane(name, accelerometers.axes())
    if accelerometers is None or len(columns) not in (1, 2):
        raise key_error(
            "[data] accelerometer",
            f"{len(columns)} columns are named; name one or two, for the accelerometers on the "
            'head, such as ["a", "b"], or state the directions of more in [sensor.accelerometer] '
            "axis",
            names=tuple(map(str, columns)),
        )
    letters = "ab"[: len(columns)]
    return mounted_sensor(name, letters, accelerometers.readout, accelerometers.noise)


def _observe(run: RunBase[DividingHeadData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.dividing_head.reading import observe

    return observe(run)


def _rests(run: RunBase[DividingHeadData], recording: Recording) -> "RestDetection":
    """Return the rests in a refused recording."""
    from inercal.recordings.data.rest_marks import rests_without_plan

    return rests_without_plan(run, recording)


KIND = Kind(
    "dividing_head",
    DividingHead,
    DividingHeadSection,
    DividingHeadData,
    build,
    (Index,),
    _observe,
    simulate_head_motion,
    words=Vocabulary(rows="positions", attitudes="Positions of the head", components=""),
    sensor=_sensor,
    sheet=sheet,
    rests=_rests,
    directions=directions,
    plots=plots,
    row=describe_position,
    fitted=steps_without_warm_up,
)
