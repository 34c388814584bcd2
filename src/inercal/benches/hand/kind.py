"""Calibration by hand, as a kind of bench: its section of the run file and its directions.

[bench] may state the magnetic field: strength, dip and hemisphere.
"""

import re
from collections.abc import Sequence
from math import degrees, pi
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from inercal.basics.units import Measured
from inercal.benches.contract import SensorSimulation
from inercal.benches.hand.bench import Hand
from inercal.benches.hand.sheet import sheet
from inercal.benches.hand.simulation import simulate_hand_motion
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.kind_definition import Effect, Kind
from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.benches.stated_axes import any_axes
from inercal.physics.magnetism import EARTH_FIELD, POSSIBLE_FIELD, unit_hint
from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.section_settings import (
    BenchSection,
    BenchUsage,
    key_error,
    measured_constant,
    optional,
    section_constant,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import Recording
from inercal.recordings.data import EstimatorInput, RestsSection, RunBase

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection

_NUMBER = re.compile(r"\s*[+-]?\d+(\.\d*)?([eE][+-]?\d+)?")
_MOST = 0.2  # largest relative uncertainty; a less certain strength is of no use
_CLEAR = 3.0  # standard uncertainties


def stated_field(text: str | None) -> Measured | None:
    """Return the strength of the field, T; None if it is not stated.

    Raises
    ------
    InputError
        The text is no flux density, or one that the Earth does not have anywhere.
    """
    if text is None:
        return None
    key = "[bench] field"
    field = measured_constant(text, "T", key)
    low, high = (f"{1e6 * end:.0f}" for end in EARTH_FIELD)
    if not POSSIBLE_FIELD[0] <= field.value <= POSSIBLE_FIELD[1]:
        number = _NUMBER.match(text)
        hint = unit_hint(abs(float(number[0]))) if number else ""
        raise key_error(
            key, f"{text!r} is not possible; the Earth's field is {low} to {high} µT{hint}"
        )
    if field.sd > _MOST * field.value:
        raise key_error(
            key, f"{text!r} is too uncertain to be of use; remove it, and the field is estimated"
        )
    return field


def stated_dip(text: str | None, hemisphere: str | None) -> Measured | None:
    """Return the dip of the field, rad; None if it is not stated.

    Raises
    ------
    InputError
        The text is no angle up to 90°, or it contradicts the hemisphere.
    """
    if text is None:
        return None
    key = "[bench] dip"
    dip = measured_constant(text, "°", key)
    if abs(dip.value) > pi / 2:
        raise key_error(key, f"{text!r} is not possible; give an angle from −90° to 90°")
    down = dip.value > 0
    if (
        hemisphere is not None
        and abs(dip.value) > _CLEAR * dip.sd
        and down != (hemisphere == "north")
    ):
        raise key_error(
            key,
            f'{text!r} contradicts hemisphere = "{hemisphere}"; the dip is positive where the '
            "field points downwards, as in the north",
        )
    return dip


@add_bench_keys(Hand, after={"field": "turn_on"})
class HandSection(BenchSection):
    """Section [bench] for a sensor turned by hand; gravity is stated or computed from the site."""

    kind: Literal["hand"] = "hand"
    field: str | None = optional(
        "48.6 µT ± 0.3 µT", about="strength of the magnetic field, if it is known at the bench"
    )
    dip: str | None = optional(
        "65° ± 0.5°", about="angle of the magnetic field below the horizontal plane"
    )
    hemisphere: Literal["north", "south"] | None = optional(
        "north", about="'north' if the magnetic field points downwards, 'south' if upwards"
    )

    @property
    def without_gravity(self) -> bool:
        """Whether a method that follows a single rest may leave gravity out."""
        return True

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        if use.rest:
            kept = {"kind", "name", *(("field",) if use.magnetometers else ())}
            reason = f"{use.method} follows the whole recording and does not depend on it"
            return dict.fromkeys(type(self).model_fields.keys() - kept, reason)
        found: dict[str, str] = {}
        if not use.magnetometers:
            found = dict.fromkeys(("field", "dip", "hemisphere"), "the sensor has no magnetometers")
        if not use.attitudes:
            found["tilt"] = f"{use.method} estimates the attitudes"
            found["placement"] = f"{use.method} estimates the attitudes"
            found["turn_on"] = f"{use.method} assumes one constant bias per gyro"
        elif not use.gyros:
            found["turn_on"] = "the sensor has no gyros"
        if not use.turns:
            words = f"{use.method} uses no turns through a known angle"
            found |= {"turn_angle": words, "turn_tilt": words}
            if not use.gyros or use.attitudes:
                found["timebase"] = f"without turns, {use.method} does not depend on time"
        return found


def build(section: HandSection, folder: Path) -> Hand:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    known = section.latitude is not None
    return build_bench(
        Hand,
        section,
        latitude=section_constant(section, "latitude", "°") if known else None,
        field=stated_field(section.field),
        dip=stated_dip(section.dip, section.hemisphere),
        hemisphere=section.hemisphere,
    )


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured upward direction in each hold and the axis of each turn.

    The result is empty if the accelerometers do not measure all components.
    """
    if shown.sensor.rank("f") < len("xyz"):
        return ()
    sensed = shown.sensed_motion()
    result: list[MeasuredDirection] = []
    for k, step in enumerate(shown.steps):
        if isinstance(step, Hold):
            result.append(measured_direction(step, sensed.f[k], np.array(step.up)))
        elif isinstance(step, Turn) and shown.sensor.rank("w") == len("xyz"):
            axis = sensed.w[k] * np.sign(step.angle)
            result.append(measured_direction(step, axis, np.array(step.axis)))
    return tuple(result)


def _observe(run: RunBase[RestsSection]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.hand.reading import observe

    return observe(run)


def _audit(recording: Recording, sensor: Sensor, bench: Hand) -> Recording:
    """Return the recording with findings about its norms at rest."""
    from inercal.benches.hand.reading import audit

    return audit(recording, sensor, bench)


def _rests(run: RunBase[RestsSection], recording: Recording) -> "RestDetection":
    """Return the rests in a refused recording."""
    from inercal.benches.hand.reading import refused_recording_rests

    return refused_recording_rests(run, recording)


def simulate(
    bench: Hand,
    steps: Sequence[HandStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Simulate the motion, and the magnetic field if the sensor has magnetometers."""
    magnetic = bool(sensor.select_axes("m").axes)
    done = simulate_hand_motion(
        bench, steps, rate_hz, rng, trials, carried=carried, magnetic=magnetic
    )
    return SensorSimulation(done, sensor)


KIND = Kind(
    "hand",
    Hand,
    HandSection,
    RestsSection,
    build,
    (Hold, Turn),
    _observe,
    simulate,
    # At the equator the vertical component of the earth's rate is zero.
    effects=(
        Effect("earth's rate", "latitude", 0.0, "° of latitude", degrees(1), affects_rates=True),
    ),
    audit=_audit,
    sheet=sheet,
    rests=_rests,
    sensor=any_axes,
    directions=directions,
)
