"""Compute columns for score tests of terms that the turntable methods omit.

A column is the effect of one unit of a constant q. The effect is an increment of the gyros'
attitude error φ or of the velocity of accelerometers at rest (d), or a shift of φ as observed by
the readback (c), in the level frame and with the signs of `strapdown`::

    coefficient    d = −∫ C M e_a φ_q(f, ω) dt    (gyros; accelerometers with +)
    drift          d = −∫ C M e_a (t − t_mid)/T dt: its size is the change over the run; and
                   cosines of 1/2, 1, … MODES/2 periods over it, which stand for slow changes
    latitude       d = −∂Ω/∂λ Δt                  azimuth  d = Ω_north Δt about east
    table          c = −B_q                       latency, clock  c = −ω, −ω (t − t₀)

f and ω come from the readback at the middle of an epoch. A table parameter that a method estimates
with its stated prior also has a column, so the test can find an error beyond the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import ErrorName
from inercal.benches.turntable.attitude import earth_rate_level_frame as earth_rate
from inercal.benches.turntable.attitude import linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.estimation import Candidate
from inercal.estimation.scores import CandidateKind
from inercal.methods.candidates import LARGEST_RELATIVE_SIZE, family_name, largest_angle
from inercal.methods.turntable.model import TriadModel
from inercal.physics.frames import exp_so3, log_so3
from inercal.physics.motion import Motion
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.coefficient_tables import SI_UNITS, TABLES

# Number of cosines that describe a slow change of a bias over the run. There are few, because the
# candidates share the significance level, and a candidate with many columns takes a large part.
DRIFT_MODES = 4
_MIN_HARMONICS = 3  # minimum number tested per axis
# Groups of coefficients; a track does not contain the rate of the temperature.
_EXCLUDED_GROUPS = ("arm", "rotation", "temperature_rate")


@dataclass(frozen=True)
class ConstantColumn:
    """One constant: name, unit, largest plausible size (SI), and the candidates that contain it."""

    name: str
    kind: CandidateKind
    unit: str
    largest: float
    families: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ConstantColumns:
    """The effects of D driving constants and B observed constants at e epochs.

    Parameters
    ----------
    driving_columns, observed_columns : tuples of ConstantColumn
    driving_effects : (e, 3, D) array
    observed_effects : (e, 3, B) array
    """

    driving_columns: tuple[ConstantColumn, ...]
    driving_effects: Array
    observed_columns: tuple[ConstantColumn, ...]
    observed_effects: Array

    @property
    def columns(self) -> tuple[ConstantColumn, ...]:
        """The constants that drive the state, then those that only observations contain."""
        return self.driving_columns + self.observed_columns


class ColumnInputs(NamedTuple):
    """The inputs from which the columns of a triad are computed."""

    triad: TriadModel
    bench: Turntable
    theta: Array  # (p,), estimated coefficients
    time: Array  # (e,) s
    angles: Array  # (e, k) rad, readback
    temperature_offset: Array | None  # (e,), as for `sensor_columns`


@lru_cache(maxsize=64)
def sensor_of_omitted_coefficients(sensor: Sensor, *, temperature_varies: bool = False) -> Sensor:
    """Return a triad with all coefficients of its tables that are not estimated.

    Temperature coefficients are included only if `temperature_varies`, that is, if the temperature
    is known and changes.
    """
    names = tuple(
        full
        for axis in sensor.axes
        for one in TABLES[axis.measures]
        if one.group not in _EXCLUDED_GROUPS
        and (temperature_varies or not one.basis.uses("dT"))
        and (full := f"{axis.name}.{one.name}") not in sensor.coefficients
    )
    return replace(sensor, coefficients=names)


def sensor_columns(
    part: TriadModel,
    motion: Motion,
    time: Array,
    warmth: Array | None = None,
    run: tuple[float, float] | None = None,
) -> tuple[tuple[ConstantColumn, ...], Array]:
    """Return columns for coefficients and bias changes, as effects on readings, (n, 3, D).

    Parameters
    ----------
    part : TriadModel
    motion : Motion
        Motion of n samples.
    time : (n,) array
        Time of each sample, s.
    warmth : (n,) array, optional
        Temperature minus the sensor's reference temperature, K, if it is known and varies.
    run : (float, float), optional
        First and last time of the run, s, if `time` does not cover all of it.
    """
    larger = sensor_of_omitted_coefficients(part.sensor, temperature_varies=warmth is not None)
    motion = motion if warmth is None else replace(motion, dT=warmth)
    design = larger.design(motion, np.zeros(len(larger.coefficients)))
    columns: list[ConstantColumn] = []
    for full, unit_scale in zip(larger.coefficients, larger.unit_scale.tolist(), strict=True):
        unit = SI_UNITS[larger.coefficient(full).unit]
        families = (family_name(larger.coefficient(full)), full)
        columns.append(
            ConstantColumn(full, "coefficient", unit, LARGEST_RELATIVE_SIZE * unit_scale, families)
        )
    kind = part.sensor.axes[0].measures
    start, end = run or (float(time[0]), float(time[-1]))
    span = end - start or 1.0
    share = (time - start) / span
    shapes = [share - 0.5, *(np.cos(np.pi * k * share) for k in range(1, DRIFT_MODES + 1))]
    drift = np.zeros((len(time), 3, 3 * len(shapes)))
    for k, shape in enumerate(shapes):
        for a, axis in enumerate(part.sensor.axes):
            drift[:, a, 3 * k + a] = shape
            name = f"drift of {axis.name}"
            families = (f"drift of {QUANTITIES[kind].sensors}", name)
            if k > 0:
                name = f"mode {k} of {axis.name}"
                families = (f"slow changes of {QUANTITIES[kind].sensors}",)
            largest = LARGEST_RELATIVE_SIZE * (G0 if kind == "f" else 1.0)
            columns.append(ConstantColumn(name, "time", QUANTITIES[kind].unit, largest, families))
    return tuple(columns), np.concatenate([design, drift], axis=-1)


def gyro_columns(
    epochs: ColumnInputs, first: int = 0, stop: int | None = None
) -> tuple[ConstantColumns, Array]:
    """Return the columns for gyros with attitude readback, and c before the first epoch.

    Parameters
    ----------
    epochs : ColumnInputs
        Inputs at e + 1 epochs, the first of which is the start of the run.
    first, stop : int, optional
        Range within the e epochs that follow, for which columns are computed; by default all.

    Returns
    -------
    ConstantColumns
        Columns for stop − first epochs.
    c : (3, B) array
        Values at the epoch before them.
    """
    part, bench, theta, whole, angles, warmth = epochs
    stop = len(whole) - 1 if stop is None else stop
    # The rate at an epoch depends on the next epoch.
    taken, count = slice(first, min(stop + 2, len(whole))), stop - first
    time, angles = whole[taken], angles[taken]
    warmth = None if warmth is None else warmth[taken]
    run = float(whole[1] + whole[0]) / 2, float(whole[-1] + whole[-2]) / 2
    mat, since = reference_attitude(bench, angles), np.diff(time)
    since = np.where(since > 0, since, np.inf)  # nothing is needed at the epoch where a run begins
    back = mat.mT
    turned = log_so3(mat[1:] @ back[:-1])  # in the level frame
    middle = exp_so3(turned / 2) @ mat[:-1]
    earth = earth_rate(bench)
    rate = np.zeros((len(time), 3))
    rate[1:] = turned / since[:, None]
    level = middle.mT
    sensed = Motion(
        level @ np.array([0.0, 0.0, bench.gravity.value]),
        (level @ (rate[1:] + earth)[..., None])[..., 0],
    )
    since = np.where(np.isfinite(since), since, 0.0)
    between = None if warmth is None else (warmth[1:] + warmth[:-1]) / 2
    columns, readings = sensor_columns(part, sensed, (time[1:] + time[:-1]) / 2, between, run)
    cm = middle @ _inverse_scale_matrix(part, theta)
    of_place = np.zeros((len(since), 3, 2))
    of_place[:, 0, 0] = earth[1] * since
    of_place[:, :, 1] = -np.array([0.0, -earth[2], earth[1]]) * since[:, None]
    driven = np.concatenate([-(cm @ readings) * since[:, None, None], of_place], axis=-1)
    places = (_bench_column("azimuth", "rad"), _bench_column("latitude", "rad"))
    observed, by = table_columns(bench, angles, ("lean_x", "lean_y", "azimuth"))
    # The rate at an epoch is the mean of the rates before and after it.
    rate[1:-1] = (rate[1:-1] + rate[2:]) / 2
    late = np.stack([-rate, -rate * (time - whole[0])[:, None]], axis=-1)
    seen = np.concatenate([by, late], axis=-1)
    observed = (*observed, _bench_column("latency", "s"), _bench_column("clock", "1"))
    result = ConstantColumns((*columns, *places), driven[:count], observed, seen[1 : count + 1])
    return result, seen[0]


def accelerometer_columns(
    epochs: ColumnInputs, first: int = 0, stop: int | None = None
) -> ConstantColumns:
    """Return the columns for accelerometers on a stationary table, as velocities.

    The first epoch of a hold has no effect.

    Parameters
    ----------
    epochs : ColumnInputs
        Inputs at e epochs.
    first, stop : int, optional
        Range of epochs for which columns are computed; by default all.
    """
    part, bench, theta, whole, angles, warmth = epochs
    taken = slice(first, stop)
    time, angles = whole[taken], angles[taken]
    warmth = None if warmth is None else warmth[taken]
    mat, run = reference_attitude(bench, angles), (float(whole[0]), float(whole[-1]))
    columns, readings = sensor_columns(part, static_motion(bench, mat), time, warmth, run)
    since = np.diff(time, prepend=whole[max(first - 1, 0)])
    driven = (mat @ _inverse_scale_matrix(part, theta) @ readings) * since[:, None, None]
    observed, by = table_columns(bench, angles, ("azimuth",))
    return ConstantColumns(columns, driven, observed, by)


def static_mean_columns(epochs: ColumnInputs) -> tuple[tuple[ConstantColumn, ...], Array]:
    """Return the columns for n means of accelerometers at rest, as readings, (n, 3, c)."""
    part, bench, theta, time, angles, warmth = epochs
    mat = reference_attitude(bench, angles)
    columns, readings = sensor_columns(part, static_motion(bench, mat), time, warmth)
    observed, by = table_columns(bench, angles, ("azimuth",))
    force = np.array([0.0, 0.0, bench.gravity.value])
    # The true attitude differs from the readback's by −c.
    turned = mat.mT @ np.cross(force[:, None], -by, axis=-2)
    result = [readings, np.linalg.inv(_inverse_scale_matrix(part, theta)) @ turned]
    return (*columns, *observed), np.concatenate(result, axis=-1)


def static_motion(bench: Turntable, mat: Array) -> Motion:
    """Return the motion that a sensor senses on a stationary table in attitudes (n, 3, 3)."""
    back = mat.mT
    return Motion(back @ np.array([0.0, 0.0, bench.gravity.value]), back @ earth_rate(bench))


def table_columns(
    bench: Turntable, angles: Array, but: Sequence[str]
) -> tuple[tuple[ConstantColumn, ...], Array]:
    """Return table parameters except `but`, and how each shifts the observed φ, (n, 3, B)."""
    count = max(_MIN_HARMONICS, len(bench.harmonics))
    sizes = (*bench.harmonics, *(1.0 for _ in range(count - len(bench.harmonics))))
    seen = linear_misalignment(replace(bench, harmonics=sizes), angles)
    kept = [k for k, one in enumerate(seen.parameters) if one.name not in but]
    columns = tuple(_bench_column(seen.parameters[k].name, "rad") for k in kept)
    return columns, -seen.by[..., kept]


def stack_columns(
    parts: Sequence[tuple[Sequence[ConstantColumn], Array]],
) -> tuple[tuple[ConstantColumn, ...], Array]:
    """Return the columns of all parts, and their rows (m, c), one part after the other.

    Parameters
    ----------
    parts : sequence of (columns, rows)
        Each part has rows (m, c). A column that two parts share appears once.
    """
    found = {column.name: column for columns, _ in parts for column in columns}
    at = {name: k for k, name in enumerate(found)}
    result = np.zeros((sum(len(rows) for _, rows in parts), len(at)))
    first = 0
    for columns, rows in parts:
        result[first : first + len(rows), [at[one.name] for one in columns]] = rows
        first += len(rows)
    return tuple(found.values()), result


def families(bench: Turntable) -> dict[str, tuple[str, ...]]:
    """Return the families of table parameters, by the name of their candidate."""
    found: dict[str, tuple[str, ...]] = {}
    for one in bench.parameters:
        for name in _bench_column(one.name, one.unit).families:
            found[name] = (*found.get(name, ()), one.name)
    return found


def candidates(
    columns: Sequence[ConstantColumn], rows: Array, moved: Array | None
) -> list[Candidate]:
    """Return a candidate for each family of columns.

    Parameters
    ----------
    columns : sequence of c ConstantColumn
    rows : (m, c) array
        Whitened rows; if `moved` is given, without the part that the estimate absorbs.
    moved : (q, c) array or None
        Shift of each parameter caused by one unit of each column.
    """
    found: dict[str, list[int]] = {}
    for k, one in enumerate(columns):
        for name in one.families:
            found.setdefault(name, []).append(k)
    result: list[Candidate] = []
    by_column = np.ascontiguousarray(rows.T)  # because whole columns are read
    for name, at in found.items():
        if len(at) == 1 and columns[at[0]].families[-1] != name:
            continue  # the only member of a family is a candidate by itself
        chosen = [columns[k] for k in at]
        result.append(
            Candidate(
                name,
                chosen[0].kind,
                tuple(one.name for one in chosen),
                tuple(one.unit for one in chosen),
                by_column[at].T,
                None if moved is None else moved[:, at],
                np.array([one.largest for one in chosen]),
            )
        )
    return result


def _bench_column(name: str, unit: str) -> ConstantColumn:
    """Return a bench parameter's column, tested separately and with the others of its key."""
    wave, axis = ErrorName(name).parts
    if axis and wave[:3] in ("sin", "cos"):
        families = (f"harmonics[{axis}]", f"harmonic {wave[3:]}[{axis}]")
    else:
        key = name.partition("_")[0]
        families = (key, name) if key in ("lean", "square") else (name,)
    return ConstantColumn(name, "bench", unit, largest_angle(name), families)


def _inverse_scale_matrix(part: TriadModel, theta: Array) -> Array:
    """Return M = (N + S)⁻¹ as in `strapdown`."""
    terms = part.terms
    result = terms.nominal.copy()
    for axis, weights, c in zip(terms.axis, terms.weights, theta, strict=True):
        result[axis] += c * weights[terms.first : terms.first + 3]
    return np.asarray(np.linalg.inv(result), dtype=float)
