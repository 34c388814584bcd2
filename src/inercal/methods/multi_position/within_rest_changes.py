"""The change of the accelerometers within a rest, minus the tilt by the gyros.

A hand sways: a tilt across gravity is not a fault. With Δf̂ the change of f̂ from the first half of
a rest to the second and θ what the corrected rate turns through between their mean attitudes
(`inercal.recordings.segments.rest_changes`), three rows for each rest are

    d = Δf̂ − f̂ × θ

whitened by the noise of both. They add no information on the coefficients and are used for tests
only: of a step in the middle of a rest, which also moves the rest's mean by half the step, and of a
drift of the biases. The push of a hand scatters d: along gravity and across, each rest is tested
against the scatter of the others where this exceeds their noise.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.hand.bench import tangent_vectors
from inercal.estimation import Candidate
from inercal.estimation.residual_scatter import leave_one_out_factors
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.methods.multi_position.rotations import inverse_model, inverse_models
from inercal.methods.multi_position.row_whitening import reading_sensitivities, sum_over_rests
from inercal.physics.frames import skew
from inercal.physics.motion import Motion


@dataclass(frozen=True, eq=False)
class RestChanges:
    """The rows of all rests, whitened.

    Parameters
    ----------
    residual : (3 r,) array
    by_reading : (r, 3, m) array
        Of each rest's rows to a change of each accelerometer's reading, SI.
    drift : mapping of str to (3 r,) array
        To a drift of each accelerometer's bias over the span of the rests, by name.
    """

    residual: Array
    by_reading: Array
    drift: dict[str, Array]

    def added_columns(self, one: Candidate) -> Array:
        """Return what a candidate adds to these rows, (3 r, k)."""
        nothing = np.zeros(len(self.residual))
        return np.stack([self.drift.get(name, nothing) for name in one.components], axis=-1)


def rest_changes(
    rests: Rests, rows: ResidualRows, x: Array, scatter: Scatter
) -> RestChanges | None:
    """Return the rows at x; None without gyros, or of means.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        At x.
    x : (p + 8,) array
        All coefficients and what is known beside them.
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
        model = inverse_model(sensor, x[:p])
        turned = halves.integral @ model.matrix.T
    else:
        model = inverse_models(sensor, x[:p], rests.temperature_offsets)
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
    # The wobble of a hand is in the gyros' scatter, of which only a share is noise.
    of_turn = scatter.turn.share * halves.square[:, None, None] * rests.rate_noise
    of_turn = of_turn + halves.seconds[:, None, None] ** 2 * offset
    by_turn = basis @ skew(sensed)
    to_reading = basis @ back
    noise = to_reading @ of_force @ np.swapaxes(to_reading, -1, -2)
    noise += by_turn @ of_turn @ np.swapaxes(by_turn, -1, -2)
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
    """Yield a step in the middle of each rest: its rows of the fit, not whitened, and (3 r, m)."""
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
    """Yield each component of a step by itself.

    All at once would be a push of the hand, which `inercal.recordings.segments.section_noise`
    judges along gravity.
    """
    for k, (name, unit) in enumerate(zip(step.components, step.units, strict=True)):
        yield Candidate(name, step.kind, (name,), (unit,), step.rows[:, [k]])
