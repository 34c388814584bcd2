"""A dividing head, as a kind of bench."""

from inercal.benches.dividing_head.bench import DividingHead, mounted
from inercal.benches.dividing_head.report import directions, plots, row
from inercal.benches.dividing_head.settings import DividingHeadData, DividingHeadSection, build
from inercal.benches.dividing_head.sheet import sheet
from inercal.benches.dividing_head.simulation import perform_on_head
from inercal.benches.kind import Kind, Output, Vocabulary, when_called
from inercal.errors import InputError
from inercal.plan import Index
from inercal.sensors import Sensor


def _sensor(
    name: str, columns: tuple[str | int, ...], accelerometer: Output, gyro: Output | None
) -> Sensor:
    """Return the one or two accelerometers on the head."""
    if len(columns) not in (1, 2):
        raise InputError(
            "[data] accelerometer: name the columns of the one or two accelerometers on the head, "
            f'such as ["a", "b"]; there are {len(columns)}: {", ".join(map(str, columns))}'
        )
    if gyro is not None:
        raise InputError("[sensor.gyro]: a dividing head stands still; leave it out")
    return mounted(name, "ab"[: len(columns)], *accelerometer)


KIND = Kind(
    "dividing_head",
    DividingHead,
    DividingHeadSection,
    DividingHeadData,
    build,
    (Index,),
    when_called("inercal.benches.dividing_head.reading", "observe"),
    perform_on_head,
    words=Vocabulary(rows="positions", attitudes="Positions of the head", components=""),
    sensor=_sensor,
    sheet=sheet,
    rests=when_called("inercal.data.rests", "seen_rests"),
    directions=directions,
    plots=plots,
    row=row,
)
