"""Compute the effect of the level earth rate, which rotates in the case while the table turns.

The change within a section follows from the rate of the table, except for the azimuth at its start.
It is neither noise nor a disturbance, so it is subtracted before the samples of a section are
judged. With h = (h₁, h₂) at the start of a section and s(t) the readings for unit h₁ and h₂ without
their mean, h minimises

    Σ (y − s h)²/σ² + 2 |h|²/(ω_ie cos φ)²

over all sections in a setting, because they are to start at the same azimuth. σ is the noise of a
sample, from the differences between neighbouring samples. If a section of at least one turn fits
another azimuth, with |h| = ω_ie cos φ, clearly better, this azimuth is used.
"""

from collections.abc import Callable, Sequence
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.sensors import Sensor
from inercal.recordings import Mark, Recording

_UNITS = np.eye(3)
_WHOLE = 0.99  # turns
_BETTER = 14.0  # drop of χ², 3.7σ
_TINY = 1e-12  # rad/s: no sensor has less noise, and the level earth rate at a pole is smaller


def perpendicular_axes(axis: str) -> tuple[Array, Array]:
    """Return the two case axes that follow an axis in the cycle x, y, z."""
    j = "xyz".index(axis[-1])
    return _UNITS[(j + 1) % 3], _UNITS[(j + 2) % 3]


def level_rate_factor(step: RateDwell) -> tuple[float, float]:
    """Return the sensed fraction of the horizontal earth rate, sinc(Θ/2), and Θ/2 in rad."""
    if step.rate == 0:
        return 1.0, 0.0
    half = step.rate * step.seconds / 2
    if half == 0:
        return 0.0, 0.0  # an unknown number of whole turns
    return float(np.sinc(half / pi)), half


def level_earth_rate(step: RateDwell, time: Array) -> Array:
    """Return the horizontal earth rate in the case for h = (1, 0) and (0, 1), (n, 3, 2).

    Parameters
    ----------
    step : RateDwell
    time : (n,) array
        Time from the start of the dwell, s.
    """
    angle = step.rate * time * (-1 if step.axis.startswith("-") else 1)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    first, second = perpendicular_axes(step.axis)
    return np.stack([c * first - s * second, s * first + c * second], axis=-1)


def level_rate_changes(
    latitude: Measured | None,
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    steps: Sequence[PlatformStep],
) -> Callable[[str], Array | float]:
    """Return a function that returns the changes within the section with a label, (n, m) rad/s.

    The changes have a mean of zero. They are 0 for rests, poses and turns by an angle.

    Parameters
    ----------
    latitude : Measured or None
        Latitude, rad.
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    marks, steps : sequences of r Mark and PlatformStep
    """
    level = earth_rate_up_north(latitude.value)[1] if latitude else 0.0
    columns = [recording.channels.index(name) for name in sensor.channels]
    axes = np.array([axis.i if axis.measures == "w" else (0.0, 0.0, 0.0) for axis in sensor.axes])
    settings: dict[str, list[tuple[Mark, RateDwell]]] = {}
    for mark, step in zip(marks, steps, strict=True):
        if isinstance(step, RateDwell) and step.rate and not isinstance(step, KnownTurn):
            settings.setdefault(step.place, []).append((mark, step))

    def unit_changes(mark: Mark, step: RateDwell) -> Array:
        time = recording.time[mark.start : mark.stop] - recording.time[mark.start]
        changes: Array = axes @ level_earth_rate(step, time + 0.5 / recording.rate_hz)
        return changes - changes.mean(axis=0)

    known: dict[str, Array] = {}
    at = {mark.label: (mark, step) for own in settings.values() for mark, step in own}
    for own in settings.values() if level > _TINY else ():
        grams, products = np.zeros((len(own), 2, 2)), np.zeros((len(own), 2))
        for k, (mark, step) in enumerate(own):
            read = sensor.to_si(recording.data[mark.start : mark.stop, columns])
            unit = unit_changes(mark, step)
            weighted = unit / (np.diff(read, axis=0).var(axis=0) / 2 + _TINY**2)[:, None]
            grams[k] = np.einsum("nmj,nmk->jk", weighted, unit)
            products[k] = np.einsum("nmj,nm->j", weighted, read)
        prior = 2 / level**2 * np.eye(2)
        gram, product = prior + grams.sum(axis=0), products.sum(axis=0)
        common: Array = np.asarray(np.linalg.solve(gram, product), dtype=float)
        for (mark, step), gram, product in zip(own, grams, products, strict=True):
            alone = np.linalg.solve(prior + gram, product)
            alone *= level / (np.hypot(*alone) + _TINY**2)
            drop = float((common - alone) @ (gram @ (common + alone) - 2 * product))
            turned = abs(step.rate) * step.seconds > _WHOLE * 2 * pi
            known[mark.label] = alone if turned and drop > _BETTER else common
    return lambda label: unit_changes(*at[label]) @ known[label] if label in known else 0.0
