"""List candidates for the score tests of multi_position: terms that its fits omit.

A candidate adds an error to the readings. At the rests, this error enters the rows in the same way
as noise (`row_whitening.reading_sensitivities`). Between rests, a gyro error changes the rotations
of the transitions, which are integrated again with a small error δ::

    column = (ρ(ω + δ basis) − ρ(ω)) / δ

The candidates are sensor coefficients that are not estimated, the stated gravity and latitude, the
recording's clock, a drift of the biases over the run, and arbitrary errors of single rests. A wrong
gravity only changes the accelerometers' scale, and a wrong clock only the gyros' scale. Both are
candidates, because the verdict also lists effects that no residual shows. Further misalignments of
the accelerometers are not candidates: they only turn the frame, which the accelerometers define.

The change of the accelerometers' reading within a rest is compared with the tilt that the gyros
measure. A hand sways slightly, so it is not an error if a hand-held sensor tilts during a rest. Let
Δf̂ be the change of f̂ from the first half of a rest to the second, and θ the rotation between
their mean attitudes from the corrected rate (`inercal.recordings.segments.rest_changes`). Each rest
has three rows

    d = Δf̂ − f̂ × θ

The rows are whitened by the noise of both terms. They add no information about the coefficients and
are only used for tests. One test is for a step in the middle of a rest, which also moves the rest's
mean by half the step. The other is for a drift of the biases. A push of the hand increases the
scatter of d. Each rest is therefore tested against the scatter of the other rests, along gravity
and across it, if this scatter exceeds their noise.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches.hand.bench import tangent_vectors
from inercal.estimation import Candidate
from inercal.estimation.residual_scatter import leave_one_out_factors
from inercal.methods.candidates import (
    LARGEST_RELATIVE_SIZE,
    Column,
    candidate,
    coefficient_column,
    family_name,
    largest_angle,
    together_and_alone,
)
from inercal.methods.multi_position import rotations
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.methods.multi_position.row_whitening import reading_sensitivities, sum_over_rests
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.frames import exp_so3, skew
from inercal.physics.motion import Motion
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.sensors import G0, Sensor

Basis = Callable[[Motion], Array]

_TESTED_GROUPS = {
    "f": ("nonlinearity", "asymmetry", "cross"),
    "w": ("nonlinearity", "asymmetry", "g"),
}
_GRAVITY, _EARTH_UP, _CLOCK = 0, 3, 4  # their indices in x after the coefficients
_TURN_STEP = 1e-4  # rad, largest turn that a candidate causes over all transitions
_CHUNK_SAMPLES = 100_000  # samples
_ROUNDING_LIMIT = 1e-12  # SI per SI unit; smaller effects are rounding


def candidates(rests: Rests, rows: ResidualRows, x: Array) -> Iterator[Candidate]:
    """Yield the candidates with the derivatives of all rows, which are not whitened.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        Rows at x, with the attitudes that the fit keeps constant.
    x : (p + 5,) array
        All coefficients, followed by the other known quantities.
    """
    enter = reading_sensitivities(rests, rows)
    yield from _coefficient_candidates(rests, rows, x, enter)
    yield from _drift_candidates(rests, rows, x, enter)
    yield from _statement_candidates(rests, rows)
    yield from _single_rest_candidates(rests, enter)


def _tested(sensor: Sensor, kind: str) -> tuple[str, ...]:
    """Return the groups that are candidates; g² terms only if the g terms are estimated."""
    squares = kind == "w" and "g" in {sensor.coefficient(n).group for n in sensor.coefficients}
    return (*_TESTED_GROUPS[kind], *(("g2",) if squares else ()))


def _extended_sensor(sensor: Sensor, more: tuple[str, ...]) -> Sensor:
    words = [word for kind in {a.measures for a in sensor.axes} for word in _tested(sensor, kind)]
    return sensor.with_coefficients(*sorted({*words, *more}))


def _coefficient_candidates(
    rests: Rests, rows: ResidualRows, x: Array, enter: Array
) -> Iterator[Candidate]:
    """Yield the coefficients that are not estimated, tested by kind and then one by one."""
    more = ("temperature",) if rests.observations.temperature_varies else ()
    sensor, larger = rests.sensor, _extended_sensor(rests.sensor, more)
    warmth = rests.observations.temperature_offset(sensor.reference_temperature)
    at_rest = Motion(rows.norm.specific_force, np.zeros_like(rows.norm.specific_force), dT=warmth)
    of_samples = rests.recorded_transition_offsets
    kinds: dict[tuple[str, str], list[Column]] = {}
    turned = _rotation_column(rests, rows, x)
    for full in larger.coefficients:
        name = CoefficientName(full).axis
        axis = next(k for k, one in enumerate(sensor.axes) if one.name == name)
        measures = sensor.axes[axis].measures
        tested = (*_tested(sensor, measures), *more)
        if full in sensor.coefficients or larger.coefficient(full).group not in tested:
            continue
        alone = replace(sensor, axes=(sensor.axes[axis],), coefficients=(full,))

        def basis(motion: Motion, alone: Sensor = alone) -> Array:
            return alone.design(motion, np.zeros(1))[:, 0, 0]

        column = _reading_column(rests, enter, axis, basis(at_rest))
        if measures == "w":

            def added(motion: Motion, at: slice, basis: Basis = basis) -> Array:
                warm = 0.0 if of_samples is None else of_samples[at]
                return basis(replace(motion, dT=warm))

            column += turned(axis, added)
        if np.max(np.abs(column)) > _ROUNDING_LIMIT:
            kind = measures, family_name(larger.coefficient(full))
            kinds.setdefault(kind, []).append(coefficient_column(larger, full, column))
    for (_, kind), own in kinds.items():
        yield from together_and_alone("coefficient", [(kind, own)])


def _reading_column(rests: Rests, enter: Array, axis: int, size: Array) -> Array:
    """Return the column for an error added to one axis's mean readings, (r,)."""
    return sum_over_rests(rests, enter[:, :, [axis]] * size[:, None, None])[:, 0]


