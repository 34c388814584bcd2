"""What a changing temperature does to the readings within sections at rest.

A slow ramp moves a bias within a section, which is no noise. Over all sections each channel has two
slopes, of its bias and of its scale factor, found by least squares::

    y − ȳ = (a + b ȳ)(T − T̄) + noise

and what they explain is taken out before the noise is judged. The means stay as they are: what T̄
does to them the coefficients of temperature say. A section whose temperature ranges over less than
0.02 K has one: the noise of the temperature's sensor would explain as much of the readings' noise.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from inercal.arrays import Array

Sections = Callable[[], Iterable[Array]]
_STEADY = 0.02  # K


def remove_temperature_trend(sections: Sections, temperature: Sequence[Array]) -> Sections:
    """Return sections without what the temperature changes within them.

    Parameters
    ----------
    sections : callable
        Returns the r sections anew each time, (..., n, m) each.
    temperature : sequence of r (..., n) array
        Of their samples, K.
    """
    away = [_temperature_departure(kelvin) for kelvin in temperature]
    if not any(t.any() for t in away):
        return sections
    gram: Array = np.zeros((2, 2))
    product: Array = np.zeros(2)
    for y, t in zip(sections(), away, strict=True):
        mean = y.mean(axis=-2)
        by = np.stack([np.ones_like(mean), mean], axis=-1)  # (..., m, 2)
        square = (t**2).sum(axis=-1)[..., None, None, None]
        gram = gram + square * by[..., :, None] * by[..., None, :]
        product = product + (t[..., None] * (y - mean[..., None, :])).sum(axis=-2)[..., None] * by
    slopes = (np.linalg.pinv(gram) @ product[..., None])[..., 0]  # (..., m, 2)

    def without() -> Iterable[Array]:
        for y, t in zip(sections(), away, strict=True):
            slope = slopes[..., 0] + slopes[..., 1] * y.mean(axis=-2)
            yield y - t[..., None] * slope[..., None, :]

    return without


def _temperature_departure(kelvin: Array) -> Array:
    """Return the departure from the mean, (..., n) K; of sections at one temperature zero."""
    away = kelvin - kelvin.mean(axis=-1, keepdims=True)
    return np.where(np.ptp(kelvin, axis=-1, keepdims=True) > _STEADY, away, 0.0)
