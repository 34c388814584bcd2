"""What the fits of multi_position leave out or take as known: candidates of its score tests.

A candidate adds something to the readings. What it adds at the rests enters the rows as their noise
does (`chain.entering`); what it adds to the gyros on the way turns the passages, whose rotations
are integrated once more with it, for a small step of the candidate::

    column = (ρ(ω + δ basis) − ρ(ω)) / δ

The candidates are coefficients of the sensor that were not asked for, a drift of the biases over
the run, and single rests, whose readings may be anything. The accelerometers' misalignments beside
those that are estimated turn the frame alone, gravity changes the accelerometers' scale alone and
the recording's clock the gyros' scale alone: no residual shows them, and they are none.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.estimate import Candidate
from inercal.keys import CoefficientName
from inercal.methods.candidates import family
from inercal.methods.multi_position.chain import entering, placed
from inercal.methods.multi_position.rests import Rests, Rows
from inercal.methods.multi_position.rotations import affine, carried, rotations
from inercal.motion import Motion
from inercal.sensors import SI_UNITS, Sensor

Basis = Callable[[Motion], Array]

_WORDS = {"f": ("nonlinearity", "asymmetry", "cross"), "w": ("nonlinearity", "asymmetry", "g")}
_NAMES = {"f": "accelerometers", "w": "gyros"}
_UNITS = {"f": "m/s²", "w": "rad/s"}
_STEP = 1e-4  # rad that a candidate turns in all passages at most
_PIECE = 100_000  # samples
_LEAST = 1e-12  # SI per SI unit; less is rounding


def candidates(rests: Rests, rows: Rows, x: Array) -> Iterator[Candidate]:
    """Yield the candidates with the derivatives of all rows, not whitened.

    Parameters
    ----------
    rests : Rests
    rows : Rows
        At x, with the attitudes that the fit holds.
    x : (p + 5,) array
        All coefficients and what is known beside them.
    """
    enter = entering(rests, rows)
    yield from _of_coefficients(rests, rows, x, enter)
    yield from _of_drift(rests, rows, x, enter)
    yield from _of_rests(rests, enter)


def _larger(sensor: Sensor, more: tuple[str, ...]) -> Sensor:
    words = [word for kind in {a.measures for a in sensor.axes} for word in _WORDS[kind]]
    return sensor.with_coefficients(*sorted({*words, *more}))


def _of_coefficients(rests: Rests, rows: Rows, x: Array, enter: Array) -> Iterator[Candidate]:
    """Return the coefficients that are not estimated: those of a kind together, and each alone."""
    more = ("temperature",) if rests.observations.warmed else ()
    sensor, larger = rests.sensor, _larger(rests.sensor, more)
    warmth = rests.observations.temperature_offset(sensor.reference_temperature)
    at_rest = Motion(rows.norm.felt, np.zeros_like(rows.norm.felt), dT=warmth)
    of_samples = rests.recorded_on_the_way
    columns: dict[str, Array] = {}
    kinds: dict[tuple[str, str], list[str]] = {}
    turned = _turning(rests, rows, x)
    for full in larger.coefficients:
        name = CoefficientName(full).axis
        axis = next(k for k, one in enumerate(sensor.axes) if one.name == name)
        measures = sensor.axes[axis].measures
        if full in sensor.coefficients or not any(
            _of(word, larger, full) for word in (*_WORDS[measures], *more)
        ):
            continue
        alone = replace(sensor, axes=(sensor.axes[axis],), coefficients=(full,))

        def basis(motion: Motion, alone: Sensor = alone) -> Array:
            return alone.design(motion, np.zeros(1))[:, 0, 0]

        column = _added(rests, enter, axis, basis(at_rest))
        if measures == "w":

            def added(motion: Motion, at: slice, basis: Basis = basis) -> Array:
                warm = 0.0 if of_samples is None else of_samples[at]
                return basis(replace(motion, dT=warm))

            column += turned(axis, added)
        if np.max(np.abs(column)) > _LEAST:
            columns[full] = column
            kinds.setdefault((measures, family(larger.coefficient(full))), []).append(full)
    for (_, kind), members in kinds.items():
        together = [(kind, tuple(members))] if len(members) > 1 else []
        for name, chosen in (*together, *((full, (full,)) for full in members)):
            units = tuple(SI_UNITS[larger.coefficient(full).unit] for full in chosen)
            rows_of = np.stack([columns[full] for full in chosen], axis=-1)
            largest = np.array([larger.coefficient(full).largest for full in chosen])
            yield Candidate(name, "coefficient", chosen, units, rows_of, largest=largest)


def _of(word: str, sensor: Sensor, full: str) -> bool:
    return sensor.coefficient(full).group == word


def _added(rests: Rests, enter: Array, axis: int, size: Array) -> Array:
    """Return the column of what is added to one axis' mean readings, (r,)."""
    return placed(rests, enter[:, :, [axis]] * size[:, None, None])[:, 0]


