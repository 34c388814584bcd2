"""Find the threshold, resolution and dead band of a sensor from small inputs about a centre.

The readings follow one of three laws of response R of half width d::

    y = b + K R(z)       law          R(z), 0 up to |z| = d      half of the output at
                         play         sgn z (|z| − d)            2 d
                         lock-in      sgn z √(z² − d²)           2 d/√3
                         jump         z                          d

z is the input minus the centre. The dead band is ±d. The threshold is the least input that gives
half of the output that K predicts, and the resolution is the same about a centre that is not zero
(IEEE Std 528). K is known within 0.1 % from larger inputs, or nominal within 5 %. If inputs were
reached from both sides, hysteresis is a nuisance. If the input about which the response is
symmetric is not known exactly, its offset is another one.

For d, the profile likelihood of all three laws is taken as a distribution, with the same weight for
each d and each law. Its mean, standard deviation and 95 % interval are the result. A band is
detected if it reduces χ² by 12 or more compared with d = 0; with d = 0 and normal noise, this
happens in about one case in a thousand. If χ² is improbably large, all variances are enlarged.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import hypot, inf, nan, sqrt
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.input_output_tests import (
    Figure,
    InputOutput,
    enlargement,
    has_both_senses,
    loop_shape,
)

_GAIN = 12.0  # least reduction of χ² for a band
_SAME = 1e-9  # relative to the largest input
_REACH = 1.5  # times the largest small input: the widest band
_GRID, _FINE, _ROUNDS = 200, 121, 3
_WIDE = 3.5  # standard deviations of the centre
_OFFSETS, _FINE_OFFSETS = (4, 60), 31
_NEAR = 25.0  # χ² above the minimum that still counts
_LINE_SCALE, _NOMINAL_SCALE = 1e-3, 0.05  # sd of K about small inputs, with and without a line
_TENTH = 0.1
_STEEPEST = 3.0  # slope of lock-in at its edge
_FEWEST = 4  # different small inputs on which a band needs readings


@dataclass(frozen=True)
class Band:
    """The response to small inputs about a centre.

    Parameters
    ----------
    law : str
        The law with the largest likelihood: "play", "lock-in" or "jump".
    width : Figure
        Half width d of the dead band.
    threshold : Figure
        Least small input that gives half of the expected output.
    """

    law: str
    width: Figure
    threshold: Figure


# Half of the output at this many half widths, and R for z ≥ d.
_LAWS: dict[str, tuple[float, Callable[[Array, Array], Array]]] = {
    "play": (2.0, lambda z, d: z - d),
    "lock-in": (2 / sqrt(3), lambda z, d: np.sqrt(np.maximum(z**2 - d**2, 0.0))),
    "jump": (1.0, lambda z, d: z + 0 * d),
}


def _responses(law: str, z: Array, width: Array) -> Array:
    """Return R of k widths, (k, n), for small inputs, (k, n) or (1, n)."""
    size, d = np.abs(z), width[:, None]
    return np.where(size >= d, np.sign(z) * _LAWS[law][1](size, d), 0.0)


def small_inputs(table: InputOutput, reach: float) -> list[tuple[float, Indices]]:
    """Return the centres about which small inputs were applied, with the rows of each.

    A centre is zero, or the input that was applied most often among inputs within `reach`, which
    must also be within a tenth of the centre. It needs four or more different small inputs, on both
    sides. The small inputs follow each other, because a larger input before a small one may leave
    another hysteresis. The first input, which follows a larger one, is therefore left out.

    Parameters
    ----------
    table : InputOutput
    reach : float
        Largest small input.
    """
    found: list[tuple[float, Indices]] = []
    step = _SAME * table.full_scale
    whole, counts = np.unique(np.round(table.x / step), return_counts=True)
    values = whole * step
    used = np.zeros(len(table.x), dtype=np.bool_)
    for centre in (0.0, *values[np.argsort(-counts, kind="stable")].tolist()):
        limit = reach if centre == 0 else min(reach, _TENTH * abs(centre))
        near = ~used & (np.abs(table.x - centre) <= limit)
        rows = np.array(_after_small_inputs(table, near), dtype=np.int64)
        small = np.unique(np.round((table.x[rows] - centre) / step))
        if np.sum(np.abs(small) > 1) >= _FEWEST and (small < -1).any() and (small > 1).any():
            found.append((centre, rows))
            used |= near
    return found


def _after_small_inputs(table: InputOutput, near: Bools) -> list[int]:
    """Return the rows whose input was reached from another small input in the same setting.

    The first row of a setting counts if a small input follows it.
    """
    joined = near[1:] & near[:-1] & (np.diff(table.setting) == 0)
    rows: list[int] = []
    for k in np.flatnonzero(near).tolist():
        if k and table.setting[k - 1] == table.setting[k]:
            reached = joined[k - 1] and (table.x[k - 1] != table.x[k] or k - 1 in rows)
        else:
            reached = k < len(joined) and joined[k]
        if reached:
            rows.append(k)
    return rows


@dataclass(frozen=True, eq=False)
class _SmallSeries:
    """Whitened rows of small inputs, without what the bias and the hysteresis explain.

    K is known beforehand to be `slope`, with the standard deviation `slope_sd`, and the offset of
    the centre to be 0, with `offset_sd`.
    """

    table: InputOutput
    z: Array
    basis: Array
    slope: float
    slope_sd: float
    offset_sd: float

    def away(self, rows: Array) -> Array:
        """Return rows, (k, n), whitened and without what the bias and the hysteresis explain."""
        white = self.table.whiten(rows.T)
        return (white - self.basis @ (self.basis.T @ white)).T

    def chi2(self, read: Array, response: Array) -> Array:
        """Return χ² with the best K, for readings and responses without bias, (k, n) or (1, n)."""
        weight = self.slope_sd**-2
        product = np.sum(response * read, axis=1) + self.slope * weight
        known = np.sum(read**2, axis=1) + self.slope**2 * weight
        return known - product**2 / (np.sum(response**2, axis=1) + weight)

    def misfit(self, read: Array, law: str, width: Array, offset: Array) -> Array:
        """Return χ² of a law for each offset of the centre, (a,), and each width, (b,): (a, b)."""
        o, d = (one.ravel() for one in np.meshgrid(offset, width, indexing="ij"))
        seen = self.away(_responses(law, self.z - o[:, None], d))
        known = (o / self.offset_sd) ** 2 if self.offset_sd else 0.0
        return (self.chi2(read, seen) + known).reshape(len(offset), len(width))

    def detectable(self, law: str, width: Array, gain: float) -> float:
        """Return the least width that raises χ² of a response without a band by `gain`."""
        given = self.slope * self.away(_responses(law, self.z[None], width))
        raised = self.chi2(given, self.away(self.z[None])) >= gain
        return float(width[np.argmax(raised)]) if raised.any() else inf


class _Grid(NamedTuple):
    """Offsets of the centre, (a,), widths, (b,), and χ² of a law, (a, b)."""

    offset: Array
    width: Array
    chi2: Array

    @property
    def cell(self) -> float:
        """Size of a cell of the grid."""
        offset = self.offset[1] - self.offset[0] if len(self.offset) > 1 else 1.0
        return float(offset * (self.width[1] - self.width[0]))

    def near(self, limit: float) -> tuple[Array, Array]:
        """Return finer offsets and widths where χ² is below a limit, with one cell around."""
        below = self.chi2 <= limit
        ends: list[tuple[float, float]] = []
        for values, some in ((self.offset, below.any(axis=1)), (self.width, below.any(axis=0))):
            rows = np.flatnonzero(some)
            first, last = max(rows[0] - 1, 0), min(rows[-1] + 1, len(values) - 1)
            ends.append((float(values[first]), float(values[last])))
        offsets = 1 if len(self.offset) == 1 else _FINE_OFFSETS
        return np.linspace(*ends[0], offsets), np.linspace(*ends[1], _FINE)


def response_band(
    table: InputOutput, centre: float, line: Figure | None, centre_sd: float = 0.0
) -> Band:
    """Return threshold and dead band from small inputs about a centre.

    Parameters
    ----------
    table : InputOutput
        Only the rows of the small inputs.
    centre : float
        Input about which they were applied.
    line : Figure or None
        The slope from inputs that are much larger; None means the nominal slope 1, within 5 %.
    centre_sd : float
        Standard deviation of the input about which the response is symmetric.
    """
    band = _band(table, centre, line, centre_sd)
    if not band.width.detected:
        return band
    # A reading shows the errors of the inputs by the slope of the law: not at all inside the band.
    z, width, step = table.x - centre, np.array([band.width.value]), _SAME * table.full_scale
    high, low = (_responses(band.law, z[None] + change, width)[0] for change in (step, -step))
    slope = ((high - low) / (2 * step)).clip(0.0, _STEEPEST)
    more = table.errors * (np.outer(slope, slope) - 1.0)
    return _band(replace(table, covariance=table.covariance + more), centre, line, centre_sd)


def _band(table: InputOutput, centre: float, line: Figure | None, centre_sd: float) -> Band:
    z = table.x - centre
    top = float(np.abs(z).max())
    free = (table.setting[:, None] == np.unique(table.setting)).astype(float)
    if has_both_senses(table):
        free = np.c_[free, loop_shape(table)]
    basis = np.linalg.qr(table.whiten(free))[0]
    known = (1.0, _NOMINAL_SCALE) if line is None else (line.value, hypot(line.u, _LINE_SCALE))
    series = _SmallSeries(table, z, basis, *known, centre_sd)
    read = series.away(table.y[None])
    widths, offsets = np.linspace(0.0, _REACH * top, _GRID + 1), np.zeros(1)
    if centre_sd:
        step = 1 / sqrt(float(np.diagonal(np.linalg.inv(table.covariance)).max()))  # noise
        half = int(np.clip(_WIDE * centre_sd / step, *_OFFSETS))
        offsets = np.linspace(-_WIDE * centre_sd, _WIDE * centre_sd, 2 * half + 1)
    grids = {
        law: _Grid(offsets, widths, series.misfit(read, law, widths, offsets)) for law in _LAWS
    }
    dof = len(z) - free.shape[1] - 1 - (len(offsets) > 1)
    # A coarse grid misses the least χ², so its size is judged only after the search.
    found = _search(series, read, grids, 1.0)
    wider = enlargement(_least(found), dof) ** 2
    grids = found if wider == 1 else _search(series, read, grids, wider)
    least = _least(grids)
    law = min(grids, key=lambda name: float(grids[name].chi2.min()))
    parts = [
        (one.width, _LAWS[name][0] * one.width,
         one.cell * np.exp((least - one.chi2) / (2 * wider)).sum(axis=0))
        for name, one in grids.items()
    ]  # fmt: skip
    width, limit, share = (np.concatenate(each) for each in zip(*parts, strict=True))
    none = float(series.chi2(read, series.away(z[None]))[0])
    shown = (none - least) / wider >= _GAIN
    sizes = {name: series.detectable(name, widths, _GAIN * wider) for name in _LAWS}
    most = (max(sizes.values()), max(_LAWS[name][0] * size for name, size in sizes.items()))
    figures = [
        distribution(values, share, detected=shown, detectable=size)
        for values, size in zip((width, limit), most, strict=True)
    ]
    return Band(law, *figures)


def _least(grids: Mapping[str, _Grid]) -> float:
    return min(float(one.chi2.min()) for one in grids.values())


def _search(
    series: _SmallSeries, read: Array, grids: Mapping[str, _Grid], wider: float
) -> dict[str, _Grid]:
    """Return finer grids where χ² is near its least value, with variances enlarged by `wider`."""
    for _ in range(_ROUNDS):
        limit = _least(grids) + _NEAR * wider
        finer = {law: one.near(max(limit, float(one.chi2.min()))) for law, one in grids.items()}
        grids = {law: _Grid(o, d, series.misfit(read, law, d, o)) for law, (o, d) in finer.items()}
    return dict(grids)


def distribution(
    values: Array, share: Array, *, detected: bool = True, detectable: float = nan
) -> Figure:
    """Return the characteristic of values with these weights, as mean and interval."""
    values, share = (one.ravel() for one in np.broadcast_arrays(values, share))
    order = np.argsort(values, kind="stable")
    values, share = values[order], share[order] / share.sum()
    mean = float(share @ values)
    u = sqrt(float(share @ (values - mean) ** 2))
    before = np.cumsum(share) - share / 2
    low, high, bound = np.interp([0.025, 0.975, 0.95], before, values).tolist()
    return Figure(mean, u, low, high, detected, bound, detectable)
