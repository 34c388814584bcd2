"""Run a compiled Kalman filter for navigation, whose states are mostly constants.

The states are ψ and the velocity error, the coefficients, the lag, gravity and latitude, and the
drift of the biases. In an epoch of T seconds, with C at its middle and F = C f, as in `_kernels`::

    ψ ← ψ − T ω_ie × ψ + Σ T C ∂ω/∂x x
    v ← v − 2 T ω_ie × v − ∫F dt × ψ + Σ (T C ∂f/∂x − ½ ∫F dt × T C ∂ω/∂x) x

During a rest C does not change, and the velocity is observed to be zero at the end of each epoch.
All states are relative to a navigation with fixed coefficients. This navigation begins each turn
from rest, at an attitude that does not change with the estimate, so the effect of a state is the
same in all epochs. If the navigation followed the estimate, the filter would treat unobservable
directions as observed.
"""

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import kernel, kernel_step
from inercal.methods.systematic._kernels import (
    SAMPLE_VECTORS,
    NavigationSettings,
    TurnMotion,
    add_white_noise,
    advance_sample,
    apply_matrix,
    cross,
)
from inercal.methods.turntable.small_matrices import copy_matrix, product

FILTER_VECTORS = SAMPLE_VECTORS + 9
NAVIGATION = 6  # number of states in ψ and v
_AFTER_COEFFICIENTS = 3  # lag, gravity, latitude


@kernel_step
def _write_effects(
    by_rate: Array,
    by_force: Array,
    lag_at: int,
    c: Array,
    force: Array,
    lagging: Array,
    earth_slope: Array,
    seconds: float,
    work: Array,
    by: Array,
) -> None:
    """Write the effect on ψ and v of the other states during an epoch, (6, q)."""
    for m in range(by.shape[1]):
        for j in range(3):
            work[0, j], work[1, j] = by_rate[j, m], by_force[j, m]
        apply_matrix(c, work[0], work[2])
        apply_matrix(c, work[1], work[3])
        for j in range(3):
            work[2, j] *= seconds
            work[3, j] *= seconds
        if m == lag_at:
            for j in range(3):
                work[3, j] = lagging[j]
        if m == lag_at + 1:
            work[3, 2] -= seconds
        if m == lag_at + 2:
            for j in range(3):
                work[2, j] -= seconds * earth_slope[j]
        cross(force, work[2], work[0])
        for j in range(3):
            by[j, m], by[3 + j, m] = work[2, j], work[3, j] - 0.5 * work[0, j]


@kernel_step
def _move(a: Array, force: Array, earth: Array, seconds: float, work: Array, out: Array) -> None:
    """Write ψ and v, (6,), after an epoch, without the effect of the other states."""
    for j in range(3):
        work[0, j], work[1, j] = a[j], a[3 + j]
    cross(earth, work[0], work[2])
    cross(earth, work[1], work[3])
    cross(force, work[0], work[4])
    for j in range(3):
        out[j] = a[j] - seconds * work[2, j]
        out[3 + j] = a[3 + j] - 2 * seconds * work[3, j] - work[4, j]


@kernel_step
def _propagate(
    p: Array,
    by: Array,
    force: Array,
    earth: Array,
    seconds: float,
    keep: Array,
    drawn: Array,
    work: Array,
    six: Array,
    moved: Array,
) -> None:
    """Propagate P through an epoch; `moved`, (6, n), and `six`, (2, 6), are work arrays."""
    n, q = p.shape[0], by.shape[1]
    for k in range(n):
        for j in range(6):
            six[0, j] = p[j, k]
        _move(six[0], force, earth, seconds, work, six[1])
        for j in range(6):
            moved[j, k] = six[1, j]
    for j in range(6):
        for m in range(q):
            if by[j, m] != 0.0:
                for k in range(n):
                    moved[j, k] += by[j, m] * p[6 + m, k]
    for i in range(6):
        for j in range(6):
            six[0, j] = moved[i, j]
        _move(six[0], force, earth, seconds, work, six[1])
        for j in range(6):
            total = six[1, j]
            for m in range(q):
                total += moved[i, 6 + m] * by[j, m]
            p[i, j] = total
        for m in range(q):
            p[i, 6 + m] = moved[i, 6 + m]
            p[6 + m, i] = moved[i, 6 + m]
    for i in range(6):
        for j in range(i):
            p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])
    first = n - keep.size
    for i in range(keep.size):
        for k in range(n):
            p[first + i, k] *= keep[i]
        for k in range(n):
            p[k, first + i] *= keep[i]
    for i in range(keep.size):
        for j in range(keep.size):
            p[first + i, first + j] += drawn[i, j]


@kernel_step
def _observe(
    x: Array, p: Array, variance: float, gain: Array, innovation: Array, standard: Array
) -> float:
    """Update with the velocity, one component after the other, and return the NIS."""
    n, nis = x.size, 0.0
    for i in range(3):
        s = p[3 + i, 3 + i] + variance
        off = -x[3 + i]
        innovation[i] = off
        standard[i] = off / np.sqrt(s)
        nis += off * off / s
        for k in range(n):
            gain[k] = p[k, 3 + i] / s
        for k in range(n):
            x[k] += gain[k] * off
            for m in range(n):
                p[k, m] -= gain[k] * gain[m] * s
    return nis


