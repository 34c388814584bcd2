"""Choose the ranges over which an export is compared with its calibration, and fill them."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.calibration.validity import TEMPERATURE_MARGIN, require_inside
from inercal.export.model import UNMEASURED
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors import G0

Range = tuple[float, float]
_UNITS = {"force": "m/s²", "rate": "rad/s", "temperature": "K", "field": "T"}
NAMES: dict[Measures, Literal["force", "rate", "field"]] = {"f": "force", "w": "rate", "m": "field"}
_FIELD = 65e-6  # the strongest field of the Earth, T
_SAMPLES = 10_000
_SEED = 20261


@dataclass(frozen=True)
class Ranges:
    """Ranges for each axis; `assumed` lists the ranges that neither calibration nor user states.

    Parameters
    ----------
    force, rate : (float, float)
        Ranges of force and rate, m/s² and rad/s.
    temperature : (float, float) or None
        Range of temperature, K; None if the calibration states no range.
    assumed : tuple of str
    field : (float, float)
        Range of the magnetic flux density, T.
    """

    force: Range
    rate: Range
    temperature: Range | None
    assumed: tuple[str, ...] = ()
    field: Range = (-_FIELD, _FIELD)

    def of(self, kind: Measures) -> Range:
        """Return the range of a kind of motion."""
        return getattr(self, NAMES[kind])


def calibrated_ranges(
    calibration: Calibration,
    *,
    force: Range | None = None,
    rate: Range | None = None,
    temperature: Range | None = None,
    field: Range | None = None,
) -> Ranges:
    """Return the stated ranges, else those of the data, else ±1 g, ±1 rad/s and ±65 µT.

    Parameters
    ----------
    calibration : Calibration
    force, rate, temperature, field : (float, float), optional
        Stated ranges, m/s², rad/s, K and T; they replace the ranges of the data.

    Raises
    ------
    InputError
        The upper end of a range is not above its lower end, or the model depends on temperature and
        the stated temperatures are outside the range of the calibration.
    """
    known = {} if calibration.validity is None else calibration.validity.ranges
    given = {"force": force, "rate": rate, "temperature": temperature, "field": field}
    for name, stated in given.items():
        if stated is not None:
            if not stated[0] < stated[1]:
                shown = f"{stated[0]:g} to {stated[1]:g} {_UNITS[name]}"
                raise InputError(f"{name} from {shown}: give the lower end first", key=name)
            known[name] = stated
    if temperature is not None:
        if not calibration.sensor.uses("dT", "dTdt"):
            text = "the calibration has no temperature terms: remove the range of temperature"
            raise InputError(text, key="temperature")
        require_inside(
            calibration.sensor,
            calibration.validity,
            np.array(temperature),
            "give a temperature within",
        )
    kinds = {axis.measures for axis in calibration.sensor.axes}
    # A sensor with only gyros gets no note about an assumed range of specific force, because on a
    # rate table it senses gravity.
    assumed = [name for kind, name in NAMES.items() if kind in kinds and name not in known]
    return Ranges(
        known.get("force", (-G0, G0)),
        known.get("rate", (-1.0, 1.0)),
        known.get("temperature"),
        tuple(assumed),
        known.get("field", (-_FIELD, _FIELD)),
    )


def sample_motions(calibration: Calibration, ranges: Ranges) -> Motion:
    """Return motions that fill the ranges: all corners and 10⁴ random motions.

    Components that the sensor does not measure are zero.
    """
    sensor = calibration.sensor
    kinds = {axis.measures for axis in sensor.axes}
    still = (0.0, 0.0)
    measured = KINDS[: sensor.width // 3]
    sides = [ranges.of(kind) if kind in kinds else still for kind in measured for _ in "xyz"]
    span = ranges.temperature if sensor.uses("dT") else None
    reference = sensor.reference_temperature
    sides.append(still if span is None else (span[0] - reference, span[1] - reference))
    low, high = np.array(sides).T
    corners = np.array(list(product(*[sorted({a, b}) for a, b in sides])))
    random = np.random.default_rng(_SEED).uniform(size=(_SAMPLES, len(sides))) * (high - low) + low
    points: Array = np.concatenate([corners, random])
    names = [f"{UNMEASURED}{kind}{x}" for kind in measured for x in "xyz"]
    points[:, :-1] *= [name not in sensor.channels for name in names]
    motion = Motion(points[:, :3], points[:, 3:6], np.zeros((1, 3)), points[:, -1])
    return replace(motion, m=points[:, 6:9]) if "m" in measured else motion


def temperature_limits(
    ranges: Ranges, target: str, lowest: float | None = None, highest: float | None = None
) -> Range:
    """Return the temperature limits of an export's correction, °C.

    Parameters
    ----------
    ranges : Ranges
    target : str
        Name of the target, used in messages.
    lowest, highest : float, optional
        Limits stated by the user, °C.

    Raises
    ------
    InputError
        Neither the calibration nor the user states limits, or the user's limits are outside the
        limits of the calibration.
    """
    known = ranges.temperature
    low = lowest if known is None or lowest is not None else known[0] - ZERO_CELSIUS
    high = highest if known is None or highest is not None else known[1] - ZERO_CELSIUS
    if low is None or high is None:
        raise InputError(
            f"{target} corrects between two temperatures, but the calibration does not state "
            "them; give --over-temperature, such as '-10 60 °C'",
            key="temperature",
        )
    if low == high and (lowest, highest) == (None, None):
        raise InputError(
            f"{target} corrects between two temperatures, but all data of the calibration are at "
            f"{low:.2f} °C; calibrate over temperature",
            key="temperature",
        )
    if not low < high:
        raise InputError(
            f"{target}: {low:g} to {high:g} °C: give the lower temperature as lowest",
            key="--set",
            names=("lowest", "highest"),
        )
    if known is not None:
        ends = (known[0] - ZERO_CELSIUS, known[1] - ZERO_CELSIUS)
        if low < ends[0] - TEMPERATURE_MARGIN or high > ends[1] + TEMPERATURE_MARGIN:
            raise InputError(
                f"{target}: {low:g} to {high:g} °C is beyond the temperatures of the calibration, "
                f"{ends[0]:.2f} to {ends[1]:.2f} °C: a polynomial is unknown there; give "
                "temperatures within",
                key="--set",
                names=("lowest", "highest"),
            )
    return low, high
