"""Readings against the angle of a dividing head: its errors are nuisances, or it is exact."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.dividing_head.bench import DividingHead, drift_names, sensed_motion
from inercal.benches.dividing_head.bench import positions as on_head
from inercal.benches.dividing_head.head_angles import angles
from inercal.benches.dividing_head.passes import pass_names, ramps
from inercal.errors import InputError
from inercal.estimate import Gaussian, Problem
from inercal.keys import CoefficientName
from inercal.methods import candidates, vectors
from inercal.parameters import Parameter
from inercal.plan import Index
from inercal.recording import Observations
from inercal.sensors import Sensor

FEWEST = 4  # positions
_HARMONICS = 4  # of the head's error: higher ones look like graduations
# Along the spindle only its lean is felt, and kpp is k0 less k2: sin² + cos² = 1.
_HIDDEN = {"delta_p", "kio", "kpo", "koo", "kpp"}
_NEAR = 1.5e-4  # rad


def plan(positions: int = 12, reverse: bool = True, seconds: float = 60.0) -> tuple[Index, ...]:
    """Return evenly spaced positions of the head, forward and back.

    Parameters
    ----------
    positions : int
        Of one turn.
    reverse : bool
        Whether the turn is made back too: a drift of the bias then cancels to first order.
    seconds : float
        Length of each hold, s.

    Raises
    ------
    InputError
        Fewer than four positions.
    """
    if positions < FEWEST:
        raise InputError(f"{positions} positions; a tumble needs {FEWEST} or more")
    return on_head(positions, reverse=reverse, seconds=seconds)


def problem(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
    *,
    exact: bool = False,
) -> Problem:
    """Return the problem of all readings.

    Parameters
    ----------
    observations : Observations
        (..., r, m), m/s².
    sensor : Sensor
        Of m accelerometers.
    bench : DividingHead
    steps : sequence of r Index
    priors : sequence of Gaussian
        On coefficients.
    exact : bool
        Whether the bench is taken at its declared values, without nuisances.
    """
    declared = {} if exact else bench.nuisances(steps, sensor)

    def built(sensor: Sensor, bench: DividingHead, declared: Mapping[str, Parameter]) -> Problem:
        return vectors.problem(
            observations,
            sensor,
            declared,
            lambda q: bench.mean_motion(steps, q),
            added=_drifts(sensor, steps),
        )

    larger = larger_sensor(sensor, warmed=observations.warmed)
    wider = replace(
        bench, harmonics=(*bench.harmonics, *[0.0] * (_HARMONICS - len(bench.harmonics)))
    )
    suspects = {
        name: parameter
        for name, parameter in wider.nuisances(steps, sensor).items()
        if name != "lean"  # of second order: its column is that of its own estimate
    }
    asked = built(sensor, bench, declared)
    return replace(
        asked,
        priors=(*asked.priors, *priors),
        candidates=candidates.of_means(
            lambda: built(larger, wider, candidates.freed(suspects)),
            asked.names,
            larger,
            suspects,
            families=_families(sensor, bench, steps),
            told=[name for prior in priors for name in prior.names],
        ),
    )


def larger_sensor(sensor: Sensor, *, warmed: bool = False) -> Sensor:
    """Return the sensor with all coefficients that readings in the plane of rotation can show.

    Those of temperature only where it is known and varies, `warmed`.
    """
    whole = candidates.extended(sensor, warmed=warmed)
    kept = (
        name
        for name in whole.coefficients
        if name in sensor.coefficients or CoefficientName(name).term not in _HIDDEN
    )
    return replace(whole, coefficients=tuple(kept))


def _families(
    sensor: Sensor, bench: DividingHead, steps: Sequence[Index]
) -> dict[str, tuple[str, ...]]:
    """Return what is tested together: a harmonic's sine and cosine, a drift in all passes."""
    count = max(_HARMONICS, len(bench.harmonics))
    made: dict[str, tuple[str, ...]] = {
        f"harmonic {h}": (f"sin{h}", f"cos{h}") for h in range(1, count + 1)
    }
    made["creep"] = tuple(f"creep[{name}]" for name in pass_names(steps))
    drifts = {f"drift of {c}": tuple(drift_names(c, steps)) for c in sensor.channels}
    if len(drifts) > 1:
        made["drift"] = tuple(name for names in drifts.values() for name in names)
    return made | drifts


def as_stated(
    observations: Observations, sensor: Sensor, bench: DividingHead, steps: Sequence[Index]
) -> Observations:
    """Return the readings as they would be at the head's stated angles, for formulas of these.

    To first order in what level, autocollimator and certificate tell beyond them, at the nominal
    sensor: at 10″ their products with a mounting angle of 100″ leave 2e-8 g.

    Raises
    ------
    InputError
        More than 30″ beyond.
    """
    beyond = angles(bench, steps).nominal - np.array([step.angle for step in steps])
    beyond = (beyond + np.pi) % (2 * np.pi) - np.pi
    if np.abs(beyond).max() > _NEAR:
        worst = int(np.argmax(np.abs(beyond)))
        raise InputError(
            f"position {steps[worst].label} is known to stand {np.degrees(beyond[worst]):.3g}° "
            "beyond its angle, too far for formulas of the angles themselves; use joint"
        )
    made = sensed_motion(bench, steps, {})
    slope = sensor.slope(made.motion, np.zeros(len(sensor.coefficients)))[..., :3]
    turned = (slope @ made.df["base"][..., None])[..., 0]
    return replace(observations, mean=observations.mean - beyond[:, None] * turned)


def drifting(
    observations: Observations, bench: DividingHead, steps: Sequence[Index]
) -> Observations:
    """Return the observations with the drift of biases in their covariance, not as a nuisance."""
    if not bench.drift:
        return observations
    made = ramps(steps)
    between = bench.drift**2 * (made.T @ made)
    before = 0.0 if observations.drift is None else observations.drift
    channels = len(observations.channels)
    return replace(observations, drift=before + np.repeat(between[..., None], channels, axis=-1))


def _drifts(sensor: Sensor, steps: Sequence[Index]) -> dict[str, Array]:
    """Return what a drift of one does to all readings, (m r,), by its name."""
    found: dict[str, Array] = {}
    for k, channel in enumerate(sensor.channels):
        for name, ramp in zip(drift_names(channel, steps), ramps(steps), strict=True):
            column = np.zeros((len(steps), len(sensor.channels)))
            column[:, k] = ramp
            found[name] = column.ravel()
    return found
