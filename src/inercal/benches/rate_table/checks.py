"""Check the unit of a rate table's rates and the sensor's axes against the readings."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.arm_units import fitting_arm_unit
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.settings import RateTableData
from inercal.physics.plan import Spin
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import G0
from inercal.physics.sensors.affine import AffineModel
from inercal.recordings import Observations, Recording
from inercal.recordings.data import RunBase
from inercal.recordings.segments.dwells import ARM_RATE

_OFF = 0.2  # largest relative error of a norm, after correction by a rough model of the triad
_USABLE = (0.5, 2.0)  # times nominal: range of scale factors if the run file is correct
_DETERMINED = 0.05  # times the largest singular value: below this, a triad is not determined
_ALIKE = 1e-3  # g: smaller residuals have equal weight
_REWEIGHTED = 20
_FEWEST = 4  # states needed to identify the axes
_FAST = 0.9  # times the fastest rate: samples above this show the unit


def require_unit(run: RunBase[RateTableData], recording: Recording, bench: RateTable) -> None:
    """Refuse a recording whose samples at the fastest rate do not fit the stated unit.

    Parameters
    ----------
    run : Run
    recording : Recording
        Recording with the readback "arm_rate", converted to rad/s with the stated unit.
    bench : RateTable

    Raises
    ------
    InputError
        Another unit fits; the message names it.
    """
    rate = np.abs(recording.readback[ARM_RATE])
    fast = rate > _FAST * rate.max()
    if not fast.any():
        return
    columns = [recording.channels.index(name) for name in run.sensor.channels]
    read = np.linalg.norm(run.sensor.to_si(recording.data[fast][:, columns]), axis=-1)

    def off(times: float) -> float:
        result = np.hypot(bench.radius.value * (rate[fast] * times) ** 2, bench.gravity.value)
        return float(abs(np.median(read / result) - 1))

    if off(1.0) > _OFF:
        _refuse_unit(run, bench, off)


def _refuse_unit(
    run: RunBase[RateTableData], bench: RateTable, off: Callable[[float], float]
) -> None:
    """Refuse a rate or radius that fits another unit; `off` is as in `fitting_arm_unit`."""
    unit, left = fitting_arm_unit(run, bench.radius.value, off)
    if left < _OFF / 2:
        raise unit.error(run)


def _nominal_force(bench: RateTable, steps: Sequence[Spin], times: float = 1.0) -> Array:
    """Return the nominal specific force at the rates multiplied by a factor, (r, 3) m/s²."""
    return sensed_motion(bench, [replace(step, rate=step.rate * times) for step in steps], {}).f


def _fit_triad(read: Array, nominal: Array) -> AffineModel | None:
    """Fit a rough model of the triad, M a + p = f in m/s², by least absolute deviations.

    A sensor as delivered may have a bias of 0.3 g and a scale factor 20 % off. The checks use the
    residuals of this model, so that they detect only mistakes. One wrong row has little effect on a
    fit by least absolute deviations.

    Parameters
    ----------
    read, nominal : (r, 3) arrays
        Readings and nominal specific force, m/s².

    Returns
    -------
    AffineModel or None
        The model; None if the rows do not determine it, or no usable sensor can have it.
    """
    columns = np.concatenate([nominal, np.full((len(nominal), 1), G0)], axis=-1)
    size = np.linalg.svd(columns, compute_uv=False)
    if len(columns) < columns.shape[1] or size[-1] < _DETERMINED * size[0]:
        return None
    weight = np.ones(len(read))
    solved = np.zeros((4, 3))
    for _ in range(_REWEIGHTED):
        root = np.sqrt(weight)[:, None]
        solved = np.linalg.lstsq(root * columns, root * read, rcond=None)[0]
        residual = np.linalg.norm(read - columns @ solved, axis=-1)
        weight = 1 / np.maximum(residual, _ALIKE * G0)
    scale = np.linalg.svd(solved[:3], compute_uv=False)
    if scale[-1] < _USABLE[0] or scale[0] > _USABLE[1]:
        return None
    return AffineModel(np.asarray(solved[:3].T, dtype=float), solved[3] * G0).inverse


def require_rates(
    run: RunBase[RateTableData], observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse rates if the norms of the readings show that their unit is wrong.

    The readings are first corrected with a rough model of the triad.
    """
    turning = np.array([step.rate != 0 for step in steps])
    if not turning.any():
        return

    def norms(times: float) -> tuple[Array, Array]:
        result = _nominal_force(bench, steps, times)
        model = _fit_triad(observations.mean, result)
        read = observations.mean if model is None else model.correct(observations.mean)
        return np.linalg.norm(read, axis=-1), np.linalg.norm(result, axis=-1)

    def off(times: float) -> float:
        read, result = norms(times)
        return float(np.max(np.abs(read / result - 1)[turning]))

    if off(1.0) <= _OFF:
        return
    _refuse_unit(run, bench, off)
    read, result = norms(1.0)
    worst = int(np.argmax(np.abs(read / result - 1) * turning))
    raise InputError(
        f"{run.path}: {steps[worst].label}: the readings' norm is {read[worst]:.4g} m/s², but "
        f"radius and rate give {result[worst]:.4g} m/s²; check arm_rate_unit, [bench] radius and "
        "the scale in [sensor.accelerometer]",
        file=run.path,
        names=(steps[worst].label,),
    )


def require_axes(
    run: RunBase[RateTableData], observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse columns that fit far better in another order or with another sign."""
    if len(steps) < _FEWEST:
        return
    result, read = _nominal_force(bench, steps), observations.mean
    model = _fit_triad(read, result)
    if model is not None:
        # A bias does not show a wrong axis, so compare only the directions of the axes.
        read = read - model.inverse.offset
    fits = {
        (order, signs): float(np.sum((read[:, order] * np.array(signs) - result) ** 2))
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    }
    straight, best = fits[(0, 1, 2), (1, 1, 1)], min(fits, key=lambda key: fits[key])
    if fits[best] < straight / 10 and best != ((0, 1, 2), (1, 1, 1)):
        given = run.data.accelerometer
        order = ", ".join(f"{'−' * (s < 0)}{given[k]}" for k, s in zip(*best, strict=True))
        raise key_error(
            "[data] accelerometer",
            f"the readings fit the mountings as x, y, z = {order}, not as "
            f"{', '.join(map(str, given))}; check the order of the columns and the mounting of the "
            "sensor",
            run.path,
            tuple(order.split(", ")),
        )
