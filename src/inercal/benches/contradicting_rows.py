"""Find rows of a table that contradict the bench, when a fit has failed.

One wrong entry can make a nonlinear fit diverge, so this check needs no fit by the method. It fits
y = S f + b to the readings y and the nominal specific force f, each row divided by its |f|, with
Cauchy's loss and a threshold that is halved step by step, as in
`inercal.methods.centrifuge_norm.screening`. It begins with a sensor without errors, so a wrong
angle or rate does not attract the fit. If attitudes are not known, it compares norms.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, pairwise
from math import degrees, pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import MeanBench
from inercal.physics.plan import Index, Spin, arm_attitude
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

_THRESHOLDS = (0.5, 0.25, 0.12, 0.06, *[0.03] * 10)  # relative to |f|
_VECTORS, _NORMS, _SCATTER = 0.05, 0.3, 8.0  # limits, relative to |f|; times the median residual
_FEWEST, _COLUMN, _MOST_LISTED, _MOST_REPAIRS = 6, 4, 4, 3  # rows, rows, rows, changes
_LARGEST_ERROR = 0.3  # of scale factors and axes
_REPAIR_WORDS = {
    "sign": "changing the sign of",
    "exchange": "exchanging",
    "decimal": "moving the decimal point of",
    "digit": "changing the digit of",
}
_Steps = Sequence[Spin | Index]


@dataclass(frozen=True)
class _Nominal:
    """The nominal motion of a bench, compared with readings as vectors or as norms."""

    bench: MeanBench
    norms: bool

    def off(self, read: Array, steps: _Steps, fit: Array) -> Array:
        """Return the residuals of the rows relative to |f|, (r,)."""
        f = self.bench.mean_motion(steps, {}).f
        size = np.linalg.norm(f, axis=-1)
        if self.norms:
            return np.abs(np.linalg.norm(read, axis=-1) / size - 1)
        columns = np.concatenate([f, np.full((len(f), 1), G0)], axis=-1)
        return np.linalg.norm(read - columns @ fit, axis=-1) / size

    def fit(self, read: Array, steps: _Steps, axes: Array) -> Array:
        """Return S and b, (4, m), which rows with large residuals hardly affect."""
        f = self.bench.mean_motion(steps, {}).f
        columns = np.concatenate([f, np.full((len(f), 1), G0)], axis=-1)
        fit = np.concatenate([axes.T, np.zeros((1, len(axes)))])
        for threshold in _THRESHOLDS if not self.norms else ():
            weight = 1 / np.hypot(1.0, self.off(read, steps, fit) / threshold)
            weight = (weight / np.linalg.norm(f, axis=-1))[:, None]
            found = np.linalg.lstsq(weight * columns, weight * read, rcond=1e-6)
            fit = np.asarray(found[0], dtype=float)
        return fit


def contradicting_rows(
    observations: Observations, sensor: Sensor, bench: object, steps: Sequence[object]
) -> tuple[str, tuple[str, ...]]:
    """Return what is wrong, and the labels of the wrong rows; both are empty if nothing is found.

    A mistake in a whole column of angles is named if its correction makes the rows agree.
    """
    triad, moves = sensor.select_axes("f"), [s for s in steps if isinstance(s, Spin | Index)]
    read, axes = observations.mean[..., : len(triad.axes)], triad.input_axes("f")
    if read.ndim != axes.ndim or not _FEWEST <= len(moves) == len(read) or not len(axes):
        return "", ()
    norms = any(isinstance(step, Spin) and step.attitude is None for step in moves)
    if norms:
        moves = [replace(step, attitude=arm_attitude(0.0, 0.0)) for step in moves]
    if not isinstance(bench, MeanBench) or any(getattr(s, "azimuth", None) for s in moves):
        return "", ()
    nominal, least = _Nominal(bench, norms), _NORMS if norms else _VECTORS
    fit = nominal.fit(read, moves, axes)
    off = nominal.off(read, moves, fit)
    several = not norms and np.sum(off > least) >= _COLUMN
    for text, others in _other_columns(moves) if several else ():
        other = nominal.fit(read, others, axes)
        near = np.abs(other[:-1].T - axes).max() < _LARGEST_ERROR
        if near and np.sum(nominal.off(read, others, other) > least) <= 1:
            return f"the readings only agree with the bench if {text}", ()
    limit = max(least, _SCATTER * float(np.median(off)))
    wild = np.flatnonzero(off > limit).tolist()
    labels = tuple(observations.labels[k] for k in wild)
    peaks = {f"{np.abs(triad.to_output(read[k])).max():.6g}" for k in wild}
    if len(wild) >= _COLUMN and len(peaks) == 1:
        text = f"the largest reading of {', '.join(labels[:_MOST_LISTED])} and other rows is always"
        return f"{text} {peaks.pop()}, where the output is clipped; remove these rows", labels
    lines: list[str] = []
    for k in wild[:_MOST_LISTED]:
        fitting = (
            [text for text, y, step in some if nominal.off(y[None], [step], fit)[0] < limit]
            for some in _changes(read[k], triad, moves, k, norms=norms)
        )
        repairs = next(filter(None, fitting), list[str]())
        line = f"{observations.labels[k]} is off by {100 * off[k]:.0f} % of the force"
        if 0 < len(repairs) <= _MOST_REPAIRS:
            line += f", which {' or '.join(repairs)} would correct"
        lines.append(line)
    more = f"; and {len(wild) - len(lines)} more" if len(wild) > len(lines) else ""
    text = f"rows contradict the bench: {'; '.join(lines)}{more}; check them, or remove them"
    return (text, labels) if lines else ("", ())


def _changes(
    read: Array, triad: Sensor, moves: _Steps, k: int, *, norms: bool
) -> Iterator[list[tuple[str, Array, Spin | Index]]]:
    """Yield lists of single changes to row k, as text, reading and step; one digit comes last."""
    own, written = moves[k], triad.to_output(read)

    def entries(some: Iterable[Repair]) -> list[tuple[str, Array, Spin | Index]]:
        values = dict(zip(triad.channels, written.tolist(), strict=True))
        after = ((one.describe(), list((values | one.after).values())) for one in some)
        return [(text, triad.to_si(np.array(row)), own) for text, row in after]

    *kinds, digits = single_changes(written, triad.channels)
    found = entries(chain(*kinds))
    if isinstance(own, Index):
        for angle in dict.fromkeys(s.angle for s in moves if isinstance(s, Index)):
            found.append((f"an angle of {degrees(angle):.6g}°", read, replace(own, angle=angle)))
    else:
        spins = [step for step in moves if isinstance(step, Spin)]
        for rate in dict.fromkeys(step.rate for step in spins):
            found.append((f"a rate of {rate * 30 / pi:.6g} rpm", read, replace(own, rate=rate)))
        for attitude, label in {s.attitude: s.label for s in spins if not norms}.items():
            text = f"the attitude of {label}"
            found.append((text, read, replace(own, attitude=attitude)))
    yield found
    yield entries(digits)


def _other_columns(moves: _Steps) -> Iterator[tuple[str, _Steps]]:
    """Yield frequent mistakes in a whole column of angles, and the steps without the mistake."""
    key = "angle" if isinstance(moves[0], Index) else "attitude"
    for shift, word in ((1, "down"), (-1, "up")):
        right = [getattr(step, key) for step in (*moves[shift:], *moves[:shift])]
        text = f"its angles or mountings are moved {word} by one row; move them back"
        yield text, [replace(a, **{key: b}) for a, b in zip(moves, right, strict=True)]
    known = [step.attitude for step in moves if isinstance(step, Spin)]
    if not known or any(one is None or one.name or one.up[1] for one in known):
        return
    out, up = (np.array([getattr(one, name) for one in known]).T for name in ("out", "up"))
    theta = np.arctan2(up[0], -up[2])  # the inverse of `arm_attitude`
    psi = np.arctan2(out[1], out[2] * up[0] - out[0] * up[2])
    radians = 'its angles are in rad; state [data] attitude_unit = "rad"'
    for text, one, two in (
        ("its columns of ψ and θ are exchanged; correct [data] attitude", theta, psi),
        (radians, np.degrees(psi), np.degrees(theta)),
    ):
        right = map(arm_attitude, one.tolist(), two.tolist())
        yield text, [replace(a, attitude=b) for a, b in zip(moves, right, strict=True)]


@dataclass(frozen=True)
class Repair:
    """One change to a row: entries before and after it, in output units, by axis."""

    kind: str  # "sign", "exchange", "decimal" or "digit"
    before: dict[str, float]
    after: dict[str, float]

    def describe(self) -> str:
        """Return a description such as "changing the sign of az (0.743943 → −0.743943)"."""
        names = " and ".join(self.before)
        pairs = [f"{self.before[a]:.9g} → {self.after[a]:.9g}" for a in self.before]
        return f"{_REPAIR_WORDS[self.kind]} {names} ({', '.join(pairs)})".replace("-", "−")


def single_changes(written: Array, channels: Sequence[str]) -> Iterator[list[Repair]]:
    """Yield lists of single changes to a row, one list per kind, the simplest kind first."""
    named = dict(zip(channels, written.tolist(), strict=True))
    yield [Repair("sign", {a: v}, {a: -v}) for a, v in named.items() if v]
    yield [
        Repair("exchange", {a: named[a], b: named[b]}, {a: named[b], b: named[a]})
        for a, b in combinations(channels, 2)
        if named[a] != named[b]
    ]
    yield [
        Repair("decimal", {a: v}, {a: float(f"{v * factor:.9g}")})
        for a, v in named.items()
        for factor in (10.0, 0.1)
        if v
    ]
    yield [
        Repair("digit", {a: v}, {a: other}) for a, v in named.items() for other in _digit_changes(v)
    ]


def _digit_changes(value: float) -> list[float]:
    """Return all numbers with one digit changed or two neighbouring digits exchanged."""
    text = f"{value:.9g}"
    places = [k for k, c in enumerate(text) if c.isdigit()]
    changed = {
        float(text[:k] + d + text[k + 1 :]) for k in places for d in "0123456789" if d != text[k]
    }
    for j, k in pairwise(places):
        swapped = list(text)
        swapped[j], swapped[k] = swapped[k], swapped[j]
        changed.add(float("".join(swapped)))
    return sorted(changed - {value})
