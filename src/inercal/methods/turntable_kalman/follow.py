"""Both filters over one track, and the estimate that they make together."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from itertools import chain
from math import radians
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from inercal.benches.turntable import Turntable
from inercal.errors import InputError, NotObserved
from inercal.estimate import Course, Estimate, Gaussian, Group
from inercal.estimate.spread import Spread
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman.accelerometers import STILL, Accelerometers
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.recording import Observations, Track
from inercal.sensors import Sensor

Array = NDArray[np.float64]
_ARCSEC = radians(1 / 3600)
_LEVEL = 0.95


class Way(NamedTuple):
    """Which states the filters have, and how far the table's attitude is trusted, rad."""

    drifting: bool
    table: bool  # right angles and harmonics in the gyros' filter
    holding_table: Literal["whole", "lean", "exact"]  # in the accelerometers'
    turning: float
    holding: float


WAYS: Mapping[str, Way] = {
    "full": Way(True, True, "whole", 4 * _ARCSEC, _ARCSEC),
    "drift": Way(True, False, "lean", 4 * _ARCSEC, _ARCSEC),
    "paper": Way(False, False, "exact", 10 * _ARCSEC, 10 * _ARCSEC),
}


class Filtered(NamedTuple):
    """What one filter made of one track; coefficients come first."""

    part: model.Triad
    names: tuple[str, ...]
    value: Array
    covariance: Array
    course: Course
    nis: float  # sum over its components
    components: int  # observed
    sd: float  # of the first ones, as stated
    unit: str


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
    made = Gyros.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.table, readback=way.turning,
    )  # fmt: skip
    state, course = made.step(made.start(track), track, made.varying if smooth else ())
    value = state.x[3:].copy()
    value[: len(made.first)] += state.theta
    return Filtered(
        made.part, course.names, value, state.p[3:, 3:], course,
        state.nis, 3 * state.epochs, way.turning, "rad",
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
    made = Accelerometers.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.holding_table, readback=way.holding,
    )  # fmt: skip
    state, course = made.step(made.start(track), track, made.varying if smooth else ())
    p, g = len(made.first), bench.gravity
    value, covariance = state.x[6:].copy(), state.p[6:, 6:].copy()
    value[:p] = state.theta
    along = model.of_gravity(made.part)
    covariance[:p, :p] += (g.sd / g.value) ** 2 * np.outer(along, along)
    return Filtered(
        made.part, course.names, value, covariance, course,
        state.nis, 5 * state.epochs, STILL, "m/s",
    )  # fmt: skip


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
        groups=tuple(_group(one, observations) for one in trials[0]),
        notes=tuple(_told(one) for one in trials[0]),
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
        covariance[np.ix_(at, at)] = _excess(one)[0] * one.covariance[np.ix_(own, own)]
    return value, covariance, sum(one.nis for one in parts)


def _excess(one: Filtered) -> tuple[float, float]:
    """Return what the innovations enlarge variances by, and the sd that is then added to them."""
    if one.components == 0 or one.nis <= chdtri(one.components, 1 - _LEVEL):
        return 1.0, 0.0
    ratio = one.nis / one.components
    return ratio, one.sd * float(np.sqrt(ratio - 1))


def _group(one: Filtered, observations: Observations) -> Group:
    """Return mean innovations by step of the run."""
    time, z = one.course.time, one.course.innovation[:, :3]
    labels: list[str] = []
    means: list[Array] = []
    for label, middle, seconds in zip(
        observations.labels, observations.time, observations.duration, strict=True
    ):
        at = np.abs(time - middle) <= seconds / 2
        if at.any():
            labels.append(label)
            means.append(z[at].mean(axis=0))
    residual = np.array(means).reshape(-1, 3)
    return Group(
        name=f"innovations of the {one.course.name}' filter, mean of each step",
        unit=one.unit,
        labels=tuple(labels),
        residual=residual,
        sd=np.full(residual.shape, one.sd),
        chi2=one.nis,
        dof=one.components,
        spread=Spread(excess=_excess(one)[1]),
    )


def _told(one: Filtered) -> str:
    """Say how the innovations agree with what was stated."""
    mean = one.nis / max(one.components, 1)
    said = f"{one.course.name}: the innovations' NIS is {mean:.2f} a component (1 is as stated)"
    if _excess(one)[1]:
        return f"{said}: beyond what noise and table allow"
    return f"{said}: within what noise and table allow"