def _turning(
    rests: Rests, rows: Rows, x: Array
) -> Callable[[int, Callable[[Motion, slice], Array]], Array]:
    """Return a function of an axis and of what is added to its samples, by their motion.

    It gives the column of what that does to the rotations.
    """
    nothing = np.zeros(len(rows.residual))
    way, turns = rests.passages, rows.turns
    if way is None or turns is None or rows.way is None or rows.attitude is None:
        return lambda axis, basis: nothing
    sensor, p = rests.sensor, len(rests.sensor.coefficients)
    model = affine(sensor, x[:p], float(np.mean(rests.warmth)))
    size = np.empty(len(way.output))
    # One column at a time is changed and put back: a copy of a long recording would not fit.
    changed = way.output if way.output.flags.writeable else way.output.copy()
    seconds = float(np.median(way.duration))
    r, k = len(rows.norm.residual), len(way.rest)
    earth = rows.attitude[way.rest + 1] * way.duration[:, None, None]
    clock = x[-1]

    def column(axis: int, basis: Callable[[Motion, slice], Array]) -> Array:
        # Piece by piece: of all samples their motion alone would take more room than they do.
        for start in range(0, len(size), _PIECE):
            piece = slice(start, start + _PIECE)
            both = way.output[piece] @ model.back.T + model.zero
            size[piece] = basis(Motion(both[:, :3], both[:, 3:]), piece)
        step = _STEP / max(float(np.abs(size).max()) * seconds, 1e-300)
        np.multiply(size, sensor.axes[axis].readout.scale * step, out=size)
        before = changed[:, axis].copy()
        try:
            changed[:, axis] += size
            moved_way = replace(way, output=changed)
            there = carried(moved_way, sensor, x[:p], rests.white, clock, rests.warmth_on_the_way)
        finally:
            changed[:, axis] = before
        moved = rotations(way.rest, there, rows.norm.felt, rests.across, earth @ x[p + 1 : p + 4])
        found = nothing.copy()
        found[r : r + 2 * k] = ((moved.residual - turns.residual) / step).ravel()
        return found

    return column


def _of_drift(rests: Rests, rows: Rows, x: Array, enter: Array) -> Iterator[Candidate]:
    """Return a drift of the biases, linear in time from the first rest to the last."""
    time, way = rests.observations.time, rests.passages
    span, middle = float(np.ptp(time)), float(time.mean())
    if len(time) < 3 or not span > 0:
        return
    turned = _turning(rests, rows, x)
    shape = (time - middle) / span
    columns: dict[str, list[tuple[str, Array]]] = {}
    for k, axis in enumerate(rests.sensor.axes):
        column = _added(rests, enter, k, shape)
        if way is not None and axis.measures == "w":
            of_samples = (way.time - middle) / span
            column += turned(k, lambda _, piece, of_samples=of_samples: of_samples[piece])
        columns.setdefault(axis.measures, []).append((f"drift of {axis.name}", column))
    for kind, members in columns.items():
        together = [(f"drift of {_NAMES[kind]}", members)] if len(members) > 1 else []
        for name, chosen in (*together, *((one[0], [one]) for one in members)):
            yield Candidate(
                name,
                "time",
                tuple(full for full, _ in chosen),
                (_UNITS[kind],) * len(chosen),
                np.stack([column for _, column in chosen], axis=-1),
            )


def _of_rests(rests: Rests, enter: Array) -> Iterator[Candidate]:
    """Return each rest by itself, its accelerometers and its gyros, with its time where known.

    Apart: six directions at once would take a large share of the level from all other candidates.
    """
    sensor, seen = rests.sensor, rests.observations
    kinds = {one.measures for one in sensor.axes if one.measures == "f" or rests.passages}
    for kind in sorted(kinds):
        axes = [k for k, one in enumerate(sensor.axes) if one.measures == kind]
        for k, (label, time) in enumerate(zip(seen.labels, seen.time.tolist(), strict=True)):
            own = np.zeros((len(enter), enter.shape[1], len(axes)))
            own[k] = enter[k][:, axes]
            names = tuple(f"{sensor.axes[a].name}[{label}]" for a in axes)
            name = f"{label} at {time:.4g} s" if seen.timed else label
            name += f" ({_NAMES[kind]})" * (len(kinds) > 1)
            yield Candidate(name, "row", names, (_UNITS[kind],) * len(axes), placed(rests, own))
