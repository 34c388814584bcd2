"""Both filters over one track, and the estimate that they make together."""

from collections.abc import Mapping, Sequence
from itertools import chain
from math import hypot
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable import Turntable
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian
from inercal.methods.turntable import model
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable_kalman.accelerometers import STILL, Accelerometers
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.methods.turntable_kalman.innovations import Filtered, excess, group, least, told
from inercal.recording import Observations, Track
from inercal.sensors import Sensor

Array = NDArray[np.float64]
_SOURCES_STILL = 1e-3  # m/s


class Way(NamedTuple):
    """Which states the filters have, and how far attitude and velocity at rest are trusted."""

    drifting: bool
    table: bool  # right angles and harmonics in the gyros' filter
    holding_table: Literal["whole", "lean", "exact"]  # in the accelerometers'
    source: tuple[float, float] | None  # rad, of the attitude in each filter; None is the bench's
    still: float  # m/s


WAYS: Mapping[str, Way] = {
    "full": Way(True, True, "whole", None, STILL),
    "drift": Way(True, False, "lean", (4 * ARCSEC, ARCSEC), _SOURCES_STILL),
    "paper": Way(False, False, "exact", (10 * ARCSEC, 10 * ARCSEC), _SOURCES_STILL),
}


def gyros(
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    way: Way,
    priors: Sequence[Gaussian] = (),
    *,
    smooth: bool = False,
) -> Filtered:
    """Run the gyros' filter over one trial's track, and back where that is wanted."""
    readback = way.source[0] if way.source else hypot(bench.white, model.FLOOR)
    p = len(sensor.only("w").coefficients)
    made = Gyros.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.table, readback=readback,
    )  # fmt: skip
    state, course = made.step(made.start(track), track, made.varying if smooth else ())
    value = state.x[3:].copy()
    value[:p] += state.theta
    return Filtered(
        made.part, course.names, value, state.p[3:, 3:], course,
        state.nis, 3 * state.epochs, least(track), "rad",
        _blind(readback if way.source else None), np.zeros((p, p)),
    )  # fmt: skip


def accelerometers(
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    way: Way,
    priors: Sequence[Gaussian] = (),
    *,
    smooth: bool = False,
) -> Filtered:
    """Run the accelerometers' filter over one trial's track, and back where that is wanted."""
    readback = way.source[1] if way.source else None
    made = Accelerometers.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.holding_table, readback=readback, still=way.still,
    )  # fmt: skip
    state, course = made.step(made.start(track), track, made.varying if smooth else ())
    p, g = len(made.first), bench.gravity
    value = state.x[6:].copy()
    value[:p] = state.theta
    along = model.of_gravity(made.part) * g.sd / g.value
    return Filtered(
        made.part, course.names, value, state.p[6:, 6:], course,
        state.nis, 5 * state.epochs, least(track), "m/s", _blind(readback),
        np.outer(along, along),
    )  # fmt: skip


def _blind(readback: float | None) -> str:
    if readback is None:
        return ""
    return f"R of the source, {readback / ARCSEC:.3g}″, is not that of the noise"


def followed(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    priors: Sequence[Gaussian],
    way: Way,
) -> Estimate:
    """Return the estimate of both filters, one trial after the other.

    Raises
    ------
    InputError
        No track, no rest at its start, a sensor that the filters do not take, or a prior that joins
        gyros and accelerometers.
    NotObserved
        Directions that the run does not decide.
    """
    track = observations.track
    if track is None:
        raise InputError("the filters follow a recording; means of positions are not enough")
    kinds = {axis.measures for axis in sensor.axes}
    _require_apart(sensor, priors)
    runs = [run for kind, run in (("w", gyros), ("f", accelerometers)) if kind in kinds]
    lead = track.reading.shape[:-2]
    trials = [
        # Of several trials the first one's course is kept.
        [
            run(sensor, bench, track.trial(*index), way, priors, smooth=not any(index))
            for run in runs
        ]
        for index in np.ndindex(*lead)
    ]
    for one in chain.from_iterable(trials):
        _require_decided(one)
    names = _names(sensor, trials[0])
    made = [_together(names, trial) for trial in trials]
    q, p = len(names), len(sensor.coefficients)
    value = np.array([one[0] for one in made]).reshape(*lead, q)
    covariance = np.array([one[1] for one in made]).reshape(*lead, q, q)
    chi2 = np.array([one[2] for one in made]).reshape(lead)
    scaled = made[0][1][:p, :p]
    known = np.linalg.eigvalsh(scaled / np.outer(sensor.natural, sensor.natural))
    return Estimate(
        names=names,
        value=value,
        covariance=covariance,
        chi2=chi2,
        dof=sum(one.components for one in trials[0]),
        residual=np.zeros(0),
        whitened=np.zeros(0),
        observations=(),
        wanted=sensor.coefficients,
        rank=p,
        singular_values=1 / np.sqrt(known),
        null_directions=(),
        weakest=None,
        converged=np.ones(lead, dtype=bool),
        iterations=np.ones(lead, dtype=np.intp),
        groups=tuple(group(one, observations) for one in trials[0]),
        notes=tuple(told(one) for one in trials[0]),
        courses=tuple(one.course for one in trials[0]),
    )


def _require_apart(sensor: Sensor, priors: Sequence[Gaussian]) -> None:
    """Refuse a prior that joins both triads: each filter would leave it out."""
    kind = {axis.name: axis.measures for axis in sensor.axes}
    for prior in priors:
        touched = {kind[name.partition(".")[0]] for name in prior.names}
        if len(touched) > 1:
            raise InputError(
                f"prior on {', '.join(prior.names)}: the filters find gyros and accelerometers "
                "apart; give priors of each by themselves, or use turntable_trajectory"
            )


def _require_decided(one: Filtered) -> None:
    p = len(one.part.sensor.coefficients)
    free = model.undecided(one.part, one.covariance[:p, :p])
    if free:
        words = tuple(direction.words for direction in free)
        raise NotObserved(
            f"not observed: the run decides {p - len(free)} of {p} coefficients of the "
            f"{one.course.name}; it leaves open, in units of g and rad/s: {'; '.join(words)}; turn "
            "about each axis with the readback all along, hold more attitudes, or give priors",
            words,
        )


def _names(sensor: Sensor, parts: Sequence[Filtered]) -> tuple[str, ...]:
    """Return the coefficients in the sensor's order, then the table's parameters."""
    others = [name for one in parts for name in one.names if _of_table(name)]
    return (*sensor.coefficients, *dict.fromkeys(others))


def _of_table(name: str) -> bool:
    """Whether a state is a parameter of the table for the whole run."""
    return "." not in name and not name.startswith(("drift[", "hold_"))


def _together(names: tuple[str, ...], parts: Sequence[Filtered]) -> tuple[Array, Array, float]:
    """Return value and covariance in order, by both filters as independent, and the sum of NIS."""
    value, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for one in parts:
        own = [k for k, name in enumerate(one.names) if name in names]
        at = [names.index(one.names[k]) for k in own]
        value[at] = one.value[own]
        covariance[np.ix_(at, at)] = excess(one) * one.covariance[np.ix_(own, own)]
        # Innovations say nothing of an error that all of them share.
        first = at[: len(one.added)]
        covariance[np.ix_(first, first)] += one.added
    return value, covariance, sum(one.nis for one in parts)
