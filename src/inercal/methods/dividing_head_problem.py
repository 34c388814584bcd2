"""Build estimation problems from readings at the angles of a dividing head.

The errors of the head are nuisances or zero.
"""

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_count
from inercal.benches.dividing_head.bench import DividingHead, drift_names, sensed_motion
from inercal.benches.dividing_head.bench import position_plan as on_head
from inercal.benches.dividing_head.characteristics import loop_columns
from inercal.benches.dividing_head.passes import (
    LEVEL_SCALE,
    READING_SCALE,
    drift_ramps,
    pass_names,
    pass_numbers,
    sensor_angles,
)
from inercal.estimation import Candidate, Problem
from inercal.estimation.scores import BIAS_STEP, CERTIFICATE, HYSTERESIS
from inercal.methods import Fit, Priors, Remarks, candidates, mean_problem
from inercal.physics.plan import Index, Indexings
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations

MIN_POSITIONS = 4  # positions
_TESTED_HARMONICS = 4  # of the head's error; higher harmonics act like graduation errors
_LARGEST_MOUNTING, _FAR = pi / 180, 10.0  # rad; times the stated zero of the head
_MAX_ANGLE_CORRECTION = 1.5e-4  # rad
_WRONG_UNIT = 50.0  # relative: readings in another unit, or with the other sign


def remarks(fit: Fit[DividingHead, Index]) -> Remarks:
    """Return a warning if a mounting angle is so large that it may be the zero of the head."""
    limit = max(_LARGEST_MOUNTING, _FAR * fit.bench.base)
    values = zip(fit.sensor.coefficients, fit.estimate.value.tolist(), strict=False)
    far = {name: value for name, value in values if "delta_o" in name and abs(value) > limit}
    if not far:
        return Remarks()
    angles = " and ".join(f"{name} = {value * 180 / pi:.3g}°" for name, value in far.items())
    text = (
        f"{angles} may be a wrong zero of the head: check the zero; if it may be wrong by as much, "
        "state it in [bench] base, because U includes only the stated base"
    )
    return Remarks((Finding("warning", "zero", text),))


def plan(
    positions: int = 12, reverse: bool = True, seconds: float = 60.0, warm_up: int = 0
) -> tuple[Index, ...]:
    """Return evenly spaced positions of the head, first forward and then back.

    Parameters
    ----------
    positions : int
        Number of positions in one turn.
    reverse : bool
        Whether the head also turns back; a drift of the bias then cancels to first order.
    seconds : float
        Duration of each position, s.
    warm_up : int
        Number of readings at the first position before, 12 or more, which show the warm-up drift.

    Raises
    ------
    InputError
        There are fewer than four positions.
    """
    if positions < MIN_POSITIONS:
        raise InputError(
            f"{format_count(positions, 'position')} {'is' if positions == 1 else 'are'} too few "
            f"for a tumble test; give {MIN_POSITIONS} or more",
            key="positions",
        )
    repeats = (Index(f"w{k:02d}", 0.0, seconds=seconds) for k in range(1, warm_up + 1))
    return (*repeats, *on_head(positions, reverse=reverse, seconds=seconds))


def head_problem(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
    *,
    exact: bool = False,
) -> Problem:
    """Return the estimation problem with all readings.

    Parameters
    ----------
    observations : Observations
        (..., r, m), m/s².
    sensor : Sensor
        Sensor with m accelerometers.
    bench : DividingHead
    steps : sequence of r Index
    priors : sequence of Gaussian
        Priors on coefficients.
    exact : bool
        Whether the bench has exactly its declared values, without nuisances.
    """
    wider = replace(
        bench, harmonics=(*bench.harmonics, *[0.0] * (_TESTED_HARMONICS - len(bench.harmonics)))
    )
    suspects = {
        name: parameter
        for name, parameter in wider.nuisances(steps, sensor).items()
        if name != "lean"  # a second-order effect, so its column would be its own estimate
    }
    for name, instrument, read in (
        (READING_SCALE, "autocollimator", any(step.reading for step in steps)),
        (LEVEL_SCALE, "level", len({step.level for step in steps}) > 1),
    ):
        if read:
            meaning = f"scale of the {instrument} readings"
            suspects[name] = Parameter(name, "1", 0.0, "run", 0.0, meaning)
    result = mean_problem.problem_of_readings(
        observations,
        sensor,
        {} if exact else bench.nuisances(steps, sensor),
        lambda q: wider.mean_motion(steps, q),
        priors,
        reading_columns=_drift_columns(sensor, steps),
        families=_test_families(sensor, bench, steps),
        suspects=suspects,
    )
    loops, others = _hysteresis_candidates(sensor, bench, steps), result.candidates
    loops += _certificate_candidates(sensor, bench, steps) + _step_candidates(sensor, steps)
    assert others is not None

    def with_loops(x: Array) -> list[Candidate]:
        scales = (READING_SCALE, LEVEL_SCALE)
        listed = [
            replace(one, largest=np.array([_WRONG_UNIT])) if one.name in scales else one
            for one in others(x)
        ]
        return [*listed, *loops]

    return replace(result, candidates=with_loops)


