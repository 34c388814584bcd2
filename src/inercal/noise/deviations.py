"""Compute Allan, modified, Hadamard, time and total deviations from a series of block means.

Let x be the cumulative sum (x[0] = 0, x in units of y Δ) of y, (n,). For an averaging factor m, the
averaging time is τ = m Δ. Each variance is a mean of squared differences (Riley, NIST SP 1065)::

    oadev   (x[i+2m] − 2 x[i+m] + x[i])²/(2 τ²)
    hdev    (x[i+3m] − 3 x[i+2m] + 3 x[i+m] − x[i])²/(6 τ²)          overlapping; ignores a ramp
    mdev    like oadev, from the means of m sums;  tdev = τ mdev/√3
    totdev  like oadev, from the series reflected at both ends

Above m = 1024, only every (m/16)-th difference is used, because neighbouring differences are nearly
equal. The equivalent degrees of freedom (edf) take this into account. For white and slower noise,
this reduces the edf by 0.5 %. For quantisation noise, neighbouring differences are independent, so
the edf decrease in proportion to the number of differences. With spacing "all", the overlapping
Allan variance uses all n²/4 differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.noise.confidence import (
    LABELS,
    bias_ratio,
    degrees_of_freedom,
    identify_noise,
    interval,
)

# Hadamard total and modified total variance (Howe and Vernotte; NIST SP 1065, 5.2.11 to 5.2.14).
#
# The trend of each subsequence of three averaging times is removed. The subsequence is then
# extended by reflection at both ends to three times its length, and averaged. No bias correction is
# applied.
_MOST = 1 << 22  # largest number of values in one block of subsequences


def total_hadamard_variance(y: Array, m: int) -> tuple[float, int]:
    """Return the Hadamard total variance of y, (n,), at factor m, and the number of subsequences.

    At m = 1, the result is the overlapping Hadamard variance, as SP 1065 defines.
    """
    if m == 1:
        d = y[2:] - 2 * y[1:-1] + y[:-2]
        return float(d @ d) / (6 * d.size), d.size
    total, count = _squares_of_subsequences(y, m)
    return total / (6 * count), count


def total_modified_variance(x: Array, m: int) -> tuple[float, int]:
    """Return the modified total variance of phases x, (n + 1,), and the number of subsequences."""
    total, count = _squares_of_subsequences(x, m)
    return total / (2 * float(m) ** 2 * count), count


def _squares_of_subsequences(series: Array, m: int) -> tuple[float, int]:
    """Return a sum over all subsequences of 3 m values, and the number of subsequences.

    Each subsequence contributes the mean square of the second differences of means of m values.
    """
    length = 3 * m
    half, middle = divmod(length, 2)
    lags = (np.arange(length) - (length - 1) / 2) / (half + middle)
    windows = np.lib.stride_tricks.sliding_window_view(series, length)
    total = 0.0
    step = max(1, _MOST // (9 * m))
    for start in range(0, len(windows), step):
        part = windows[start : start + step]
        slope = part[:, half + middle :].mean(axis=1) - part[:, :half].mean(axis=1)
        flat = part - slope[:, None] * lags
        extended = np.concatenate([flat[:, ::-1], flat, flat[:, ::-1]], axis=1)
        sums = np.cumsum(np.pad(extended, ((0, 0), (1, 0))), axis=1)
        means = (sums[:, m:] - sums[:, :-m]) / m
        d = means[:, 2 * m :] - 2 * means[:, m:-m] + means[:, : -2 * m]
        total += float((d[:, : 6 * m] ** 2).mean(axis=1).sum())
    return total, len(windows)


Spacing = Literal["octave", "decade", "all"]
SPACINGS: tuple[str, ...] = get_args(Spacing)
FULL_OVERLAP = 1024  # largest averaging factor at which every difference is used
_OVERLAP = 16  # number of differences within an averaging time above `FULL_OVERLAP`
_MANY = 100  # with more averaging factors, noise types and edf are interpolated
_COMPILED_FROM, _COMPILED_FACTORS = 2e7, 1000  # samples times factors; number of factors
_PIECE = 1 << 15  # number of samples that stay in the processor's cache
ALLAN, _HADAMARD = (1.0, -2.0, 1.0), (-1.0, 3.0, -3.0, 1.0)
_PHASES = {"adev": 2, "oadev": 2, "mdev": 3, "hdev": 3, "ohdev": 3, "tdev": 3,
           "totdev": 1, "htot": 3, "mtot": 3}  # fmt: skip
KINDS = tuple(_PHASES)


_FEWEST_EDF = 20.0  # the 95 % interval then reaches from 0.77 to 1.45 times the value


@dataclass(frozen=True, eq=False)
class Deviations:
    """A deviation of one channel as a function of averaging time.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    tau : (k,) array
        Averaging times, s.
    value, low, high : (k,) array
        Deviation and the ends of its 95 % interval, in the unit of y (for tdev times s).
    edf : (k,) array
        Equivalent degrees of freedom.
    label : tuple of str
        Noise type at each averaging time, from the lag-1 autocorrelation. It is only a label.
    count : (k,) array of int
        Number of differences that were used.
    """

    kind: str
    tau: Array
    value: Array
    low: Array
    high: Array
    edf: Array
    label: tuple[str, ...]
    count: np.ndarray

    @property
    def lowest(self) -> int:
        """Index of the smallest value, among the values with enough degrees of freedom."""
        usable = max(int(np.count_nonzero(self.edf >= _FEWEST_EDF)), 1)
        return int(np.argmin(self.value[:usable]))


def averaging_factors(n: int, spacing: Spacing, phases: int = 2) -> np.ndarray:
    """Return the averaging factors m for which there is at least one difference: n ≥ phases · m.

    Parameters
    ----------
    n : int
        Number of block means.
    spacing : "octave", "decade" or "all"
        "octave" gives powers of 2, "decade" gives 1, 2 and 4 in each decade, and "all" gives all
        factors.
    phases : int
        Number of averaging times in a difference: 3 for Hadamard and modified deviations, and 2 for
        the others.
    """
    last = max(n // phases, 1)
    if spacing == "all":
        return np.arange(1, last + 1)
    if spacing == "octave":
        return 2 ** np.arange(int(np.log2(last)) + 1)
    found = [int(a * 10**p) for p in range(int(np.log10(last)) + 1) for a in (1, 2, 4)]
    return np.array([m for m in found if m <= last])


def cumulative_sum(y: Array) -> Array:
    """Return the cumulative sum of y minus its mean, (n + 1,); the mean has no effect later."""
    x = np.empty(y.size + 1)
    x[0] = 0.0
    np.cumsum(y - y.mean(), out=x[1:])
    return x


def sum_of_squared_differences(
    x: Array, m: int, coefficients: Sequence[float], stride: int
) -> tuple[float, int]:
    """Return Σ (Σ_j c_j x[i + j m])² over i = 0, stride, 2 stride, …, and the number of terms."""
    reach = (len(coefficients) - 1) * m
    count = (x.size - reach - 1) // stride + 1
    if count <= 0:
        return 0.0, 0
    total, scratch, product = 0.0, np.empty(_PIECE), np.empty(_PIECE)
    for start in range(0, count, _PIECE):
        size = min(_PIECE, count - start)
        d = scratch[:size]
        first = start * stride
        span = (size - 1) * stride + 1
        np.multiply(x[first : first + span : stride], coefficients[0], out=d)
        for j, c in enumerate(coefficients[1:], 1):
            part = x[first + j * m : first + j * m + span : stride]
            if c == 1.0:
                d += part
            else:
                d += np.multiply(part, c, out=product[:size])
        # Do not use d @ d, because its threads wait for one another if the processor is busy.
        total += float(np.add.reduce(np.multiply(d, d, out=product[:size])))
    return total, count


def stride_of(m: int) -> int:
    """Return the step between the differences that are used at an averaging factor."""
    return 1 if m <= FULL_OVERLAP else m // _OVERLAP


def default_strides(factors: np.ndarray) -> np.ndarray:
    """Return `stride_of` for each averaging factor."""
    return np.where(factors <= FULL_OVERLAP, 1, factors // _OVERLAP)


def _difference_variance(x: Array, m: int, kind: str) -> tuple[float, int]:
    hadamard = kind in ("hdev", "ohdev")
    stride = m if kind in ("adev", "hdev") else stride_of(m)
    coefficients = _HADAMARD if hadamard else ALLAN
    total, count = sum_of_squared_differences(x, m, coefficients, stride)
    return total / (count * (6.0 if hadamard else 2.0) * m**2), count


def _modified_variance(doubled: Array, m: int) -> tuple[float, int]:
    total, count = sum_of_squared_differences(doubled, m, _HADAMARD, stride_of(m))
    return total / (count * 2.0 * float(m) ** 4), count


def _total_variance(x: Array, m: int) -> tuple[float, int]:
    """Return the total variance, computed from x reflected at both ends, and its count."""
    head, tail = 2 * x[0] - x[1:m][::-1], 2 * x[-1] - x[-m:-1][::-1]
    extended = np.concatenate([head, x, tail])
    total, count = sum_of_squared_differences(extended, m, ALLAN, stride_of(m))
    return total / (count * 2.0 * m**2), count


def variance(x: Array, m: int, kind: str) -> tuple[float, int]:
    """Return a variance at an averaging factor, with Δ = 1, and the number of differences.

    Parameters
    ----------
    x : (n + 1,) array
        Result of `cumulative_sum`.
    m : int
    kind : str
        One of `KINDS`; for "tdev", the modified variance is returned.
    """
    if kind in ("mdev", "tdev"):
        return _modified_variance(cumulative_sum(x), m)
    if kind == "totdev":
        return _total_variance(x, m)
    if kind == "htot":
        return total_hadamard_variance(np.diff(x), m)
    if kind == "mtot":
        return total_modified_variance(x, m)
    return _difference_variance(x, m, kind)


def deviations(
    y: Array,
    dt: float,
    kind: str = "oadev",
    spacing: Spacing = "octave",
    factors: Sequence[int] | None = None,
) -> Deviations:
    """Return a deviation of y, (n,), with 95 % intervals.

    Total deviations include the bias corrections from SP 1065 for the noise type that is identified
    from the lag-1 autocorrelation.

    Parameters
    ----------
    y : (n,) array
        Block means over `dt`, in any unit.
    dt : float
        Sampling interval Δ, s.
    kind : str
        One of `KINDS`.
    spacing : "octave", "decade" or "all"
        Averaging times. With "all", the overlapping Allan deviation also uses every difference.
    factors : sequence of int, optional
        Averaging factors to use instead of `spacing`.

    Raises
    ------
    InputError
        The kind is unknown, the series is too short, or a factor is too large for the series.
    """
    if kind not in KINDS:
        raise InputError(
            f"there is no deviation {kind!r}; the kinds are {', '.join(KINDS)}", key="--deviation"
        )
    if y.size < 3:
        raise InputError(f"{y.size} values are too few for an Allan deviation; give at least 3")
    phases = _PHASES[kind]
    chosen = averaging_factors(y.size, spacing, phases) if factors is None else np.asarray(factors)
    if chosen.min() < 1 or chosen.max() * phases > y.size:
        raise InputError(
            f"averaging factors of {y.size} values must be 1 to {y.size // phases}, not "
            f"{chosen.min()} to {chosen.max()}"
        )
    x = cumulative_sum(y)
    every = kind == "oadev" and spacing == "all" and factors is None
    strides = np.ones_like(chosen) if every else default_strides(chosen)
    values, counts = _variances(x, chosen, kind, strides)
    alphas = _names(x, chosen)
    return with_intervals(kind, chosen, values, counts, alphas, y.size, dt, strides)


def _variances(
    x: Array, factors: np.ndarray, kind: str, strides: np.ndarray
) -> tuple[Array, list[int]]:
    """Return the variances at all factors, with Δ = 1, and the numbers of differences.

    Only the overlapping Allan variance can have other strides than `stride_of`.
    """
    if kind != "oadev" or x.size * min(factors.size, _COMPILED_FACTORS) < _COMPILED_FROM:
        if kind == "oadev":
            steps = zip(factors.tolist(), strides.tolist(), strict=True)
            sums = [(m, *sum_of_squared_differences(x, m, ALLAN, stride)) for m, stride in steps]
            found = [(total / (count * 2.0 * m**2), count) for m, total, count in sums]
        elif kind in ("mdev", "tdev"):
            doubled = cumulative_sum(x)
            found = [_modified_variance(doubled, int(m)) for m in factors]
        else:
            found = [variance(x, int(m), kind) for m in factors]
        return np.array([one[0] for one in found]), [one[1] for one in found]
    # Numba takes a second to load, which only pays off for long calculations.
    from inercal.noise._kernels import squared_second_differences

    factors, strides = factors.astype(np.int64), strides.astype(np.int64)
    counts = (x.size - 2 * factors - 1) // strides + 1
    totals = squared_second_differences(x, factors, strides, np.zeros_like(factors))
    return totals / (2.0 * counts * factors.astype(np.float64) ** 2), counts.tolist()


def _names(x: Array, factors: np.ndarray) -> list[int]:
    """Return α at each factor; if there are many factors, α of the nearest of about a hundred."""
    nodes = _nodes(factors)
    alphas = [identify_noise(x, int(m)) for m in nodes]
    nearest = np.searchsorted(np.sqrt(nodes[1:] * nodes[:-1].astype(np.float64)), factors)
    return [alphas[k] for k in nearest]


def _nodes(factors: np.ndarray) -> np.ndarray:
    """Select about a hundred of many factors, evenly spaced on a logarithmic scale."""
    if factors.size <= _MANY:
        return factors
    places: Array = np.geomspace(float(factors[0]), float(factors[-1]), _MANY)
    return np.unique(factors[np.minimum(np.searchsorted(factors, places), factors.size - 1)])


def _interpolated_edf(
    kind: str, factors: np.ndarray, alphas: Sequence[int], n: int, strides: np.ndarray
) -> Array:
    """Return the equivalent degrees of freedom, interpolated if there are many factors."""
    names, nodes = np.array(alphas), _nodes(factors)
    steps = np.maximum(np.rint(factors / strides).astype(np.int64), 1)
    overlap = dict(zip(factors.tolist(), steps.tolist(), strict=True))
    edf = np.empty(factors.size)
    for alpha in np.unique(names):
        some = names == alpha
        at = [degrees_of_freedom(kind, int(alpha), m, n, overlap[m]) for m in nodes.tolist()]
        edf[some] = np.exp(np.interp(np.log(factors[some]), np.log(nodes), np.log(at)))
    return edf


def with_intervals(
    kind: str,
    factors: np.ndarray,
    variances: Array,
    counts: Sequence[int],
    alphas: Sequence[int],
    n: int,
    dt: float,
    strides: np.ndarray | None = None,
) -> Deviations:
    """Convert variances with Δ = 1 to deviations in the unit of y, with 95 % intervals.

    Parameters
    ----------
    kind : str
    factors : (k,) array of int
    variances : (k,) array
    counts : sequence of k int
        Numbers of differences that were used.
    alphas : sequence of k int
    n : int
        Number of block means.
    dt : float
        Sampling interval Δ, s.
    strides : (k,) array of int, optional
        Steps between the differences; by default, `stride_of` each factor.
    """
    strides = default_strides(factors) if strides is None else strides
    tau = factors * dt
    pairs = list(zip(factors, alphas, strict=True))
    edf = _interpolated_edf(kind, factors, alphas, n, strides)
    corrected = variances / np.array([bias_ratio(kind, a, int(m), n) for m, a in pairs])
    value = np.sqrt(corrected) * (tau / np.sqrt(3) if kind == "tdev" else 1.0)
    low, high = interval(value, edf)
    labels = tuple(LABELS[a] for a in alphas)
    return Deviations(kind, tau, value, low, high, edf, labels, np.array(counts))