@kernel_step
def _count_from(x: Array, c: Array, v: Array, reference: Array, work: Array, turned: Array) -> None:
    """Set C to a reference attitude and v to zero, and make the states ψ and v relative to them."""
    for i in range(3):
        for j in range(3):
            turned[0, i, j] = reference[j, i]
    product(c, turned[0], turned[1])
    for j in range(3):
        work[0, j] = 0.5 * (
            turned[1, (j + 2) % 3, (j + 1) % 3] - turned[1, (j + 1) % 3, (j + 2) % 3]
        )
    squared = work[0, 0] ** 2 + work[0, 1] ** 2 + work[0, 2] ** 2
    for j in range(3):
        x[j] += work[0, j] * (1 + squared / 6)  # arcsin
        x[3 + j] += v[j]
        v[j] = 0.0
    copy_matrix(reference, c)


@kernel
def filter_epochs(
    motion: TurnMotion,
    by_rate: Array,
    by_force: Array,
    rest: Indices,
    rest_attitude: Array,
    present: Indices,
    count: int,
    begins: bool,
    settings: NavigationSettings,
    earth_slope: Array,
    white: Array,
    rest_variance: float,
    keep: Array,
    drawn: Array,
    x: Array,
    p: Array,
    c: Array,
    v: Array,
    before: Array,
    vectors: Array,
    matrices: Array,
    rows: Array,
    innovation: Array,
    standard: Array,
    nis: Array,
) -> None:
    """Filter e epochs of a recording; state and covariance are changed in place.

    Parameters
    ----------
    motion : TurnMotion
        Motion in e · count samples, computed with the coefficients that the states are relative to.
    by_rate, by_force : (e, 3, n − 6) arrays
        Sensitivity of ω and f in each epoch to the states after ψ and v.
    rest : (e,) array of int
        Index of the rest that contains the epoch, from 0; −1 in motion.
    rest_attitude : (m, 3, 3) array
        C in the first m rests, as reference of the states; later rests use C at the turn's end.
    present : (1,) array of int
        Index of the rest before the first epoch, or −1 if the table moved; changed in place.
    count : int
        Number of samples in an epoch.
    begins : bool
        Whether the first sample is the first of the recording.
    settings : NavigationSettings
        With the reference values of the states for gravity and lag.
    earth_slope : (3,) array
        Derivative of ω_ie in n with respect to latitude.
    white : (6,) array
        Squared noise densities of accelerometers and gyros in the body axes, SI²/Hz.
    rest_variance : float
        Variance of the velocity during a rest, (m/s)².
    keep, drawn : (d,) and (d, d) arrays
        For the last d states, which are the drift: the factor for one epoch, and the noise that is
        added.
    x, p : (n,) and (n, n) arrays
        States and covariance.
    c, v : (3, 3) and (3,) arrays
        Attitude, body to n, and velocity.
    before : (2, 3) array
        Increments in the sample before.
    vectors, matrices, rows
        Work arrays, (FILTER_VECTORS, 3), (4, 3, 3) and (16, n).
    innovation, standard, nis : (e, 3), (e, 3) and (e,) arrays
        Output for rests: in m/s, divided by standard deviations, and squared. Other epochs are
        unchanged.
    """
    n, d = x.size, keep.size
    q = n - 6
    lag_at = q - d - _AFTER_COEFFICIENTS
    sample, work = vectors[:SAMPLE_VECTORS], vectors[SAMPLE_VECTORS : SAMPLE_VECTORS + 5]
    gained, late, force, lagging = vectors[-4], vectors[-3], vectors[-2], vectors[-1]
    middle, turned, reference = matrices[0], matrices[1:3], matrices[3]
    earth, gravity, _, dt = settings
    moved, by, six, gain = rows[:6], rows[6:12, :q], rows[12:14, :6], rows[14]
    for k in range(2):
        for j in range(3):
            sample[k, j] = before[k, j]
    for e in range(rest.size):
        for j in range(3):
            force[j] = lagging[j] = 0.0
        if rest[e] >= 0:
            if rest[e] != present[0]:
                known = rest[e] < rest_attitude.shape[0]
                copy_matrix(rest_attitude[rest[e]] if known else c, reference)
                _count_from(x, c, v, reference, work, turned)
            copy_matrix(c, reference)
        present[0] = rest[e]
        for k in range(count):
            i = e * count + k
            if k == count // 2:
                copy_matrix(c, middle)
            first = begins and i == 0
            advance_sample(motion, i, c, v, settings, first, sample, gained, late, turned)
            for j in range(3):
                force[j] += gained[j]
                lagging[j] += late[j]
            if count % 2 and k == count // 2:  # the epoch's middle is the middle of a sample
                for m in range(3):
                    for j in range(3):
                        middle[m, j] = 0.5 * (middle[m, j] + c[m, j])
        seconds = count * dt
        if rest[e] >= 0:  # readings have noise, but known facts about a rest have none
            copy_matrix(reference, middle)
            for j in range(3):
                force[j] = lagging[j] = 0.0
            force[2] = gravity * seconds
        _write_effects(
            by_rate[e], by_force[e], lag_at, middle, force, lagging, earth_slope, seconds, work, by
        )
        add_white_noise(p, middle, white, seconds)
        _propagate(p, by, force, earth, seconds, keep, drawn, work, six, moved)
        add_white_noise(p, middle, white, seconds)
        _move(x[:6], force, earth, seconds, work, six[0])
        for j in range(6):
            x[j] = six[0, j]
            for m in range(q):
                x[j] += by[j, m] * x[6 + m]
        for i in range(d):
            x[n - d + i] *= keep[i]
        if rest[e] >= 0:
            _count_from(x, c, v, reference, work, turned)
            nis[e] = _observe(x, p, rest_variance, gain, innovation[e], standard[e])
    for k in range(2):
        for j in range(3):
            before[k, j] = sample[k, j]
