"""Propagate the attitude, and its sensitivity to the sensor's coefficients.

The level frame is east, north, up. C transforms from the body frame to the level frame, and C_est =
(I − [φ×]) C. The small φ is a rotation vector; φ(f, ω) from `terms` is called phi in the code.
Functions write their results to arguments, in place.
"""

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import kernel, kernel_step, kernel_value, record
from inercal.methods.turntable import BASIS, FORCE, SQUARE, TEMPERATURE, Terms
from inercal.methods.turntable.small_matrices import (
    Matrix,
    Vector,
    copy_matrix,
    matrix,
    times_matrix,
    times_vector,
    vector,
    write_matrix,
    write_row,
)
from inercal.recordings import STAMP_ROUNDING

record(Terms)

# Suppose that a rate is modelled as a parabola through three samples, and that its slope jumps by a
# at the fraction s of a step. The error is then a Δt² (s − s² − 1/6)/2, which is half of the second
# Bernoulli polynomial, zero on average and 1/√720 rms. Around the jump the three third differences
# are (1 − s, 2 s − 1, −s) a Δt, and their sum is zero. If only the second derivative jumps, the
# error is a tenth of this, and the differences have the same sign. The code therefore estimates (a
# Δt)² from the sum of the squared differences minus twice the square of their sum. The three
# windows over the differences give 1.77 (a Δt)² as the mean over s. The estimate counts only beyond
# the noise, which is on average 60 variances of a sample.
PARABOLA_ERROR, PARABOLA_THRESHOLD = (1.77 * 720) ** -0.5, 1000.0
# Error of a cubic for an angle between samples: this factor times s (1 − s) times the difference of
# the two second divided differences, as the rms over all starts of the acceleration.
CUBIC_ERROR = 0.36
SMALL_ANGLE = 1e-2  # rad, below which series replace sine and cosine
MAX_STEP_RATIO = 3.0  # ratio of time steps: one or two samples may be lost


@kernel_value
def turned(c: Matrix, v: Vector) -> Matrix:
    """Return C turned by the rotation vector v of the body, C exp [v×]."""
    x, y, z = v
    xx, yy, zz = x * x, y * y, z * z
    s = xx + yy + zz
    once, twice = 1 + s * (s * (1 / 120) - 1 / 6), 0.5 + s * (s * (1 / 720) - 1 / 24)
    if s >= SMALL_ANGLE * SMALL_ANGLE:
        angle = np.sqrt(s)
        once, twice = np.sin(angle) / angle, (1 - np.cos(angle)) / s
    xy, xz, yz = twice * x * y, twice * x * z, twice * y * z
    return times_matrix(
        c,
        (
            1 - twice * (yy + zz), xy - once * z, xz + once * y,
            xy + once * z, 1 - twice * (xx + zz), yz - once * x,
            xz - once * y, yz + once * x, 1 - twice * (xx + yy),
        ),
    )  # fmt: skip


@kernel_step
def rotate(c: Array, v: Array) -> None:
    """Turn C by the rotation vector v of the body, in place: C ← C exp [v×]."""
    write_matrix(turned(matrix(c), vector(v)), c)


@kernel_step
def turn_level(c: Array, v: Array) -> None:
    """Turn C by the rotation vector v of the level frame, in place: C ← exp [v×] C."""
    s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    once, twice = 1 + s * (s * (1 / 120) - 1 / 6), 0.5 + s * (s * (1 / 720) - 1 / 24)
    if s >= SMALL_ANGLE * SMALL_ANGLE:
        angle = np.sqrt(s)
        once, twice = np.sin(angle) / angle, (1 - np.cos(angle)) / s
    for j in range(3):
        a, b, d = c[0, j], c[1, j], c[2, j]
        e = v[1] * d - v[2] * b
        f = v[2] * a - v[0] * d
        g = v[0] * b - v[1] * a
        c[0, j] = a + once * e + twice * (v[1] * g - v[2] * f)
        c[1, j] = b + once * f + twice * (v[2] * e - v[0] * g)
        c[2, j] = d + once * g + twice * (v[0] * f - v[1] * e)


