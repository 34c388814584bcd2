"""Check readings on a dividing head: level, autocollimator and repeated positions."""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.basics.units import format_quantity
from inercal.benches.dividing_head.bench import DividingHead, bench_covariance, sensed_motion
from inercal.benches.dividing_head.passes import (
    CARDINAL_ANGLES,
    first_visit_rows,
    matches_any_angle,
    pass_numbers,
    rows_without_series,
)
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.physics.motion import Motion
from inercal.physics.plan import Index
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations
from inercal.recordings.data import RunBase

_LARGEST = 3e-3  # rad, 10′: the range of levels and autocollimators
_ALONE = 8.0  # an outlier is this many times the usual difference between passes
_STATED = 4.0  # and this many standard deviations of a difference due to noise and bench
_REPEATED = 4  # repeated positions needed to determine the usual difference
_NORMAL = 1.4826  # standard deviation over median absolute deviation for a normal distribution


def require_usable_readings(
    run: RunBase[DividingHeadData], bench: DividingHead, steps: Sequence[Index]
) -> None:
    """Refuse readings that [bench] ignores, or whose unit is wrong.

    Readings beyond the range of a level or an autocollimator have the wrong unit.

    Raises
    ------
    InputError
        A reading is ignored or out of range.
    """
    read = [step.angle for step in steps if step.reading]
    if bench.collimated == "none" and read:
        mode = "pairs" if all(matches_any_angle(a, CARDINAL_ANGLES) for a in read) else "every"
        raise key_error(
            "[bench] autocollimation",
            f'is "none", but {run.data.autocollimator} has readings at {len(read)} of {len(steps)} '
            f'positions; state "{mode}", or remove [data] autocollimator if they are not to be '
            "used",
        )
    for key, name in (("level", "level"), ("autocollimator", "reading")):
        values = [getattr(step, name) for step in steps]
        worst = max(range(len(values)), key=lambda k: abs(values[k]))
        if abs(values[worst]) > _LARGEST:
            raise key_error(
                f"[data] {key}",
                f"the reading at {steps[worst].label} is {values[worst] * 180 / pi * 60:.3g}′, "
                f"beyond the range of the instrument (10′); check {key}_unit",
                names=(steps[worst].label,),
            )


def repeat_visit_warnings(
    observations: Observations, sensor: Sensor, bench: DividingHead, steps: Sequence[Index]
) -> tuple[Finding, ...]:
    """Return a warning for each position whose repeats differ far more than at other positions.

    After correction for level and autocollimator, the readings at one position differ between
    passes only by drift, so a mistyped number is an outlier. An outlier must also exceed the stated
    standard deviations of single readings, because the autocollimator is read again in each pass
    and positions that are trimmed with it differ more than others.

    Parameters
    ----------
    observations : Observations
        Observations from one recording or table.
    sensor : Sensor
    bench : DividingHead
    steps : sequence of Index
        The step of each observation.
    """
    nominal = sensor.forward(
        Motion(sensed_motion(bench, steps, {}).f), np.zeros(len(sensor.coefficients))
    )
    left = observations.mean - nominal
    first, which = first_visit_rows(steps), pass_numbers(steps)
    plain = set(rows_without_series(steps))
    couples = [
        (j, k)
        for k, j in enumerate(first)
        if j != k and which[j] != which[k] and plain.issuperset((j, k))
    ]
    if len(couples) < _REPEATED:
        return ()
    r, m = observations.mean.shape
    own = bench_covariance(sensor.with_coefficients(), bench, steps, gravity=False).reshape(
        r, m, r, m
    )
    variance = np.diagonal(observations.covariance, axis1=-2, axis2=-1)
    found: list[Finding] = []
    for c, channel in enumerate(sensor.channels):
        changes = np.array([left[k, c] - left[j, c] for j, k in couples])
        change = changes - np.median(changes)
        of_bench = own[:, c, :, c]
        noise = np.sqrt(np.array([variance[j, c] + variance[k, c] for j, k in couples]))
        turned = [of_bench[j, j] + of_bench[k, k] - 2 * of_bench[j, k] for j, k in couples]
        stated = np.sqrt(noise**2 + np.array(turned))
        usual = np.maximum(_NORMAL * np.median(np.abs(change)), noise)
        beyond = np.abs(change) > np.maximum(_ALONE * usual, _STATED * stated)
        rows = zip(couples, change.tolist(), usual.tolist(), beyond.tolist(), strict=True)
        for (j, k), size, limit, alone in rows:
            if alone:
                text = (
                    f"{channel} differs by {_format_in_g(size)} between {steps[j].label} and "
                    f"{steps[k].label}, which are the same position; differences at other "
                    f"positions are about {_format_in_g(limit)}; check these two rows"
                )
                found.append(Finding("warning", "passes", text, channel))
    return tuple(found)


def _format_in_g(size: float) -> str:
    return format_quantity(abs(size), 0.0, "µg", 3)
