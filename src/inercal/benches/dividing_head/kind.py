"""A dividing head, as a kind of bench."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from inercal.benches.contract import Simulated
from inercal.benches.dividing_head.bench import DividingHead, mounted
from inercal.benches.dividing_head.report import directions, plots, row
from inercal.benches.dividing_head.settings import DividingHeadData, DividingHeadSection, build
from inercal.benches.dividing_head.sheet import sheet
from inercal.benches.dividing_head.simulation import perform_on_head
from inercal.benches.kind import Kind, Output, Vocabulary
from inercal.data import Gathered, Source
from inercal.errors import InputError
from inercal.plan import Index
from inercal.recording import Recording
from inercal.sensors import Sensor

if TYPE_CHECKING:
    from inercal.segments import FoundRests


def _simulate(
    bench: DividingHead,
    steps: Sequence[Index],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> Simulated:
    return perform_on_head(bench, steps, sensor, rate_hz, rng, trials)


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


def _observe(run: Source[DividingHeadData]) -> Gathered:
    # Here and below: what finds sections comes with compiled kernels, which plans do without.
    from inercal.benches.dividing_head.reading import observe

    return observe(run)


def _rests(run: Source[DividingHeadData], recording: Recording) -> "FoundRests":
    from inercal.data.rests import seen_rests

    return seen_rests(run, recording)


KIND = Kind(
    "dividing_head",
    DividingHead,
    DividingHeadSection,
    DividingHeadData,
    build,
    (Index,),
    _observe,
    _simulate,
    words=Vocabulary(rows="positions", attitudes="Positions of the head", components=""),
    sensor=_sensor,
    sheet=sheet,
    rests=_rests,
    directions=directions,
    plots=plots,
    row=row,
)