@kernel
def rotation_error(ref: Array, c: Array, z: Array) -> None:
    """Write the rotation vector z of ref Cᵀ, in the level frame."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        up, down = 0.0, 0.0
        for m in range(3):
            up += ref[k, m] * c[j, m]
            down += ref[j, m] * c[k, m]
        z[i] = 0.5 * (up - down)
    trace = 0.0
    for i in range(3):
        for m in range(3):
            trace += ref[i, m] * c[i, m]
    sine = np.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
    if sine > 1e-9:
        angle = np.arctan2(sine, 0.5 * (trace - 1))
        for i in range(3):
            z[i] *= angle / sine


@kernel_step
def _invert(m: Array, out: Array) -> None:
    """Write the inverse of a 3 × 3 matrix."""
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            d, e = (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, d] * m[b, e] - m[a, e] * m[b, d]
    det = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= det


@kernel_step
def inverse_scale_matrix(terms: Terms, c: Array, warmth: float, work: Array, out: Array) -> None:
    """Write M = (N + S)⁻¹, where S is the part of c that is linear in u, or in u ΔT.

    `work` (3, 3) is overwritten.
    """
    axis, weights, first = terms.axis, terms.weights, terms.first
    warmed = weights.shape[1] > BASIS
    copy_matrix(terms.nominal, work)
    for m in range(axis.size):
        for k in range(3):
            by = weights[m, first + k]
            if warmed:
                by += warmth * weights[m, TEMPERATURE + first + k]
            work[axis[m], k] += c[m] * by
    _invert(work, out)


@kernel_step
def fill_temperature_terms(phi: Array, warmth: float) -> None:
    """Write the terms of φ that depend on ΔT, from the other terms."""
    for b in range(BASIS):
        phi[TEMPERATURE + b] = warmth * phi[b]
    phi[TEMPERATURE + BASIS] = warmth * warmth


@kernel_step
def fill_force_terms(phi: Array, f: Vector) -> None:
    """Write the terms of φ that depend on f."""
    phi[0] = 1.0
    for k in range(3):
        phi[FORCE + k] = f[k]
        phi[SQUARE + k] = f[k] * f[k]
    phi[SQUARE + 3], phi[SQUARE + 4] = f[0] * f[1], f[0] * f[2]
    phi[SQUARE + 5] = f[1] * f[2]


def used_term_indices(weights: Array) -> Indices:
    """Return the terms of φ that a triad uses; the first is always used, because biases drift."""
    used = np.any(weights != 0.0, axis=0)
    used[0] = True
    return np.flatnonzero(used)


def added_term_indices(used: Indices, first: int) -> Indices:
    """Return the used terms from `first` on that M does not include; M includes u and u ΔT."""
    linear = np.where(used >= TEMPERATURE, used - TEMPERATURE, used)
    return used[(linear < first) | (linear >= first + 3)]


@kernel_step
def sum_reading_terms(terms: Terms, c: Array, drift: Array, used: Indices, by: Array) -> None:
    """Write the factor of each term of φ in the readings, (BASIS, 3); the first includes drift."""
    axis, weights = terms.axis, terms.weights
    for t in range(used.size):
        b = used[t]
        for i in range(3):
            by[b, i] = drift[i] if b == 0 else 0.0
        for m in range(axis.size):
            by[b, axis[m]] += c[m] * weights[m, b]


@kernel_value
def correct_reading(reading: Vector, m: Matrix, by: Array, phi: Array, added: Indices) -> Vector:
    """Return u = M (reading − the terms `added`), where M does not include these terms."""
    x, y, z = reading
    for t in range(added.size):
        b = added[t]
        x -= by[b, 0] * phi[b]
        y -= by[b, 1] * phi[b]
        z -= by[b, 2] * phi[b]
    return times_vector(m, (x, y, z))


@kernel_value
def accumulate_sensitivity(cm: Array, phi: Array, dt: float, used: Indices, made: Array) -> None:
    """Add C M φ dt to `made`, (BASIS, 9), which contains each matrix row after row."""
    for t in range(used.size):
        size, row = phi[used[t]] * dt, made[used[t]]
        # All values are read before any is written, so the compiler can add several at once.
        total = (
            row[0] + cm[0] * size, row[1] + cm[1] * size, row[2] + cm[2] * size,
            row[3] + cm[3] * size, row[4] + cm[4] * size, row[5] + cm[5] * size,
            row[6] + cm[6] * size, row[7] + cm[7] * size, row[8] + cm[8] * size,
        )  # fmt: skip
        write_row(total, row)


@kernel_step
def write_transition_columns(
    made: Array, terms: Terms, used: Indices, sign: float, components: int, a: Array
) -> None:
    """Write the columns for coefficients and drift, and begin a new sum.

    The columns come after a square block. Each bias's drift is the sum of `components` components.
    """
    axis, weights, first = terms.axis, terms.weights, len(a)
    gm = first + axis.size
    for s in range(axis.size):
        for k in range(3):
            a[k, first + s] = 0.0
        for t in range(used.size):
            size = sign * weights[s, used[t]]
            if size != 0.0:
                for k in range(3):
                    a[k, first + s] += size * made[used[t], 3 * k + axis[s]]
    for c in range(components):
        for k in range(3):
            for j in range(3):
                a[k, gm + 3 * c + j] = sign * made[0, 3 * k + j]
    for t in range(used.size):
        for k in range(9):
            made[used[t], k] = 0.0


@kernel_step
def bracketing_rows(times: Array, newest: int, when: float) -> tuple[int, int, float]:
    """Return the rows of a ring buffer before and after a time, and the fraction of the step.

    Parameters
    ----------
    times : (k,) array
        Times of the last k samples.
    newest : int
        Row of the latest sample.
    when : float
        Time, s; outside the stored range the fraction is below 0 or above 1.
    """
    k = times.size
    after, before = newest, (newest - 1) % k
    while times[before] > when and (before - 1) % k != newest:
        after, before = before, (before - 1) % k
    step = times[after] - times[before]
    return before, after, (when - times[before]) / step if step > 0 else 0.0


@kernel_step
def interpolate_attitude(
    times: Array,
    past: Array,
    newest: int,
    when: float,
    out: Array,
    rate: Array,
    left: Array,
    work: Array,
) -> None:
    """Write the attitude at a time between stored ones, and the body's rate in the level frame.

    The attitude comes from a cubic through four attitudes, or from a parabola through three at
    either end of the stored range.

    Parameters
    ----------
    times, past : (k,) and (k, 3, 3) arrays
        Times and attitudes of the last k samples, in a ring buffer.
    newest : int
        Row of the latest sample.
    when : float
        Time, s; outside the stored range the rate is constant.
    out : (3, 3) array
    rate, left : (3,) arrays
        Rate, rad/s, and possible bending of the path by a sudden acceleration, rad.
    work : (3, 3) array
        Work array.
    """
    k = times.size
    before, after, share = bracketing_rows(times, newest, when)
    step = times[after] - times[before]
    turn, bent, other = work[0], work[1], work[2]
    for i in range(3):
        left[i] = rate[i] = bent[i] = 0.0
    copy_matrix(past[before], out)
    if step <= 0:
        return
    rotation_error(past[after], past[before], rate)
    way = share * (share - 1) * step * step
    if 0 < share < 1:
        row, next_row = (before - 1) % k, (after + 1) % k
        h0, h2 = times[before] - times[row], times[next_row] - times[after]
        early = before != newest and row != newest and are_similar_steps(h0, step)
        late = after != newest and are_similar_steps(h2, step)
        if early:
            rotation_error(past[before], past[row], other)
            for i in range(3):
                bent[i] = (rate[i] / step - other[i] / h0) / (step + h0)
        if late:
            rotation_error(past[next_row], past[after], other)
            for i in range(3):
                f = (other[i] / h2 - rate[i] / step) / (step + h2)
                if early:
                    left[i] = CUBIC_ERROR * way * (f - bent[i])
                    f = ((2 - share) * bent[i] + (1 + share) * f) / 3
                bent[i] = f
    for i in range(3):
        turn[i] = rate[i] * share + bent[i] * way
        rate[i] = rate[i] / step + bent[i] * (2 * share - 1) * step
    turn_level(out, turn)


@kernel_step
def are_similar_steps(step: float, other: float) -> bool:
    """Return whether two time steps are of similar length, so that a curvature is meaningful."""
    return 0 < step <= MAX_STEP_RATIO * other and other <= MAX_STEP_RATIO * step


def epoch_indices(time: Array, period: float, last: float) -> Indices:
    """Return the samples at which an epoch is due: at least a period after the previous epoch.

    A period that is too short only because of rounded timestamps counts as complete.
    """
    return epoch_indices_in_holds(time, np.zeros(time.size, np.int64), period, last, 0)


def epoch_indices_in_holds(
    time: Array, hold: Indices, period: float, last: float, number: int
) -> Indices:
    """Return epoch indices within holds: the first sample of each, then every period."""
    found = np.empty(time.size, np.int64)
    return found[: _write_epochs(time, hold, period - STAMP_ROUNDING, last, number, found)]


@kernel
def _write_epochs(
    time: Array, hold: Indices, period: float, last: float, number: int, found: Indices
) -> int:
    count = 0
    for i in range(time.size):
        if hold[i] < 0:
            continue
        if hold[i] != number or time[i] - last >= period:
            found[count] = i
            count += 1
            last, number = time[i], hold[i]
    return count