def _certificate_candidates(
    sensor: Sensor, bench: DividingHead, steps: Indexings
) -> list[Candidate]:
    """Return candidates for a certificate that begins at another face or has the other sign."""
    d, stated = bench.polygon, sensor_angles(bench, steps).nominal
    by_angle = _reading_by_angle(sensor, bench, steps)
    found: list[Candidate] = []
    for text, other in (
        ("with the other sign", tuple(-one for one in d)),
        ("shifted back by one face", (*d[1:], *d[:1])),
        ("shifted by one face", (*d[-1:], *d[:-1])),
    ):
        angle = sensor_angles(replace(bench, polygon=other), steps).nominal - stated
        rows, name = (angle[:, None] * by_angle).reshape(-1, 1), f"{CERTIFICATE} {text}"
        if rows.any():
            found.append(Candidate(name, "bench", (name,), ("",), rows, is_switch=True))
    return found


def _hysteresis_candidates(
    sensor: Sensor, bench: DividingHead, steps: Indexings
) -> list[Candidate]:
    """Return candidates for a hysteresis of the accelerometers, if both passes show it."""
    if len({step.sense for step in steps} - {0}) < len("±"):
        return []
    loops: list[candidates.Column] = []
    for k, (name, loop) in enumerate(loop_columns(sensor, bench, steps).items()):
        rows = np.zeros((len(steps), len(sensor.axes)))
        rows[:, k] = loop
        loops.append(candidates.Column(f"{HYSTERESIS}{name}", "m/s²", rows.ravel()))
    return candidates.together_and_alone("time", [(f"{HYSTERESIS}all accelerometers", loops)])


def _step_candidates(sensor: Sensor, steps: Indexings) -> list[Candidate]:
    """Return candidates for a change of the biases between two passes."""
    found: list[tuple[str, list[candidates.Column]]] = []
    for k, (before, after) in enumerate(pairwise(pass_numbers(steps)), start=1):
        if before == after:
            continue
        place = f"before {steps[k].label}"
        columns: list[candidates.Column] = []
        for c, channel in enumerate(sensor.channels):
            rows = np.zeros((len(steps), len(sensor.channels)))
            rows[:, c] = (np.arange(len(steps)) >= k) - (1 - k / len(steps))  # k0 is the mean bias
            name = f"{BIAS_STEP} of {channel} {place}"
            columns.append(candidates.Column(name, "m/s²", rows.ravel()))
        found.append((f"{BIAS_STEP} of all accelerometers {place}", columns))
    return candidates.together_and_alone("time", found)


def _test_families(
    sensor: Sensor, bench: DividingHead, steps: Indexings
) -> dict[str, tuple[str, ...]]:
    """Return the families for score tests: harmonics (sine and cosine) and drift in all passes."""
    count = max(_TESTED_HARMONICS, len(bench.harmonics))
    result: dict[str, tuple[str, ...]] = {
        f"harmonic {h}": (f"sin{h}", f"cos{h}") for h in range(1, count + 1)
    }
    result["creep"] = tuple(f"creep[{name}]" for name in pass_names(steps))
    drifts = {f"drift of {c}": tuple(drift_names(c, steps)) for c in sensor.channels}
    if len(drifts) > 1:
        result["drift"] = tuple(name for names in drifts.values() for name in names)
    return result | drifts


def readings_at_stated_angles(
    observations: Observations, sensor: Sensor, bench: DividingHead, steps: Indexings
) -> Observations:
    """Return readings corrected to the head's nominal angles, for formulas that assume these.

    The angles from the level, the autocollimator and the certificate are added to the nominal ones.
    The correction is of first order in these angles and uses the nominal sensor. At 10″ and a
    mounting angle of 100″ the remaining error is 2e-8 g.

    Raises
    ------
    InputError
        A position is more than 30″ from its nominal angle.
    """
    beyond = sensor_angles(bench, steps).nominal - np.array([step.angle for step in steps])
    beyond = (beyond + np.pi) % (2 * np.pi) - np.pi
    if np.abs(beyond).max() > _MAX_ANGLE_CORRECTION:
        worst = int(np.argmax(np.abs(beyond)))
        raise InputError(
            f"position {steps[worst].label} is {np.degrees(beyond[worst]):.3g}° from its nominal "
            "angle, but this estimator corrects at most 30″; use estimator joint",
            names=(steps[worst].label,),
        )
    turned = _reading_by_angle(sensor, bench, steps)
    return replace(observations, mean=observations.mean - beyond[:, None] * turned)


def _reading_by_angle(sensor: Sensor, bench: DividingHead, steps: Indexings) -> Array:
    result = sensed_motion(bench, steps, {})
    slope = sensor.slope(result.motion, np.zeros(len(sensor.coefficients)))[..., :3]
    return (slope @ result.df["base"][..., None])[..., 0]


def with_drift_covariance(
    observations: Observations, bench: DividingHead, steps: Indexings
) -> Observations:
    """Return the observations with bias drift in their covariance instead of as a nuisance."""
    if not bench.drift:
        return observations
    result = drift_ramps(steps)
    between = bench.drift**2 * (result.T @ result)
    before = 0.0 if observations.drift is None else observations.drift
    channels = len(observations.channels)
    return replace(observations, drift=before + np.repeat(between[..., None], channels, axis=-1))


def _drift_columns(sensor: Sensor, steps: Indexings) -> dict[str, Array]:
    """Return the effect of a unit drift on all readings, (m r,), by the drift's name."""
    result: dict[str, Array] = {}
    for k, channel in enumerate(sensor.channels):
        for name, ramp in zip(drift_names(channel, steps), drift_ramps(steps), strict=True):
            column = np.zeros((len(steps), len(sensor.channels)))
            column[:, k] = ramp
            result[name] = column.ravel()
    return result
