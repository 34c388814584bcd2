"""Integrate the rotation during each transition, sample by sample.

Let ω̂ = W y + w₀ be the corrected rate of a sample, and φ the rotation between two samples. The
rate is assumed to be linear between the samples (Magnus series to fourth order in the step)::

    φ = ½ (ω₀ + ω₁) Δt + Δt²/12 ω₀ × ω₁
    u₁ = E u₀,   E = exp(−[φ×])           a direction fixed in space, seen from the turning body
    ψ₁ = E (ψ₀ + ½ dφ) + ½ dφ             turn of the end frame by errors of the rate, dφ = δω Δt

At the end, δu = u × ψ. Arrays are copied number by number, because Numba takes seconds to compile
the assignment of an array to a slice. Two-sample step: Miller (1983), J. Guidance 6(4), 287–291.
"""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit

Ends = tuple[Indices, Indices, Indices, Indices]
"""The samples `start`, `left`, `reached` and `stop` of each of k transitions, (k,) each."""


@njit(cache=True, nogil=True, error_model="numpy")
def _corrected_motion(sensed: Array, back: Array, zero: Array, output: Array, i: int) -> None:
    """Write (f, ω) of sample i to the first six elements of `sensed`."""
    for a in range(6):
        total = zero[a]
        for b in range(output.shape[1]):
            total += back[a, b] * output[i, b]
        sensed[a] = total


def integrate_transitions(
    time: Array,
    output: Array,
    ends: Ends,
    back: Array,
    zero: Array,
    white: Array,
    weight: Array | None,
) -> tuple[Array, Array, Array]:
    """Return the rotation, sensitivity and noise of each of k transitions.

    Parameters
    ----------
    time, output, ends
        As in `inercal.recordings.Transitions`.
    back, zero : (6, m) and (6,) arrays
        Matrix and offset that compute f and ω from the output: back @ y + zero, SI.
    white : (3, 3) array
        Covariance of the white part of one rate sample, (rad/s)².
    weight : (n,) array or None
        Weight of each sample in the sensitivity; shape (0,) means 1 for all. With None, only the
        rotations are computed, and the other arrays are empty.

    Returns
    -------
    rotation : (k, 3, 3) array
        From the body frame before the transition to the one after it.
    sensitivity : (k, 3, 3, 7) array
        Σ C ⊗ (f, ω, 1) Δt, where C is the rotation from a sample's frame to the last one. Element
        [a, b, j] is the final turn about axis a due to a rate error along b that is proportional to
        quantity j.
    noise : (k, 3, 3) array
        Covariance of ψ due to the rate's white noise between `left` and `reached`, rad².
    """
    count = ends[0].size
    # Allocated here, because in a kernel each shape takes a tenth of a second to compile.
    rows = 0 if weight is None else count
    found = np.empty((count, 3, 3)), np.empty((rows, 3, 3, 7)), np.empty((rows, 3, 3))
    weights = np.zeros(0) if weight is None else weight
    _integrate(time, output, ends, back, zero, white, weights, found)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate(
    time: Array,
    output: Array,
    ends: Ends,
    back: Array,
    zero: Array,
    white: Array,
    weight: Array,
    found: tuple[Array, Array, Array],
) -> None:
    start, left, reached, stop = ends
    rotation, sensitivity, noise = found
    sensed, last, result = np.empty(7), np.empty(7), np.empty(7)
    # Rows of the sensitivity, (b, quantity), are separate arrays of the kernel, so the compiler
    # knows that they do not overlap.
    s0, s1, s2 = np.empty(21), np.empty(21), np.empty(21)
    r, p, e, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    sensed[6] = 1.0
    weighted, before, now = weight.size > 0, 1.0, 1.0
    only_rotation = noise.size == 0
    for k in range(start.size):
        for a in range(3):
            for b in range(3):
                r[a, b], p[a, b] = 1.0 if a == b else 0.0, 0.0
        for j in range(21):
            s0[j], s1[j], s2[j] = 0.0, 0.0, 0.0
        rise, fall = left[k] - start[k] + 1.0, stop[k] - reached[k] + 1.0
        for i in range(start[k], stop[k] + 1):
            for j in range(7):
                last[j] = sensed[j]
            _corrected_motion(sensed, back, zero, output, i)
            if weighted:
                before, now = now, weight[i]
            if i == start[k]:
                continue
            dt = time[i] - time[i - 1]
            if i <= left[k]:
                dt *= (i - start[k]) / rise
            elif i > reached[k]:
                dt *= (stop[k] - i + 1) / fall
            h, c = 0.5 * dt, dt * dt / 12.0
            x = h * (last[3] + sensed[3]) + c * (last[4] * sensed[5] - last[5] * sensed[4])
            y = h * (last[4] + sensed[4]) + c * (last[5] * sensed[3] - last[3] * sensed[5])
            z = h * (last[5] + sensed[5]) + c * (last[3] * sensed[4] - last[4] * sensed[3])
            square = x * x + y * y + z * z
            if square > 1e-5:
                angle = np.sqrt(square)
                one, two = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
            else:
                # The next terms are below 1e-17.
                one = 1.0 - square * (1.0 - square * (1.0 / 20.0)) * (1.0 / 6.0)
                two = 0.5 - square * (1.0 - square * (1.0 / 30.0)) * (1.0 / 24.0)
            e[0, 0] = 1.0 - two * (y * y + z * z)
            e[1, 1] = 1.0 - two * (x * x + z * z)
            e[2, 2] = 1.0 - two * (x * x + y * y)
            e[0, 1], e[1, 0] = two * x * y + one * z, two * x * y - one * z
            e[0, 2], e[2, 0] = two * x * z - one * y, two * x * z + one * y
            e[1, 2], e[2, 1] = two * y * z + one * x, two * y * z - one * x
            for j in range(3):
                r0, r1, r2 = r[0, j], r[1, j], r[2, j]
                for a in range(3):
                    r[a, j] = e[a, 0] * r0 + e[a, 1] * r1 + e[a, 2] * r2
            if only_rotation:
                continue
            e00, e01, e02 = e[0, 0], e[0, 1], e[0, 2]
            e10, e11, e12 = e[1, 0], e[1, 1], e[1, 2]
            e20, e21, e22 = e[2, 0], e[2, 1], e[2, 2]
            # Half of a step's error occurs before it and half after.
            for j in range(7):
                half = 0.25 * dt * (before * last[j] + now * sensed[j])
                s0[j] += half
                s1[7 + j] += half
                s2[14 + j] += half
                result[j] = half
            for j in range(21):
                u, v, w = s0[j], s1[j], s2[j]
                s0[j] = e00 * u + e01 * v + e02 * w
                s1[j] = e10 * u + e11 * v + e12 * w
                s2[j] = e20 * u + e21 * v + e22 * w
            for j in range(7):
                s0[j] += result[j]
                s1[7 + j] += result[j]
                s2[14 + j] += result[j]
            if i <= left[k]:
                continue
            own = dt * dt if i <= reached[k] else 0.0
            for a in range(3):
                for b in range(3):
                    turned[a, b] = e[a, 0] * p[0, b] + e[a, 1] * p[1, b] + e[a, 2] * p[2, b]
            for a in range(3):
                for b in range(3):
                    p[a, b] = (
                        turned[a, 0] * e[b, 0]
                        + turned[a, 1] * e[b, 1]
                        + turned[a, 2] * e[b, 2]
                        + white[a, b] * own
                    )
        for a in range(3):
            for b in range(3):
                rotation[k, a, b] = r[a, b]
        if only_rotation:
            continue
        for a in range(3):
            for b in range(3):
                noise[k, a, b] = p[a, b]
        for b in range(3):
            for j in range(7):
                sensitivity[k, 0, b, j] = s0[7 * b + j]
                sensitivity[k, 1, b, j] = s1[7 * b + j]
                sensitivity[k, 2, b, j] = s2[7 * b + j]


