"""What the generator's turntable made, handed to inercal; its truth; how far estimates are off."""

from collections.abc import Sequence
from dataclasses import replace
from math import radians, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import turntable

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.estimation import Estimate
from inercal.physics.plan import Position, Rotation, TableStep
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.catalogue import imu
from inercal.recordings import Observations, Track

Array = NDArray[np.float64]
ARCSEC = turntable.ARCSEC
FAST = [
    ("warm-up", (0, 0, 0), 120.0),
    *turntable.positions(),
    *turntable.turns(1080, 30, back=True),
]
TABLE = turntable.Table()


def bench(table: turntable.Table = TABLE, **changes: object) -> Turntable:
    """Return the bench that states what the table does; changes state something else."""
    stated = Turntable(
        Measured(table.gravity, 0.0),
        table.latitude,
        Measured(0.0, table.azimuth),
        lean=2 * table.lean,  # as the note has it: 10″ are expected
        square=table.square,
        harmonics=tuple(size / sqrt(2) for size in table.harmonics),
        white=table.white,
        latency=Measured(0.0, 5e-3),
    )
    return replace(stated, **changes)


BENCH = bench(lean=TABLE.lean)  # as it was drawn
_SIX = {
    "z_p": (0, 0, 0), "y_p": (0, 90, 0), "z_a": (0, 180, 0), "y_a": (0, 270, 0),
    "x_a": (0, 0, 90), "x_p": (0, 0, -90),
}  # fmt: skip


def discrete(seconds: float = 90.0) -> list[turntable.Stand | turntable.Turn]:
    """Return six positions, each with ±1080° at 30 °/s about the vertical."""
    path: list[turntable.Stand | turntable.Turn] = [("warm-up", (0, 0, 0), 120.0)]
    for name, angles in _SIX.items():
        path.append((name, angles, seconds))
        path += [(f"{name}+", 0, 1080.0, 30.0), (f"{name}-", 0, -1080.0, 30.0)]
    return path


def sensor(grade: turntable.Grade = turntable.T, *also: str, flicker: bool = False) -> Sensor:
    """Return the IMU with a grade's noise and drift; bias, scale, misalignment are wanted."""
    made = imu()
    noises = {"w": (grade.arw, grade.gyro_drift), "f": (grade.vrw, grade.acc_drift)}
    axes = tuple(
        replace(
            axis,
            noise=replace(
                axis.noise,
                white=noises[axis.measures][0],
                bias_instability=noises[axis.measures][1],
                correlation=0.0 if flicker or grade.flicker else grade.correlation,
            ),
        )
        for axis in made.axes
    )
    return replace(made, axes=axes).with_coefficients("bias", "scale", "misalignment", *also)


def track(made: turntable.Draw, rests: Sequence[str] | None = None) -> Track:
    """Return the samples of all trials; where the table stands, by its labels, are holds."""
    if rests is None:
        rests = [name for name in dict.fromkeys(made.labels) if name and name[-1] not in "+-"]
    hold = np.full(made.time.size, -1)
    for number, name in enumerate(rests):
        hold[made.labels == name] = number
    return Track(made.time, np.concatenate([made.forces, made.rates], axis=2), made.angles, hold)


def observations(
    made: turntable.Draw, of: Sensor | None = None, rests: Sequence[str] | None = None
) -> Observations:
    """Return means of each step with a sensor's white noise, and the track."""
    whole, dt = track(made, rests), made.time[1] - made.time[0]
    labels = tuple(name for name in dict.fromkeys(made.labels.tolist()) if name)
    rows = [np.flatnonzero(made.labels == name) for name in labels]
    count = np.array([at.size for at in rows])
    axes = (of or sensor()).axes
    white = np.array([axis.noise.white**2 for axis in axes])
    return Observations(
        labels,
        np.stack([whole.reading[:, at].mean(axis=1) for at in rows], axis=1),
        np.eye(len(axes)) * white / (count * dt)[:, None, None],
        count * dt,
        count,
        np.array([made.time[at].mean() for at in rows]),
        tuple(axis.name for axis in axes),
        track=whole,
    )


def columns(names: Sequence[str]) -> Array:
    """Return which of three biases and nine S each coefficient is, (12, p)."""
    made = np.zeros((12, len(names)))
    for m, name in enumerate(names):
        axis, _, short = name.partition(".")
        i = "xyz".index(axis[1])
        row, sign = {
            "k0": (i, 1),
            "bias": (i, 1),
            "k1": (3 + 4 * i, 1),
            "scale": (3 + 4 * i, 1),
            "delta_o": (3 + 3 * i + (i + 1) % 3, 1),
            "delta_p": (3 + 3 * i + (i + 2) % 3, -1),
        }.get(short, (0, 0))
        made[row, m] = sign
    return made


def truth(made: turntable.Draw, names: Sequence[str]) -> Array:
    """Return the true coefficients, (trials, p); g-sensitivity and others are not told."""
    by = columns(names)
    gyro = np.array([name[0] == "g" for name in names])
    return np.where(gyro, made.gyro @ by, made.acc @ by)


class Score(NamedTuple):
    """RMS of bias, °/min or µg, scale, ppm, and misalignment, ″; NEES a coefficient."""

    bias: float
    scale: float
    cross: float
    nees: float


def score(off: Array, covariance: Array, names: Sequence[str], kind: str) -> Score:
    """Return how the gyros ("g") or the accelerometers ("a") of many trials did.

    Parameters
    ----------
    off : (trials, p) array
        Estimates minus truth.
    covariance : (trials, p, p) array
        As stated.
    names : sequence of p str
    kind : "g" or "a"
    """
    at = [k for k, name in enumerate(names) if name[0] == kind]
    off, covariance = off[:, at], covariance[:, at][:, :, at]
    short = np.array([names[k].partition(".")[2] for k in at])

    def rms(kinds: tuple[str, ...], size: float) -> float:
        return float(np.sqrt(np.mean(off[:, np.isin(short, kinds)] ** 2))) / size

    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(covariance), off).mean() / len(at)
    return Score(
        rms(("bias", "k0"), radians(1) / 60 if kind == "g" else 1e-6 * turntable.G),
        rms(("scale", "k1"), 1e-6),
        rms(("delta_o", "delta_p"), ARCSEC),
        float(nees),
    )


def errors(estimate: Estimate, draw: turntable.Draw, made: Sensor) -> tuple[Array, Array]:
    """Return estimates minus truth, (trials, p), and the stated covariance of the coefficients."""
    p = len(made.coefficients)
    off = estimate.value[..., :p] - truth(draw, made.coefficients)
    stated = estimate.stated_covariance[..., :p, :p]
    return off, np.broadcast_to(stated, (len(off), p, p))


def steps(
    path: Sequence[turntable.Stand | turntable.Turn], labels: Sequence[str]
) -> list[TableStep]:
    """Return the generator's steps of these labels as a plan."""
    made: list[TableStep] = []
    for step in path:
        if step[0] not in labels:
            continue
        if len(step) == 3:
            outer, middle, inner = map(radians, step[1])
            made.append(Position(step[0], (outer, middle, inner), step[2]))
        else:
            made.append(Rotation(step[0], step[1], radians(step[2]), radians(step[3])))
    return made
