"""Simulate a plan in a temperature chamber, with true and recorded temperatures.

The chamber changes from one set temperature to the next at a given rate. The temperature T of the
sensing element follows the chamber with the time constant of the case. The recorded temperature R
follows T with the lag τ of the temperature sensor::

    τ_case dT/dt = T_chamber − T,     τ dR/dt = T − R

If there are soaks, the plan is carried out at each temperature after a wait at rest. If there is a
ramp, the chamber temperature changes while the plan is carried out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.benches.contract import SimulatedMotion
from inercal.benches.hand.bench import visit_number
from inercal.physics.motion import Motion
from inercal.recordings.data.recording_loader import number_repeated_names
from inercal.recordings.environment import ChamberProfile, Environment
from inercal.recordings.temperature import first_order_response

_Course = tuple[SimulatedMotion, Array, Indices, Indices]  # with temperature, soak and index


@dataclass(frozen=True, eq=False)
class ChamberRun:
    """A plan that is carried out in a chamber.

    Parameters
    ----------
    simulated_motion : SimulatedMotion
        Motion, including the waits at rest, with ΔT and dT/dt of the sensing element.
    recorded : (trials, n) array
        Recorded temperature, K.
    order : (n,) array of int
        Index that each sample has in the plan without waits.
    """

    simulated_motion: SimulatedMotion
    recorded: Array
    order: Indices


def steps_of_soaks(steps: Sequence[Any], environment: Environment) -> list[Any]:
    """Return the steps of all soaks in order; the labels include the number of the visit."""
    count = len(environment.profile.temperatures) if environment.kind == "soaks" else 1
    every = [step for _ in range(count) for step in steps]
    names = number_repeated_names([step.label for step in every])
    return [replace(step, label=name) for step, name in zip(every, names, strict=True)]


def require_profile(environment: Environment) -> ChamberProfile:
    """Return the chamber profile; raise an error if temperatures or a rate are missing.

    Raises
    ------
    InputError
        If a key is missing; the message names it.
    """
    profile = environment.profile
    needed = {"temperatures": len(profile.temperatures) > 1, "ramp_rate": profile.rate > 0}
    for key, stated in needed.items():
        if not stated:
            raise InputError(
                f"[environment] {key} is missing; a simulation needs the chamber temperatures and "
                f'the rate of change between them: add {key}, such as ramp_rate = "2 K/min"',
                key=f"[environment] {key}",
            )
    return profile


def in_chamber(
    done: SimulatedMotion,
    environment: Environment,
    rate_hz: float,
    reference: float,
    rng: "np.random.Generator",
) -> ChamberRun:
    """Simulate a plan in a chamber, including the waits and the temperatures.

    Parameters
    ----------
    done : SimulatedMotion
        Motion of the steps from `steps_of_soaks(steps, environment)`.
    environment : Environment
    rate_hz : float
    reference : float
        Reference temperature of the sensor's model, K.
    rng : Generator
        Random generator for the error of the recorded temperature in each soak.

    Raises
    ------
    InputError
        If the temperatures or the rate are not stated.
    """
    profile = require_profile(environment)
    if environment.kind == "soaks":
        moved, chamber, soak, order = _soak_course(done, profile, rate_hz)
    else:
        moved, chamber, soak, order = _ramp_course(done, profile, rate_hz)
    first = first_order_response(chamber, profile.case_time, 1 / rate_hz)
    lag = 0.0 if environment.lag is None else environment.lag.value
    later = first_order_response(first, abs(lag), 1 / rate_hz)
    element, recorded = (later, first) if lag < 0 else (first, later)
    trials = moved.motion.f.shape[0]
    # Between soaks, the error is the same as in the previous soak.
    errors = environment.temperature_sd * rng.standard_normal((trials, soak.max() + 1))
    motion = replace(moved.motion, dT=element - reference, dTdt=np.gradient(element, 1 / rate_hz))
    return ChamberRun(replace(moved, motion=motion), recorded + errors[:, soak], order)


def repeatability_errors(
    environment: Environment, sensor: Any, labels: NDArray[np.str_], trials: int, rng: Any
) -> Array:
    """Return random bias changes from soak to soak, (trials, n, m), SI."""
    sizes = {"f": environment.force_repeatability, "w": environment.rate_repeatability}
    soak = _visit_of_samples(labels)
    drawn = rng.standard_normal((trials, soak.max() + 1, len(sensor.axes)))
    return (drawn * np.array([sizes[axis.measures] for axis in sensor.axes]))[:, soak]


def _visit_of_samples(labels: NDArray[np.str_]) -> Indices:
    """Return the soak of each sample, counted from 0, from the visit number in its label."""
    names, place = np.unique(labels, return_inverse=True)
    visit = np.array([visit_number(name) - 1 for name in names.tolist()])
    number = np.where(labels == "", 0, visit[place.reshape(labels.shape)])
    return np.maximum.accumulate(number)


def _soak_course(done: SimulatedMotion, profile: ChamberProfile, rate_hz: float) -> _Course:
    """Return the motion with waits, and the chamber temperature, soak and index of each sample."""
    visit = _visit_of_samples(done.labels)
    order: list[Indices] = []
    set_points: list[Array] = []
    soaks: list[Indices] = []
    waits: list[Bools] = []
    before = profile.temperatures[0]
    for k, target in enumerate(profile.temperatures):
        own = np.flatnonzero(visit == k)
        way = round(abs(target - before) / profile.rate * rate_hz)
        wait = way + round(profile.wait * rate_hz)
        last = own[0] if k == 0 else own[0] - 1
        order.append(np.concatenate([np.full(wait, last), own]))
        course = np.full(wait + own.size, target)
        course[:way] = before + (target - before) * (np.arange(way) + 1) / max(way, 1)
        set_points.append(course)
        soaks.append(np.full(wait + own.size, k))
        waits.append(np.arange(wait + own.size) < wait)
        before = target
    places = np.concatenate(order)
    return (
        _rearranged(done, places, np.concatenate(waits), rate_hz),
        np.concatenate(set_points),
        np.concatenate(soaks),
        places,
    )


def _ramp_course(done: SimulatedMotion, profile: ChamberProfile, rate_hz: float) -> _Course:
    """Return the motion and temperatures; the first sample is held while the chamber waits."""
    wait, n = round(profile.wait * rate_hz), done.labels.size
    turning = np.array(profile.temperatures)
    reached = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turning)) / profile.rate)])
    order = np.concatenate([np.zeros(wait, dtype=np.int64), np.arange(n)])
    since = (np.arange(wait + n) - wait) / rate_hz
    held = np.arange(wait + n) < wait
    return (
        _rearranged(done, order, held, rate_hz),
        np.interp(since, reached, turning),
        np.zeros(wait + n, dtype=np.int64),
        order,
    )


def _rearranged(
    done: SimulatedMotion, order: Indices, held: Bools, rate_hz: float
) -> SimulatedMotion:
    """Return the samples in a new order, with some repeated; repeated samples have no label."""
    f, w = (np.broadcast_to(v, done.motion.f.shape) for v in (done.motion.f, done.motion.w))
    return replace(
        done,
        time=np.arange(order.size) / rate_hz,
        motion=Motion(f[:, order], w[:, order]),
        labels=np.where(held, "", done.labels[order]),
        readback={name: values[..., order] for name, values in done.readback.items()},
    )
