"""Checks of a rate table's states against what the readings say: the rates' unit, the axes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from inercal.benches import RateTable
from inercal.benches.rate_table import felt
from inercal.errors import InputError
from inercal.pipeline.inputs import readback_units
from inercal.plan import Spin
from inercal.recording import Observations, Recording
from inercal.runfile import Run
from inercal.segments.dwells import ARM_RATE
from inercal.units import factor

Array = NDArray[np.float64]
_OFF = 0.2  # of a norm: no scale factor, bias or cross-axis term of a usable sensor makes it so
_UNITS = ("rad/s", "rpm", "rev/s", "°/s")
_FEWEST = 4  # states that tell which axis is which
_FAST = 0.9  # of the fastest rate: samples that tell the unit


def require_unit(run: Run, recording: Recording, bench: RateTable) -> None:
    """Refuse a recording whose samples at the fastest rate tell another unit than stated.

    Parameters
    ----------
    run : Run
    recording : Recording
        With readback "arm_rate", rad/s by the stated unit.
    bench : RateTable

    Raises
    ------
    InputError
        Naming the unit that fits.
    """
    rate = np.abs(recording.readback[ARM_RATE])
    fast = rate > _FAST * rate.max()
    if not fast.any():
        return
    columns = [recording.channels.index(name) for name in run.sensor.channels]
    read = np.linalg.norm(run.sensor.to_si(recording.data[fast][:, columns]), axis=-1)

    def off(times: float) -> float:
        made = np.hypot(bench.radius.value * (rate[fast] * times) ** 2, bench.gravity.value)
        return float(abs(np.median(read / made) - 1))

    if off(1.0) > _OFF:
        _refuse_unit(run, off)


def _refuse_unit(run: Run, off: Callable[[float], float]) -> None:
    """Refuse rates in another unit; `off` is how far norms are off at rates times as large."""
    given = readback_units(run)["arm_rate"]
    for unit in _UNITS:
        if off(factor(unit, "rad/s") / given) < _OFF / 2:
            raise InputError(
                f"{run.path}: [data] arm_rate_unit: by the norms of the readings the rates are in "
                f'{unit}, not in {run.data.arm_rate_unit}; state arm_rate_unit = "{unit}"'
            )


def _made(bench: RateTable, steps: Sequence[Spin], times: float = 1.0) -> Array:
    """Return what is felt nominally, (r, 3) m/s², at rates `times` as large."""
    return felt(bench, [replace(step, rate=step.rate * times) for step in steps], {}).f


def require_rates(
    run: Run, observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse rates in another unit than stated: the norms of the readings tell."""
    turning = np.array([step.rate != 0 for step in steps])
    if not turning.any():
        return
    read = np.linalg.norm(observations.mean, axis=-1)

    def off(times: float) -> float:
        made = np.linalg.norm(_made(bench, steps, times), axis=-1)
        return float(np.max(np.abs(read / made - 1)[turning]))

    if off(1.0) <= _OFF:
        return
    _refuse_unit(run, off)
    made = np.linalg.norm(_made(bench, steps), axis=-1)
    worst = int(np.argmax(np.abs(read / made - 1) * turning))
    raise InputError(
        f"{run.path}: {steps[worst].label}: the readings' norm is {read[worst]:.4g} m/s² where "
        f"radius and rate make {made[worst]:.4g}; look at arm_rate_unit, [bench] radius and the "
        "scale in [sensor.accelerometer]"
    )


def require_axes(
    run: Run, observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse columns that are exchanged or reversed: they fit far better otherwise."""
    if len(steps) < _FEWEST:
        return
    made, read = _made(bench, steps), observations.mean
    fits = {
        (order, signs): float(np.sum((read[:, order] * np.array(signs) - made) ** 2))
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    }
    straight, best = fits[(0, 1, 2), (1, 1, 1)], min(fits, key=lambda key: fits[key])
    if fits[best] < straight / 10 and best != ((0, 1, 2), (1, 1, 1)):
        given = run.data.accelerometer
        order = ", ".join(f"{'−' * (s < 0)}{given[k]}" for k, s in zip(*best, strict=True))
        raise InputError(
            f"{run.path}: [data] accelerometer: the readings fit the mountings as x, y, z = "
            f"{order}, not as {', '.join(map(str, given))}: look at the columns' order and at how "
            "the sensor was mounted"
        )