def _rotation_column(
    rests: Rests, rows: ResidualRows, x: Array
) -> Callable[[int, Callable[[Motion, slice], Array]], Array]:
    """Return a function that computes how an error of one gyro axis changes the rotations.

    Its arguments are the axis, and the error of the samples as a function of their motion.
    """
    nothing = np.zeros(len(rows.residual))
    way, turns = rests.transitions, rows.rotations
    if way is None or turns is None or rows.attitude is None:
        return lambda axis, basis: nothing
    sensor, p = rests.sensor, len(rests.sensor.coefficients)
    model = rotations.inverse_model(sensor, x[:p], float(np.mean(rests.temperature_offsets)))
    size = np.empty(len(way.output))
    # One column at a time is changed and restored, because a copy of a long recording may not fit.
    changed = way.output if way.output.flags.writeable else way.output.copy()
    seconds = float(np.median(way.duration))
    r, k = len(rows.norm.residual), len(way.rest)
    earth = rows.attitude[way.rest + 1] * way.duration[:, None, None]
    turned, clock = earth @ x[p + 1 : p + 4], x[-1]
    across = rests.cross_directions[way.rest + 1] @ exp_so3(turned)
    up = rows.norm.up[way.rest, :, None]

    def column(axis: int, basis: Callable[[Motion, slice], Array]) -> Array:
        # In chunks, because the motion of all samples takes more memory than the samples.
        for start in range(0, len(size), _CHUNK_SAMPLES):
            piece = slice(start, start + _CHUNK_SAMPLES)
            both = way.output[piece] @ model.matrix.T + model.offset
            size[piece] = basis(Motion(both[:, :3], both[:, 3:]), piece)
        step = _TURN_STEP / max(float(np.abs(size).max()) * seconds, 1e-300)
        np.multiply(size, sensor.axes[axis].readout.scale * step, out=size)
        before = changed[:, axis].copy()
        try:
            changed[:, axis] += size
            there = rests.rotations_only(replace(way, output=changed), x[:p], clock)
        finally:
            changed[:, axis] = before
        found = nothing.copy()
        found[r : r + 2 * k] = (across @ (turns.way.rotation - there) @ up).ravel() / step
        return found

    return column


