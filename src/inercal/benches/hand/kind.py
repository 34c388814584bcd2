"""Register calibration by hand as a kind of bench, with its section of the run file.

[bench] may state the magnetic field: strength, dip and hemisphere.

The worksheet lists holds and turns. The duration of a turn by hand is not known in advance. The
operator fills it in, because the mean rate depends on it. The duration of a hold has no effect on
the result, so the sheet prints the planned duration.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from math import degrees, pi
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches.contract import SensorSimulation
from inercal.benches.hand.bench import Hand
from inercal.benches.hand.simulation import simulate_hand_motion
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.kind_definition import Effect, Kind
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.benches.stated_axes import any_axes
from inercal.physics.magnetism import EARTH_FIELD, POSSIBLE_FIELD, unit_hint
from inercal.physics.plan import HandStep, Hold, Turn, with_second_azimuths
from inercal.physics.section_settings import (
    BenchSection,
    BenchUsage,
    key_error,
    measured_constant,
    optional,
    section_constant,
    section_deviation,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import Recording
from inercal.recordings.data import EstimatorInput, RestsSection, RunBase

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection


def sheet(run: RunBase[RestsSection]) -> Sheet:
    """Return the worksheet with the holds and turns of a run's plan."""
    data = run.data
    steps: list[HandStep] = [step for step in run.steps if isinstance(step, Hold | Turn)]
    if run.magnetometer is not None and not run.method.unknown_attitudes:
        steps = with_second_azimuths(steps)
    rows: list[SheetRow] = []
    for k, step in enumerate(steps, start=1):
        words, turning = step.describe().replace("-", "−"), isinstance(step, Turn)
        cells = (str(k), step.label, words, f"{step.seconds:g} s")
        timed = data.seconds is not None and not turning
        given = (step.label, *[f"{step.seconds:.12g}"] * timed)
        group, facts = "turns" if turning else "holds", {"what": words}
        rows.append(SheetRow(step.label, cells, step.seconds, group, given, facts))
    turns = sum(isinstance(step, Turn) for step in steps)
    kinds = f"{len(steps) - turns} positions" + f" and {turns} turns" * bool(turns)
    gyro = data.gyro if run.sensor.select_axes("w").axes else ()
    field = data.magnetometer if run.magnetometer is not None else ()
    return Sheet(
        f"{kinds}, {sum(step.seconds for step in steps):.0f} s in all",
        (ROW, Heading("label"), Heading("set to"), DURATION),
        tuple(rows),
        _operator_notes(run, turns=bool(turns)),
        (data.label, data.seconds, *data.accelerometer, *gyro, *field),
        units={} if data.seconds is None else {str(data.seconds): "s"},
        table_error=_table_error(run, turns=bool(turns)),
    )


def _operator_notes(run: RunBase[RestsSection], *, turns: bool) -> tuple[str, ...]:
    found = [
        "Up is the direction in which an axis reads plus 1 g at rest.",
        "Average the readings at rest, without touching the sensor.",
    ]
    if turns:
        found.append(
            "A turn begins and ends at rest, with its axis up; note its duration and the means of "
            "all readings from rest to rest. A positive angle is counter-clockwise seen from above."
        )
    if run.magnetometer is not None:
        found.append("Keep the sensor at one place, away from iron and currents.")
        if not run.method.unknown_attitudes:
            found.append('For "(2)", turn the sensor on its face by about 180° about the vertical.')
    if run.method.unknown_attitudes:
        found.append("The attitudes may differ from those in the plan.")
    return (*found, "The steps may be done in any order.")


def _table_error(run: RunBase[RestsSection], *, turns: bool) -> InputError | None:
    """Return the error if a table of means is not sufficient or has no column for a value."""
    if run.method.unknown_attitudes and run.sensor.select_axes("w").axes:
        return key_error(
            "[sensor.gyro]",
            f"a table of means has no rotations, which {run.method.name} needs for the gyros; "
            "remove [sensor.gyro], or make a recording",
            run.path,
        )
    for key, needed in (("label", True), ("seconds", turns)):
        if needed and getattr(run.data, key) is None:
            return key_error(
                f"[data] {key}", "is missing: name its column in the worksheet", run.path
            )
    return None


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
        elif use.one_file and section_deviation(self, "turn_on", "°/s"):
            found["turn_on"] = (
                "all sections are from one recording, during which the gyros stay switched on; "
                'name a file for each section, such as file = "*.csv"'
            )
        if not use.turns:
            words = f"{use.method} uses no turns through a known angle"
            found |= {"turn_angle": words, "turn_tilt": words}
            if not use.gyros or use.attitudes:
                found["timebase"] = f"without turns, {use.method} does not depend on time"
        return found


def build(section: HandSection, folder: Path) -> Hand:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    known = section.latitude is not None
    bench = build_bench(
        Hand,
        section,
        latitude=section_constant(section, "latitude", "°") if known else None,
        field=stated_field(section.field),
        dip=stated_dip(section.dip, section.hemisphere),
        hemisphere=section.hemisphere,
    )
    by_place = replace(bench, hemisphere=None, dip=None).dip_sign
    if replace(bench, latitude=None).dip_sign * by_place < 0:
        key = "dip" if section.hemisphere is None else "hemisphere"
        raise key_error(
            "[bench] latitude",
            f'{section.latitude!r} contradicts {key} = "{getattr(section, key)}"; the latitude is '
            "negative in the south, where the field points upwards and the dip is negative",
        )
    return bench


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
    rng: "np.random.Generator",
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
    drift_from_slopes=True,
    audit=_audit,
    sheet=sheet,
    rests=_rests,
    sensor=any_axes,
    directions=directions,
)
