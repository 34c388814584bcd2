"""Advance all axes of a simulated table by servo cycles, in compiled code.

**Profile.** A trapezoid is computed cycle by cycle: in each cycle T, the commanded rate r changes
by at most a T (a is the acceleration) toward the highest rate from which the axis can still stop at
its goal,

    r = d/(N T) + a T (N − 1)/2 ≤ speed,    N = ⌈√(1/4 + 2 d/(a T²)) − 1/2⌉

Here d is the remaining distance, and N is the smallest number of cycles in which the axis can
brake. The rate decreases by exactly a T in each cycle, because the rates r, r − a T, … cover d in N
cycles. The mean of the last `smooth` rates is an S-curve that ends at the same position.

**Servo.** The axis is a second-order system with the encoder in the loop:

    α = ω² (desired − encoder) + 2ζω (k desired rate − encoder rate),    |α| ≤ torque

At a steady rate, the axis therefore lags by 2ζ(1 − k)/ω times the rate. If the servo is off,
friction brakes the axis.

**Readback.** The reported angle may be delayed. It is then interpolated linearly between two cycles
of the encoder. The servo has no such delay.
"""
# Neither Numba's decorator nor the field of a record is typed.
# pyright: reportUntypedFunctionDecorator=false, reportAttributeAccessIssue=false

from math import ceil, copysign, floor, sqrt, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import njit

HOLD, GO, RUN, SEARCH = 0, 1, 2, 3
MAX_SMOOTH = 1024
ENCODER_HISTORY = 4096  # number of stored encoder cycles, a power of 2

# Flags in a report.
CLOSED, MOVING, SETTLED, HOMED, SEARCHING, ABORTING, LIMITED, TRIPPED, AMPLIFIER = (
    1 << bit for bit in range(9)
)

_REAL = (
    # Settings, SI; `delay` is the delay of the readback, in cycles.
    "speed", "acceleration", "abort", "low", "high", "fatal", "band", "omega", "zeta",
    "feedforward", "torque", "friction", "index", "delay",
    # Command; profile before and after the S-curve.
    "goal", "direction", "raw", "raw_rate", "sum", "desired", "desired_rate",
    # Truth; encoder and its zero.
    "angle", "rate", "rotation", "encoder", "encoder_rate", "zero",
)  # fmt: skip
_INTEGER = (
    # Setting; command; profile.
    "smooth", "mode", "aborting", "still",
    # Flags; faults that can be set.
    "closed", "homed", "limited", "tripped", "amplifier", "frozen", "jammed",
)  # fmt: skip
AXIS = np.dtype([(name, "f8") for name in _REAL] + [(name, "i8") for name in _INTEGER])


@njit(cache=True, nogil=True)
def _advance_profile(x: Any, period: float) -> None:
    """Advance the trapezoid by one cycle."""
    limit = x.abort if x.aborting else x.acceleration
    step = limit * period
    wanted = 0.0
    if x.mode == RUN or x.mode == SEARCH:
        wanted = x.direction * x.speed
    elif x.mode == GO:
        left = x.goal - x.raw
        if abs(left) <= 1e-15 * (1.0 + abs(x.goal)) and abs(x.raw_rate) <= 1.0001 * step:
            x.raw, x.raw_rate, x.mode = x.goal, 0.0, HOLD
            return
        cycles = max(ceil(sqrt(0.25 + 2.0 * abs(left) / (step * period)) - 0.5), 1.0)
        most = abs(left) / (cycles * period) + 0.5 * step * (cycles - 1.0)
        wanted = copysign(min(most, x.speed), left)
    change = wanted - x.raw_rate
    x.raw_rate += min(max(change, -step), step)
    x.raw += x.raw_rate * period
    if x.mode == HOLD and x.raw_rate == 0.0:
        x.aborting = 0


@njit(cache=True, nogil=True)
def _smooth_profile(x: Any, past: Array, cycle: int, period: float) -> None:
    """Compute the S-curve from the trapezoid; `past` contains the last rates of the trapezoid."""
    place = cycle % x.smooth
    x.sum += x.raw_rate - past[place]
    past[place] = x.raw_rate
    x.still = x.still + 1 if x.raw_rate == 0.0 and x.mode == HOLD else 0
    if x.still >= x.smooth:
        # Here both profiles are the same, and the sum contains only rounding errors.
        x.sum = 0.0
        x.desired, x.desired_rate = x.raw, 0.0
    else:
        x.desired_rate = x.sum / x.smooth
        x.desired += x.desired_rate * period