@njit(cache=True, nogil=True, error_model="numpy")
def delay_sums(
    time: Array, output: Array, ends: Ends, back: Array, zero: Array, before: Array, g: float
) -> tuple[Array, Array]:
    """Return Σ d·(f − g u) and Σ d·d for each transition; their ratio is a delay, s; d = g u × ω.

    Parameters
    ----------
    time, output, ends
        As in `inercal.recordings.Transitions`.
    back, zero : (6, m) and (6,) arrays
        Matrix and offset that compute f and ω from the output, SI.
    before : (k, 3) array
        Up in the body frame during the rest before each transition, unit vectors.
    g : float
        Local gravity, m/s².
    """
    _, left, reached, _ = ends
    count = left.size
    along, square = np.zeros(count), np.zeros(count)
    sensed, last = np.empty(6), np.empty(6)
    for k in range(count):
        x, y, z = before[k]
        for i in range(left[k], reached[k] + 1):
            for j in range(6):
                last[j] = sensed[j]
            _corrected_motion(sensed, back, zero, output, i)
            if i > left[k]:
                # u turns by u × ω; using the middle of the step makes it second order.
                h = 0.5 * (time[i] - time[i - 1])
                p, q = h * (last[3] + sensed[3]), h * (last[4] + sensed[4])
                r = h * (last[5] + sensed[5])
                u = x + 0.5 * (y * r - z * q)
                v = y + 0.5 * (z * p - x * r)
                w = z + 0.5 * (x * q - y * p)
                x, y, z = x + v * r - w * q, y + w * p - u * r, z + u * q - v * p
            d0 = y * sensed[5] - z * sensed[4]
            d1 = z * sensed[3] - x * sensed[5]
            d2 = x * sensed[4] - y * sensed[3]
            off0, off1, off2 = sensed[0] - g * x, sensed[1] - g * y, sensed[2] - g * z
            along[k] += g * (d0 * off0 + d1 * off1 + d2 * off2)
            square[k] += g * g * (d0 * d0 + d1 * d1 + d2 * d2)
    return along, square
