"""What turntable methods leave out: columns for score tests, epoch by epoch.

A column is how one unit of a constant q drives the error φ of a gyro's attitude or the velocity
of accelerometers at rest (d), or how it shifts φ as the readback shows it (c), in the level frame
and with the signs of `strapdown`::

    coefficient    d = −∫ C M e_a φ_q(f, ω) dt    (gyros; accelerometers with +)
    drift          d = −∫ C M e_a (t − t_mid)/T dt: its size is the change over the run; and
                   cosines of 1/2, 1, … MODES/2 periods over it, which stand for slow changes
    latitude       d = −∂Ω/∂λ Δt                  azimuth  d = Ω_north Δt about east
    table          c = −B_q                       latency, clock  c = −ω, −ω (t − t₀)

f and ω are those of the readback in the middle of an epoch. A parameter of the table that a method
estimates within its stated deviation is a column too: what it departs by beyond that shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.attitude import earth as earth_rate
from inercal.benches.turntable.attitude import misalignment, reference
from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Candidate
from inercal.estimate.scores import Kind
from inercal.frames import exp_so3, log_so3
from inercal.keys import ErrorName
from inercal.methods.candidates import LARGEST, family, largest_angle
from inercal.methods.turntable.model import Triad
from inercal.motion import Motion
from inercal.sensors import G0, Sensor
from inercal.sensors.tables import SI_UNITS, TABLES

# Cosines over the run that a slow change of a bias is described by: few, as the level is shared
# among candidates, and one of many columns takes much of it.
MODES = 4
_HARMONICS = 3  # of each axis, tested at least
_NOT_FELT = ("arm", "rotation")  # groups of coefficients
_UNITS = {"f": "m/s²", "w": "rad/s"}
_WORDS = {"f": "accelerometers", "w": "gyros"}


@dataclass(frozen=True)
class Column:
    """One constant: its name and unit, the largest plausible size, SI, the candidates it is in."""

    name: str
    kind: Kind
    unit: str
    largest: float
    families: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Columns:
    """D constants that drive, and B that are observed, at e epochs.

    Parameters
    ----------
    driving, observed : tuples of Column
    driven : (e, 3, D) array
    seen : (e, 3, B) array
    """

    driving: tuple[Column, ...]
    driven: Array
    observed: tuple[Column, ...]
    seen: Array

    @property
    def all(self) -> tuple[Column, ...]:
        """Those that drive, then those that are observed."""
        return self.driving + self.observed


class Epochs(NamedTuple):
    """Where columns of what a triad leaves out are worked out."""

    part: Triad
    bench: Turntable
    theta: Array  # (p,), coefficients as estimated
    time: Array  # (e,) s
    angles: Array  # (e, k) rad, readback
    warmth: Array | None  # (e,), as of `of_sensor`


def more(sensor: Sensor, *, warmed: bool = False) -> Sensor:
    """Return a triad with the coefficients of its tables that are not estimated.

    Those of temperature only where it is known and varies, `warmed`.
    """
    names = tuple(
        full
        for axis in sensor.axes
        for one in TABLES[axis.measures]
        if one.group not in _NOT_FELT
        and (warmed or not one.basis.uses("dT"))
        and (full := f"{axis.name}.{one.name}") not in sensor.coefficients
    )
    return replace(sensor, coefficients=names)


def of_sensor(
    part: Triad, motion: Motion, time: Array, warmth: Array | None = None
) -> tuple[tuple[Column, ...], Array]:
    """Return columns of coefficients and of the biases' changes, on readings, (n, 3, D).

    Parameters
    ----------
    part : Triad
    motion : Motion
        (n, 3).
    time : (n,) array
        s.
    warmth : (n,) array, optional
        Temperature minus the sensor's reference temperature, K, where it is known and varies.
    """
    larger = more(part.sensor, warmed=warmth is not None)
    motion = motion if warmth is None else replace(motion, dT=warmth)
    design = larger.design(motion, np.zeros(len(larger.coefficients)))
    columns: list[Column] = []
    for full, unit_scale in zip(larger.coefficients, larger.unit_scale.tolist(), strict=True):
        unit = SI_UNITS[larger.coefficient(full).unit]
        families = (family(larger.coefficient(full)), full)
        columns.append(Column(full, "coefficient", unit, LARGEST * unit_scale, families))
    kind = part.sensor.axes[0].measures
    start, span = float(time[0]), float(time[-1] - time[0]) or 1.0
    share = (time - start) / span
    shapes = [share - 0.5, *(np.cos(np.pi * k * share) for k in range(1, MODES + 1))]
    drift = np.zeros((len(time), 3, 3 * len(shapes)))
    for k, shape in enumerate(shapes):
        for a, axis in enumerate(part.sensor.axes):
            drift[:, a, 3 * k + a] = shape
            name = f"drift of {axis.name}"
            if k > 0:
                name, families = f"mode {k} of {axis.name}", (f"slow changes of {_WORDS[kind]}",)
            else:
                families = f"drift of {_WORDS[kind]}", name
            largest = LARGEST * (G0 if kind == "f" else 1.0)
            columns.append(Column(name, "time", _UNITS[kind], largest, families))
    return tuple(columns), np.concatenate([design, drift], axis=-1)


def of_gyros(epochs: Epochs) -> tuple[Columns, Array]:
    """Return the columns of gyros whose attitude a readback shows, and c where the run begins.

    The first of e + 1 epochs is where the run begins.
    """
    part, bench, theta, time, angles, warmth = epochs
    mat, since = reference(bench, angles), np.diff(time)
    since = np.where(since > 0, since, np.inf)  # of an epoch where the run begins nothing is asked
    back = np.swapaxes(mat, -1, -2)
    turned = log_so3(mat[1:] @ back[:-1])  # in the level frame
    middle = exp_so3(turned / 2) @ mat[:-1]
    earth = earth_rate(bench)
    rate = np.zeros((len(time), 3))
    rate[1:] = turned / since[:, None]
    level = np.swapaxes(middle, -1, -2)
    felt = Motion(
        level @ np.array([0.0, 0.0, bench.gravity.value]),
        (level @ (rate[1:] + earth)[..., None])[..., 0],
    )
    since = np.where(np.isfinite(since), since, 0.0)
    between = None if warmth is None else (warmth[1:] + warmth[:-1]) / 2
    columns, readings = of_sensor(part, felt, (time[1:] + time[:-1]) / 2, between)
    cm = middle @ _inverse(part, theta)
    of_place = np.zeros((len(since), 3, 2))
    of_place[:, 0, 0] = earth[1] * since
    of_place[:, :, 1] = -np.array([0.0, -earth[2], earth[1]]) * since[:, None]
    driven = np.concatenate([-(cm @ readings) * since[:, None, None], of_place], axis=-1)
    places = (_bench("azimuth", "rad"), _bench("latitude", "rad"))
    observed, by = of_table(bench, angles, ("lean_x", "lean_y", "azimuth"))
    # Between two epochs the rate is that of their mean, at one its mean.
    rate[1:-1] = (rate[1:-1] + rate[2:]) / 2
    late = np.stack([-rate, -rate * (time - time[0])[:, None]], axis=-1)
    seen = np.concatenate([by, late], axis=-1)
    observed = (*observed, _bench("latency", "s"), _bench("clock", "1"))
    return Columns((*columns, *places), driven, observed, seen[1:]), seen[0]


def of_accelerometers(epochs: Epochs) -> Columns:
    """Return the columns of accelerometers that a table holds, as velocities.

    The first epoch of a hold drives nothing.
    """
    part, bench, theta, time, angles, warmth = epochs
    mat = reference(bench, angles)
    columns, readings = of_sensor(part, at_rest(bench, mat), time, warmth)
    since = np.diff(time, prepend=time[:1])
    driven = (mat @ _inverse(part, theta) @ readings) * since[:, None, None]
    observed, by = of_table(bench, angles, ("azimuth",))
    return Columns(columns, driven, observed, by)


def of_means(epochs: Epochs) -> tuple[tuple[Column, ...], Array]:
    """Return the columns of n means of accelerometers at rest, on readings, (n, 3, c)."""
    part, bench, theta, time, angles, warmth = epochs
    mat = reference(bench, angles)
    columns, readings = of_sensor(part, at_rest(bench, mat), time, warmth)
    observed, by = of_table(bench, angles, ("azimuth",))
    force = np.array([0.0, 0.0, bench.gravity.value])
    # The true attitude is ahead of the readback's by −c.
    turned = np.swapaxes(mat, -1, -2) @ np.cross(force[:, None], -by, axis=-2)
    made = [readings, np.linalg.inv(_inverse(part, theta)) @ turned]
    return (*columns, *observed), np.concatenate(made, axis=-1)


def at_rest(bench: Turntable, mat: Array) -> Motion:
    """Return what a table at rest in attitudes (n, 3, 3) has felt."""
    back = np.swapaxes(mat, -1, -2)
    return Motion(back @ np.array([0.0, 0.0, bench.gravity.value]), back @ earth_rate(bench))


def of_table(
    bench: Turntable, angles: Array, but: Sequence[str]
) -> tuple[tuple[Column, ...], Array]:
    """Return the table's parameters but for some, and how φ as observed moves, (n, 3, B)."""
    count = max(_HARMONICS, len(bench.harmonics))
    sizes = (*bench.harmonics, *(1.0 for _ in range(count - len(bench.harmonics))))
    seen = misalignment(replace(bench, harmonics=sizes), angles)
    kept = [k for k, one in enumerate(seen.parameters) if one.name not in but]
    columns = tuple(_bench(seen.parameters[k].name, "rad") for k in kept)
    return columns, -seen.by[..., kept]