@njit(cache=True, nogil=True)
def _advance_axis(x: Any, period: float) -> None:
    """Advance the axis itself, and update its encoder."""
    if x.closed:
        wanted = x.omega * x.omega * (x.desired - x.encoder) + 2.0 * x.zeta * x.omega * (
            x.feedforward * x.desired_rate - x.encoder_rate
        )
        rotation = min(max(wanted, -x.torque), x.torque)
    else:
        rotation = -min(x.friction, abs(x.rate) / period) * copysign(1.0, x.rate)
    before = x.rate
    x.rate = 0.0 if x.jammed else x.rate + rotation * period
    x.rotation = (x.rate - before) / period
    x.angle += x.rate * period
    if x.frozen:
        x.encoder_rate = 0.0
    else:
        x.encoder, x.encoder_rate = x.angle, x.rate


@njit(cache=True, nogil=True)
def _check_limits(x: Any, before: float) -> None:
    """Check index pulse, soft limits, following error and amplifier."""
    if not x.closed:
        # The profile follows the axis, because closing the loop must begin at the present position.
        x.raw, x.desired = x.encoder, x.encoder
        x.raw_rate, x.desired_rate, x.sum, x.mode, x.aborting = 0.0, 0.0, 0.0, HOLD, 0
        return
    if x.mode == SEARCH:
        here = floor((x.encoder - x.index) / tau)
        there = floor((before - x.index) / tau)
        if here != there:
            x.goal = x.index + tau * max(here, there)
            x.zero, x.homed, x.mode = x.goal, 1, GO
    elif x.mode != HOLD:
        place = x.encoder - x.zero
        if (place >= x.high and x.raw_rate > 0.0) or (place <= x.low and x.raw_rate < 0.0):
            x.mode, x.aborting, x.limited = HOLD, 1, 1
    if abs(x.desired - x.encoder) > x.fatal:
        x.tripped, x.closed = 1, 0
    if x.amplifier:
        x.closed = 0


@njit(cache=True, nogil=True)
def advance_axes(
    axes: NDArray[Any], past: Array, shown: Array, cycle: int, period: float, out: Array
) -> None:
    """Advance all axes by as many cycles as `out` has, starting at a given cycle.

    The results are angle, rate and acceleration at the end of every cycle in `out` (cycles, axes,
    3), and the encoder angles in `shown` (axes, PAST).
    """
    for k in range(out.shape[0]):
        for i in range(axes.size):
            x = axes[i]
            before = x.encoder
            if x.closed:
                _advance_profile(x, period)
                _smooth_profile(x, past[i], cycle + k, period)
            _advance_axis(x, period)
            _check_limits(x, before)
            out[k, i, 0], out[k, i, 1], out[k, i, 2] = x.angle, x.rate, x.rotation
            shown[i, (cycle + k) & (ENCODER_HISTORY - 1)] = x.encoder


@njit(cache=True, nogil=True)
def report_axes(axes: NDArray[Any], shown: Array, cycle: int, out: Array) -> None:
    """Compute the values that a controller reports after a number of cycles.

    The results in `out` (axes, 5) are the readback of the encoder and its rate, the following
    error, the position of the axis' zero, and the flags.
    """
    for i in range(axes.size):
        x = axes[i]
        read = x.encoder
        if x.delay > 0.0:
            then = max(cycle - 1 - x.delay, 0.0)
            last = floor(then)
            left = then - last
            read = (1.0 - left) * shown[i, last & (ENCODER_HISTORY - 1)]
            read += left * shown[i, (last + 1) & (ENCODER_HISTORY - 1)]
        moving = x.closed and (x.mode != HOLD or x.raw_rate != 0.0 or x.desired_rate != 0.0)
        error = x.desired - x.encoder
        flags = CLOSED if x.closed else 0
        flags |= MOVING if moving else 0
        flags |= SETTLED if x.closed and not moving and abs(error) <= x.band else 0
        flags |= HOMED if x.homed else 0
        flags |= SEARCHING if x.mode == SEARCH else 0
        flags |= ABORTING if x.aborting else 0
        flags |= LIMITED if x.limited else 0
        flags |= TRIPPED if x.tripped else 0
        flags |= AMPLIFIER if x.amplifier else 0
        out[i, 0], out[i, 1], out[i, 2] = read, x.encoder_rate, error
        out[i, 3], out[i, 4] = x.zero, flags
