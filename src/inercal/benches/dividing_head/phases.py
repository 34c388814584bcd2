"""Check the phase and the amplitude of the readings on a dividing head, and name what is wrong.

A reading is a constant plus a sine of the head's angle, whose phase is that of the mounting.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.passes import pass_numbers
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.physics.plan import Index
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.recordings.data import RunBase

_PHASE = 10.0  # °, the largest error of a fixture
_SWING = (0.5, 2.0)  # possible amplitudes in g
_FEWEST = 3  # positions needed to determine a phase
_SURE = 5  # positions needed to judge whether readings follow a sine
_FOLLOWS = 0.02  # largest residual of readings that follow a sine, relative to its amplitude
_GON = 0.9  # degrees
_FROZEN = 4  # consecutive positions whose angle must not be constant
_SAME = 1e-4  # rad
_OPPOSITE = 180.0  # °, the phase of a wrong sign
_MOVED = 0.1  # g, more than a sensor at rest drifts


@dataclass(frozen=True)
class _Sines:
    """Sines through the readings of m accelerometers: phases (°), amplitudes (g), and quality."""

    most: Array  # (m,), angle of the largest reading
    off: Array  # (m,), difference from the angle of the mounting, −180 to 180
    swing: Array  # (m,)
    follows: bool

    @property
    def is_right(self) -> bool:
        """Whether the readings follow sines with the phases of the mounting and 1 g."""
        return self.follows and bool((np.abs(self.off) < _PHASE).all()) and _is_possible(self.swing)


def _fit_sines(angle: Array, readings: Array, wanted: Sequence[float]) -> _Sines | None:
    """Fit sines to readings, (r, m) in SI; None if the angles, (r,) in rad, are too few."""
    basis = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    if np.linalg.matrix_rank(basis, tol=1e-3) < _FEWEST:
        return None
    solved = np.linalg.lstsq(basis, readings, rcond=None)[0]
    _, sine, cosine = solved
    most = np.arctan2(sine, cosine) * 180 / pi % 360
    swing = np.hypot(sine, cosine)
    left = np.sqrt(np.mean((readings - basis @ solved) ** 2, axis=0))
    follows = len(angle) >= _SURE and bool((left < _FOLLOWS * swing).all())
    return _Sines(most, (most - wanted + 180) % 360 - 180, swing / G0, follows)


def require_phases(
    run: RunBase[DividingHeadData], observations: Observations, steps: Sequence[Index]
) -> None:
    """Refuse accelerometers whose readings do not have the phase of their mounting or 1 g.

    Raises
    ------
    InputError
        The phase or the amplitude of an accelerometer's readings is wrong.
    """
    wanted = largest_reading_angles(run.sensor)
    angle = np.array([step.angle for step in steps])
    found = _fit_sines(angle, observations.mean, wanted)
    if found is None:
        return
    key = "[data] accelerometer"
    given = [str(column) for column in run.data.accelerometer]
    off, most = np.abs(found.off), found.most.tolist()
    k = int(np.argmax(off))
    if off[k] > _PHASE:
        crossed = np.abs((found.most - wanted[::-1] + 180) % 360 - 180)
        if len(given) == len("ab") and crossed.max() < _PHASE:
            raise key_error(
                key,
                f"columns {given[0]} and {given[1]} are exchanged: {given[0]} reads most at "
                f"{most[0]:.0f}° and {given[1]} at {most[1]:.0f}°, but the first must read most at "
                f'{wanted[0]:.0f}° and the other at {wanted[1]:.0f}°; write ["{given[1]}", '
                f'"{given[0]}"]',
                names=(given[0], given[1]),
            )
        usual = "correct the sign of the head's angle, or the mounting" + run.sensor.negative_scales
        cause = next(_causes(observations.mean, steps, found, wanted), usual)
        text = f"{given[k]} reads most at {most[k]:.0f}°, but must read most at {wanted[k]:.0f}°"
        raise key_error(key, f"{text}; {cause}", names=(given[k],))
    if not _is_possible(found.swing):
        k = int(np.argmax(np.abs(np.log(found.swing))))
        usual = "check the unit and the scale in [sensor.accelerometer]"
        cause = next(_wrong_pass(observations.mean, steps, wanted), usual)
        text = f"the amplitude of {given[k]} in the field of gravity is {found.swing[k]:.3g} g"
        raise key_error(key, f"{text}, not 1 g; {cause}", names=(given[k],))


def _is_possible(swing: Array) -> bool:
    return bool(((swing > _SWING[0]) & (swing < _SWING[1])).all())


def _causes(
    readings: Array, steps: Sequence[Index], found: _Sines, wanted: Sequence[float]
) -> Iterator[str]:
    """Yield what is wrong if the readings, (r, m) in SI, show it, with the most likely first."""
    angle = np.array([step.angle for step in steps])
    if found.follows and np.ptp(found.off) < _PHASE and abs(found.off[0]) < _OPPOSITE - _PHASE:
        yield f"the head's zero, or the mounting, is turned by {abs(found.off.mean()):.0f}°"
    changes = np.flatnonzero(np.abs(np.diff(angle)) > _SAME) + 1
    rows: list[int] = max(np.split(np.arange(len(angle)), changes), key=len).tolist()
    if len(rows) >= _FROZEN and (np.ptp(readings[rows], axis=0) > _MOVED * G0).any():
        span = f"from {steps[rows[0]].label} to {steps[rows[-1]].label}"
        yield f"the angle is constant {span}, but the readings change"
    gon = _fit_sines(_GON * angle, readings, wanted)
    if gon and gon.is_right:
        yield "the angles seem to be in gon (400 per turn); convert them to degrees"
    yield from _wrong_pass(readings, steps, wanted)


def _wrong_pass(readings: Array, steps: Sequence[Index], wanted: Sequence[float]) -> Iterator[str]:
    """Yield which pass is wrong if it is only one, and what would make it right if known."""
    angle, numbers = np.array([step.angle for step in steps]), np.array(pass_numbers(steps))
    passes = [np.flatnonzero(numbers == k) for k in np.unique(numbers)]
    fits = [_fit_sines(angle[own], readings[own], wanted) for own in passes]
    wrong = [own for own, fit in zip(passes, fits, strict=True) if fit and not fit.is_right]
    if len(wrong) != 1 or not any(fit and fit.is_right for fit in fits):
        return
    own: list[int] = wrong[0].tolist()
    place = f"only the pass from {steps[own[0]].label} to {steps[own[-1]].label} is wrong"
    ways = {
        "; its angles fit in the opposite order": (angle[own[::-1]], readings[own]),
        "; its readings fit with the opposite sign": (angle[own], -readings[own]),
        "; its readings are in another unit": (angle[own], readings[own] / np.ptp(readings[own])),
    }
    tried = {way: _fit_sines(*data, wanted) for way, data in ways.items()}
    able = {way: fit for way, fit in tried.items() if fit and fit.follows}
    way = min(able, key=lambda way: np.abs(able[way].off).max(), default="")
    yield place + (way if way and np.abs(able[way].off).max() < _PHASE else "")


def largest_reading_angles(sensor: Sensor) -> list[float]:
    """Return the angle of the head at which each accelerometer has its largest reading, °."""
    x, y, _ = sensor.input_axes("f").T
    return (np.degrees(np.arctan2(x, y)) % 360).tolist()