def _drift_candidates(
    rests: Rests, rows: ResidualRows, x: Array, enter: Array
) -> Iterator[Candidate]:
    """Yield a drift of the biases, linear in time from the first rest to the last."""
    time, way = rests.observations.time, rests.transitions
    span, middle = float(np.ptp(time)), float(time.mean())
    if len(time) < 3 or not span > 0:
        return
    turned = _rotation_column(rests, rows, x)
    shape = (time - middle) / span
    columns: dict[Measures, list[Column]] = {}
    for k, axis in enumerate(rests.sensor.axes):
        column = _reading_column(rests, enter, k, shape)
        if way is not None and axis.measures == "w":
            of_samples = (way.time - middle) / span
            column += turned(k, lambda _, piece, of_samples=of_samples: of_samples[piece])
        drift = Column(f"drift of {axis.name}", QUANTITIES[axis.measures].unit, column)
        columns.setdefault(axis.measures, []).append(drift)
    for kind, own in columns.items():
        yield from together_and_alone("time", [(f"drift of {QUANTITIES[kind].sensors}", own)])


def _statement_candidates(rests: Rests, rows: ResidualRows) -> Iterator[Candidate]:
    """Yield the stated gravity, latitude and clock as candidates.

    The latitude acts through the vertical part of the earth's rate, Ω sin φ.
    """
    first, bench, place = len(rests.sensor.coefficients), rests.bench, rests.bench.place
    stated = [("g", "m/s²", bench.gravity, 1.0, _GRAVITY, LARGEST_RELATIVE_SIZE * G0)]
    if rests.transitions is not None:
        clock = Measured(0.0, bench.timebase)
        stated.append(("timebase", "1", clock, 1.0, _CLOCK, LARGEST_RELATIVE_SIZE))
        if place is not None:
            _, north = earth_rate_up_north(place.value)
            stated.append(("latitude", "rad", place, north, _EARTH_UP, largest_angle("latitude")))
    for name, unit, value, factor, place_in_x, largest in stated:
        rows_of = factor * rows.jacobian[:, first + place_in_x]
        yield candidate(name, "bench", [Column(name, unit, rows_of, largest, value.sd)])


def _single_rest_candidates(rests: Rests, enter: Array) -> Iterator[Candidate]:
    """Yield each rest as a candidate, with its time if known.

    Accelerometers and gyros are separate candidates, because a test of six directions at once would
    take a large share of the significance level from all others.
    """
    sensor, seen = rests.sensor, rests.observations
    kinds = {one.measures for one in sensor.axes if one.measures == "f" or rests.transitions}
    for kind in sorted(kinds):
        axes = [k for k, one in enumerate(sensor.axes) if one.measures == kind]
        for k, (label, time) in enumerate(zip(seen.labels, seen.time.tolist(), strict=True)):
            own = np.zeros((len(enter), enter.shape[1], len(axes)))
            own[k] = enter[k][:, axes]
            names = tuple(f"{sensor.axes[a].name}[{label}]" for a in axes)
            name = f"{label} at {time:.4g} s" if seen.timed else label
            name += f" ({QUANTITIES[kind].sensors})" * (len(kinds) > 1)
            yield Candidate(
                name, "row", names, (QUANTITIES[kind].unit,) * len(axes), sum_over_rests(rests, own)
            )


@dataclass(frozen=True, eq=False)
class RestChanges:
    """Whitened rows for the changes within all rests.

    Parameters
    ----------
    residual : (3 r,) array
    by_reading : (r, 3, m) array
        Sensitivity of each rest's rows to each accelerometer's reading, SI.
    drift : mapping of str to (3 r,) array
        Sensitivity to a drift of each accelerometer's bias over the span of the rests, by name.
    """

    residual: Array
    by_reading: Array
    drift: dict[str, Array]

    def added_columns(self, one: Candidate) -> Array:
        """Return a candidate's effect on these rows, (3 r, k)."""
        nothing = np.zeros(len(self.residual))
        return np.stack([self.drift.get(name, nothing) for name in one.components], axis=-1)


