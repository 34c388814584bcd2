"""Simulate arm runs: in each attitude the arm spins up, dwells at each rate, and stops.

The arm starts at rest in each attitude and goes through its rates in order, with constant
acceleration. Samples are labelled with the name of the attitude. The bench reads back the commanded
rate, which differs from the true rate by an error such as that of an encoder's clock. The recording
omits the time for changing the attitude.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, cos, sin

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.centrifuge.arm_motion import attitude_names, sensed_motion
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.contract import SimulatedMotion, concatenate_motions
from inercal.physics.frames import exp_so3, transform
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin

_SETTLING = 2.0  # s at the rate before a dwell begins
_REST = 1.0  # s at rest before and after the spin


def simulate_arm_motion(
    bench: Centrifuge,
    steps: Sequence[Spin],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
) -> SimulatedMotion:
    """Simulate the motion in each trial, and the readback.

    The readback consists of "arm_rate", rad/s, and the angles of the two-axis head, "psi" and
    "theta", rad, (n,) each.

    Parameters
    ----------
    bench : Centrifuge
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of Spin
        Steps whose attitudes are known.
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    declared = bench.acting_parameters(steps, vectors=True, dwells=True)
    drawn = bench.qualified.draw(declared, rng, trials)
    named = attitude_names(steps)
    parts: list[Motion] = []
    readbacks: list[Array] = []
    labels: list[str] = []
    azimuth = 0.0
    for attitude, first in named.items():
        name = first.rpartition("_r")[0] or first  # the name of the attitude without the rate
        own = [step for step in steps if step.attitude == attitude]
        rate, which = _profile(own, bench.acceleration, rate_hz)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
        swept = azimuth + bench.sense / rate_hz * turned
        parts.append(_sensed_motion(bench, own, drawn, rate, which, swept, 1 / rate_hz))
        azimuth = float(swept[-1])
        head = head_angles_of_attitude(own[0])
        readbacks.append(np.stack([rate, *(np.full(rate.size, angle) for angle in head)]))
        labels += [name] * rate.size
    time = np.arange(len(labels)) / rate_hz
    rate, psi, theta = np.concatenate(readbacks, axis=1)
    readback = {"arm_rate": rate, "psi": psi, "theta": theta}
    return SimulatedMotion(time, concatenate_motions(parts), np.array(labels), drawn, readback)


def arm_plan_duration(bench: Centrifuge, steps: Sequence[Spin]) -> float:
    """Return the duration of these steps with spin-up and spin-down in each attitude, s."""
    total = 0.0
    for attitude in attitude_names(steps):
        own = [step for step in steps if step.attitude == attitude]
        rates = [0.0, *(step.rate for step in own), 0.0]
        ramps = float(np.abs(np.diff(rates)).sum()) / bench.acceleration
        total += 2 * _REST + ramps + sum(_SETTLING + step.seconds for step in own)
    return total


def head_angles_of_attitude(step: Spin) -> tuple[float, float]:
    """Return the angles ψ and θ of the two-axis head for the attitude of a step, rad."""
    (out,), (up,) = outward_and_up_directions([step])
    theta = atan2(up[0], -up[2])
    return atan2(out[1], out[0] * cos(theta) + out[2] * sin(theta)), theta


def _profile(
    steps: Sequence[Spin], acceleration: float, rate_hz: float
) -> tuple[Array, NDArray[np.int64]]:
    """Return the rate, (n,) rad/s, and each sample's step, which during ramps is the next step."""
    rest = np.zeros(round(_REST * rate_hz))
    pieces, owners = [rest], [np.zeros(rest.size, dtype=np.int64)]
    before = 0.0
    for k, step in enumerate(steps):
        ramp = max(round(abs(step.rate - before) / acceleration * rate_hz), 1)
        hold = round((_SETTLING + step.seconds) * rate_hz)
        pieces += [np.linspace(before, step.rate, ramp), np.full(hold, step.rate)]
        owners.append(np.full(ramp + hold, k))
        before = step.rate
    down = max(round(abs(before) / acceleration * rate_hz), 1)
    pieces += [np.linspace(before, 0.0, down), rest]
    owners.append(np.full(down + rest.size, len(steps) - 1))
    return np.concatenate(pieces), np.concatenate(owners)


def _sensed_motion(
    bench: Centrifuge,
    steps: Sequence[Spin],
    drawn: dict[str, Array],
    rate: Array,
    which: NDArray[np.int64],
    azimuth: Array,
    dt: float,
) -> Motion:
    """Return f and ω for the run in one attitude, (trials, n, 3)."""
    nominal = np.array([step.rate for step in steps])[which]
    # The motion during a dwell is known; during a ramp the centripetal part follows the square of
    # the rate. A dwell without a duration lasts whole turns.
    still = sensed_motion(bench, [replace(steps[0], rate=0.0, seconds=0.0)], drawn)
    dwell = sensed_motion(bench, [replace(step, seconds=0.0) for step in steps], drawn)
    share = (rate / nominal) ** 2
    f = still.f + (dwell.f - still.f)[..., which, :] * share[:, None]
    w = dwell.w[..., which, :] * (rate / nominal)[:, None]
    out, up = (rows[0] for rows in outward_and_up_directions(steps[:1]))
    # Mounting and indexing rotate every vector in the body alike. The indexing error of an attitude
    # has the name of the first step in that attitude.
    attitude = attitude_names(steps)[steps[0].attitude]
    body = exp_so3(np.stack([drawn[f"mount_{a}"] for a in "xyz"], axis=-1)) @ exp_so3(
        np.stack([drawn[f"index_{a}[{attitude}]"] for a in "xyz"], axis=-1)
    )
    along = np.cross(up, out)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    lean = [drawn[name][:, None] for name in ("lean1", "lean2")]
    outwards = lean[0] * cosine + lean[1] * sine
    forwards = lean[1] * cosine - lean[0] * sine
    g = drawn["g"][:, None]
    swing = -(g * outwards)[..., None] * (body @ out)[:, None]
    swing -= (g * forwards)[..., None] * (body @ along)[:, None]
    coriolis = drawn["level1"][:, None] * cosine + drawn["level2"][:, None] * sine
    upwards = -2 * bench.sense * rate * bench.radius.value * coriolis
    swing += upwards[..., None] * (body @ up)[:, None]
    tangential = bench.radius.value * np.gradient(rate, dt) * bench.sense
    f = f + swing + tangential[:, None] * (body @ along)[:, None]
    if bench.platform == "locked":
        return Motion(f, w)
    # The body keeps its attitude while the arm turns, so vectors rotate about `up`.
    back = exp_so3((body @ up)[:, None] * azimuth[:, None])
    return Motion(transform(back, f), np.zeros_like(f))
