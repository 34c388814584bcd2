"""What the generator's turntable made, handed to inercal: bench, sensor, track, and the truth."""

from collections.abc import Sequence
from dataclasses import replace
from math import radians, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import turntable

from inercal.benches import Turntable
from inercal.recording import Observations, Track
from inercal.sensors import Sensor
from inercal.sensors.catalogue import imu
from inercal.units import Measured

Array = NDArray[np.float64]
ARCSEC = turntable.ARCSEC
DEG_MIN = radians(1) / 60
MICRO_G = 1e-6 * turntable.G
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


def sensor(grade: turntable.Grade = turntable.T, *also: str) -> Sensor:
    made = imu()
    noises = {"w": (grade.arw, grade.gyro_drift), "f": (grade.vrw, grade.acc_drift)}
    axes = tuple(
        replace(
            axis,
            noise=replace(
                axis.noise,
                white=noises[axis.measures][0],
                bias_instability=noises[axis.measures][1],
            ),
        )
        for axis in made.axes
    )
    return replace(made, axes=axes).with_coefficients("bias", "scale", "misalignment", *also)


def track(made: turntable.Draw) -> Track:
    """Return the samples of all trials; where the table stands by its labels are holds."""
    hold, number = np.full(made.time.size, -1), -1
    for name in dict.fromkeys(made.labels):
        if name and name[-1] not in "+-":
            number += 1
            hold[made.labels == name] = number
    return Track(made.time, np.concatenate([made.forces, made.rates], axis=2), made.angles, hold)


def observations(made: turntable.Draw) -> Observations:
    """Return means of each step, and the track."""
    whole, hz = track(made), 1 / (made.time[1] - made.time[0])
    labels = tuple(name for name in dict.fromkeys(made.labels) if name)
    rows = [np.flatnonzero(made.labels == name) for name in labels]
    mean = np.stack([whole.reading[:, at].mean(axis=1) for at in rows], axis=1)
    r = len(labels)
    return Observations(
        labels,
        mean,
        np.tile(np.eye(6) * 1e-12, (r, 1, 1)),
        np.array([at.size / hz for at in rows]),
        np.array([at.size for at in rows]),
        np.array([made.time[at].mean() for at in rows]),
        ("ax", "ay", "az", "gx", "gy", "gz"),
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
    """RMS in the note's units, and NEES by parameter."""

    bias: float
    scale: float  # ppm
    cross: float  # ″
    nees: float


def score(off: Array, covariance: Array, names: Sequence[str], unit: float) -> Score:
    """Judge errors (trials, p) of one triad's coefficients; `unit` is that of the bias."""
    short = np.array([name.partition(".")[2] for name in names])

    def rms(kinds: tuple[str, ...], size: float) -> float:
        return float(np.sqrt(np.mean(off[:, np.isin(short, kinds)] ** 2))) / size

    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(covariance), off).mean() / off.shape[1]
    return Score(
        rms(("bias", "k0"), unit),
        rms(("scale", "k1"), 1e-6),
        rms(("delta_o", "delta_p"), ARCSEC),
        float(nees),
    )