def rest_changes(
    rests: Rests, rows: ResidualRows, x: Array, scatter: Scatter
) -> RestChanges | None:
    """Return the rows at x, or None if there are no gyros or only means.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        The rows of the fit at x.
    x : (p + 8,) array
        All coefficients, followed by the other known quantities.
    scatter : Scatter
    """
    seen = rests.observations
    halves = seen.halves
    if halves is None or rests.transitions is None or rows.attitude is None:
        return None
    sensor, m, p = rests.sensor, rests.m, len(rests.sensor.coefficients)
    scale = np.array([axis.readout.scale for axis in sensor.axes[:m]])
    back = np.broadcast_to(rows.norm.by_reading, (len(seen.labels), 3, m))
    force = np.einsum("kim,km->ki", back, halves.change[:, :m] / scale)
    if not rests.temperature_offsets.ndim:
        model = rotations.inverse_model(sensor, x[:p])
        turned = halves.integral @ model.matrix.T
    else:
        model = rotations.inverse_models(sensor, x[:p], rests.temperature_offsets)
        turned = (model.matrix @ halves.integral[..., None])[..., 0]
    both = turned + halves.seconds[:, None] * model.offset
    turn = both[:, 3:] - (rows.attitude @ x[p + 1 : p + 4]) * halves.seconds[:, None]
    sensed = rows.norm.specific_force
    basis = np.concatenate([rows.norm.up[:, None], tangent_vectors(rows.norm.up)], axis=1)
    if rests.temperature_offsets.ndim and halves.warming is not None:
        ends = (rests.temperature_offsets + halves.warming, rests.temperature_offsets)
        warmed, cold = (sensor.forward(Motion(sensed, dT=t), x[:p])[:, :m] for t in ends)
        force = force - np.einsum("kim,km->ki", back, warmed - cold)
    change = np.einsum("kij,kj->ki", basis, force - np.cross(sensed, turn))

    flicker = rests.noise - seen.covariance
    of_force = 4 * scatter.force.of(seen.covariance[:, :m, :m]) + flicker[:, :m, :m]
    offset = flicker[:, m:, m:] + scatter.rate.excess**2 * np.eye(3)
    # The hand's tremor is part of the gyros' scatter, and only a share of it counts as noise.
    of_turn = scatter.turn.share * halves.square[:, None, None] * rests.rate_noise
    of_turn = of_turn + halves.seconds[:, None, None] ** 2 * offset
    by_turn = basis @ skew(sensed)
    to_reading = basis @ back
    noise = to_reading @ of_force @ to_reading.mT
    noise += by_turn @ of_turn @ by_turn.mT
    factor = np.linalg.cholesky(noise)
    both = np.concatenate([to_reading, change[..., None]], axis=-1)
    solved: Array = np.asarray(np.linalg.solve(factor, both), dtype=np.float64)
    columns, white = solved[..., :-1], solved[..., -1]
    for part in (slice(0, 1), slice(1, 3)):
        held = leave_one_out_factors(white[:, part], seen.dof)[:, None]
        white[:, part] *= held
        columns[:, part] *= held[..., None]
    span = max(float(np.ptp(seen.time)), 1e-300)
    slope = columns * (halves.seconds / span)[:, None, None]
    drift = {f"drift of {sensor.axes[a].name}": slope[..., a].ravel() for a in range(m)}
    return RestChanges(white.ravel(), columns, drift)


def step_candidates(
    rests: Rests, rows: ResidualRows, changed: RestChanges
) -> Iterator[tuple[Candidate, Array]]:
    """Yield a step in the middle of each rest, with its effect on the changes (3 r, m).

    The derivatives of the fit's rows in the candidate are not whitened.
    """
    m, r = rests.m, len(rests.observations.labels)
    enter = reading_sensitivities(rests, rows)[..., :m]
    names = [axis.name for axis in rests.sensor.axes[:m]]
    for k, label in enumerate(rests.observations.labels):
        own = np.zeros_like(enter)
        own[k] = 0.5 * enter[k]
        below = np.zeros((r, 3, m))
        below[k] = changed.by_reading[k]
        candidate = Candidate(
            f"change within {label}",
            "time",
            tuple(f"change of {name} within {label}" for name in names),
            ("m/s²",) * m,
            sum_over_rests(rests, own),
        )
        yield candidate, below.reshape(-1, m)


def component_candidates(step: Candidate) -> Iterator[Candidate]:
    """Yield each component of a step as its own candidate.

    A step of all components at once would be a push of the hand, which
    `inercal.recordings.segments.section_noise` judges along gravity.
    """
    for k, (name, unit) in enumerate(zip(step.components, step.units, strict=True)):
        yield Candidate(name, step.kind, (name,), (unit,), step.rows[:, [k]])