def together(parts: Sequence[tuple[Sequence[Column], Array]]) -> tuple[tuple[Column, ...], Array]:
    """Return the columns of all parts, and their rows (m, c), those of the parts one by one.

    Parameters
    ----------
    parts : sequence of (columns, rows)
        Rows (m, c) each; a column that two have is one.
    """
    found = {column.name: column for columns, _ in parts for column in columns}
    at = {name: k for k, name in enumerate(found)}
    made = np.zeros((sum(len(rows) for _, rows in parts), len(at)))
    first = 0
    for columns, rows in parts:
        made[first : first + len(rows), [at[one.name] for one in columns]] = rows
        first += len(rows)
    return tuple(found.values()), made


def families(bench: Turntable) -> dict[str, tuple[str, ...]]:
    """Return which of the table's parameters are candidates together, by the candidate's name."""
    found: dict[str, tuple[str, ...]] = {}
    for one in bench.parameters:
        for name in _bench(one.name, one.unit).families:
            found[name] = (*found.get(name, ()), one.name)
    return found


def candidates(columns: Sequence[Column], rows: Array, moved: Array | None) -> list[Candidate]:
    """Return the candidates that columns make: each family.

    Parameters
    ----------
    columns : sequence of c Column
    rows : (m, c) array
        Whitened, without what the estimate takes up where `moved` is given.
    moved : (q, c) array or None
        By how much one unit moves each parameter.
    """
    found: dict[str, list[int]] = {}
    for k, one in enumerate(columns):
        for name in one.families:
            found.setdefault(name, []).append(k)
    made: list[Candidate] = []
    for name, at in found.items():
        if len(at) == 1 and columns[at[0]].families[-1] != name:
            continue  # what is alone in its family is a candidate by itself
        chosen = [columns[k] for k in at]
        made.append(
            Candidate(
                name,
                chosen[0].kind,
                tuple(one.name for one in chosen),
                tuple(one.unit for one in chosen),
                rows[:, at],
                None if moved is None else moved[:, at],
                np.array([one.largest for one in chosen]),
            )
        )
    return made


def _bench(name: str, unit: str) -> Column:
    """Return a parameter of the bench, with others of its key in a run file and by itself."""
    wave, axis = ErrorName(name).parts
    if axis and wave[:3] in ("sin", "cos"):
        families = (f"harmonics[{axis}]", f"harmonic {wave[3:]}[{axis}]")
    else:
        key = name.partition("_")[0]
        families = (key, name) if key in ("lean", "square") else (name,)
    return Column(name, "bench", unit, largest_angle(name), families)


def _inverse(part: Triad, theta: Array) -> Array:
    """Return M = (N + S)⁻¹ of `strapdown`."""
    terms = part.terms
    made = terms.nominal.copy()
    for axis, weights, c in zip(terms.axis, terms.weights, theta, strict=True):
        made[axis] += c * weights[terms.first : terms.first + 3]
    return np.asarray(np.linalg.inv(made), dtype=float)
