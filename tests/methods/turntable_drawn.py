"""Runs of the independent generator as observations, and how far estimates are from its truth."""

from collections.abc import Sequence
from dataclasses import replace
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.turntable import ARCSEC, TEN, Draw, G, Grade, Stand, T, Turn

from inercal.benches.turntable import Turntable
from inercal.estimate import Estimate
from inercal.plan import Position, Rotation, TableStep
from inercal.recording import Observations, Track
from inercal.sensors import Sensor, imu
from inercal.units import Measured

Array = NDArray[np.float64]
BENCH = Turntable(
    Measured(G, 0.0),
    radians(38),
    Measured(0, radians(0.1)),
    lean=5 * ARCSEC,
    square=2 * ARCSEC,
    harmonics=(2 / 2**0.5 * ARCSEC, 1 / 2**0.5 * ARCSEC),
    white=0.5 * ARCSEC,
    latency=Measured(0, 5e-3),
)
RESTS = ("warm-up", *(f"p{k + 1}" for k in range(len(TEN))), "rest")
_SIX = {
    "z_p": (0, 0, 0), "y_p": (0, 90, 0), "z_a": (0, 180, 0), "y_a": (0, 270, 0),
    "x_a": (0, 0, 90), "x_p": (0, 0, -90),
}  # fmt: skip


def discrete(seconds: float = 90.0) -> list[Stand | Turn]:
    """Return six positions, each with ±1080° at 30 °/s about the vertical."""
    path: list[Stand | Turn] = [("warm-up", (0, 0, 0), 120.0)]
    for name, angles in _SIX.items():
        path.append((name, angles, seconds))
        path += [(f"{name}+", 0, 1080.0, 30.0), (f"{name}-", 0, -1080.0, 30.0)]
    return path


def sensor(grade: Grade = T, *also: str) -> Sensor:
    """Return the IMU with a grade's noise; bias, scale and misalignment are wanted."""
    made = imu()
    axes = []
    for axis in made.axes:
        gyro = axis.measures == "w"
        white, drift = (grade.arw, grade.gyro_drift) if gyro else (grade.vrw, grade.acc_drift)
        axes.append(replace(axis, noise=replace(axis.noise, white=white, bias_instability=drift)))
    whole = replace(made, axes=tuple(axes))
    return whole.with_coefficients("bias", "scale", "misalignment", *also)


def observations(draw: Draw, made: Sensor, rests: Sequence[str] = RESTS) -> Observations:
    """Return one row for each label, and the track with its holds."""
    hold = np.full(len(draw.time), -1)
    for k, name in enumerate(rests):
        hold[draw.labels == name] = k
    reading = np.concatenate([draw.forces, draw.rates], axis=2)
    labels = tuple(dict.fromkeys(name for name in draw.labels.tolist() if name))
    at = [np.flatnonzero(draw.labels == name) for name in labels]
    dt = draw.time[1] - draw.time[0]
    seconds = np.array([len(rows) * dt for rows in at])
    white = np.array([axis.noise.white**2 for axis in made.axes])
    return Observations(
        labels,
        np.stack([reading[:, rows].mean(axis=1) for rows in at], axis=1),
        np.eye(6) * white / seconds[:, None, None],
        seconds,
        np.array([len(rows) for rows in at]),
        np.array([draw.time[rows].mean() for rows in at]),
        ("ax", "ay", "az", "gx", "gy", "gz"),
        track=Track(draw.time, reading, draw.angles, hold),
    )


def truth(draw: Draw, names: Sequence[str]) -> Array:
    """Return the generator's truth as coefficients, (trials, p)."""
    made = np.zeros((len(draw.gyro), len(names)))
    for k, name in enumerate(names):
        axis, _, term = name.partition(".")
        i, of = "xyz".index(axis[1]), draw.acc if axis[0] == "a" else draw.gyro
        matrix = of[:, 3:].reshape(-1, 3, 3)
        if term in ("k0", "bias"):
            made[:, k] = of[:, i]
        elif term in ("k1", "scale"):
            made[:, k] = matrix[:, i, i]
        else:
            made[:, k] = matrix[:, i, (i + 1) % 3] if term == "delta_o" else -matrix[:, i, i - 1]
    return made


class Score(NamedTuple):
    """Root mean squares: bias °/min or µg, scale ppm, misalignment ″; NEES a coefficient."""

    bias: float
    scale: float
    misalignment: float
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
    terms = {"bias": ("k0", "bias"), "scale": ("k1", "scale"), "off": ("delta_o", "delta_p")}
    rms = {
        what: float(
            np.sqrt(np.mean([off[:, k] ** 2 for k in at if names[k].partition(".")[2] in group]))
        )
        for what, group in terms.items()
    }
    own, stated = off[:, at], covariance[:, at][:, :, at]
    nees = np.einsum("ti,tij,tj->t", own, np.linalg.inv(stated), own).mean() / len(at)
    unit = radians(1) / 60 if kind == "g" else 1e-6 * G
    return Score(rms["bias"] / unit, rms["scale"] / 1e-6, rms["off"] / ARCSEC, float(nees))


def errors(estimate: Estimate, draw: Draw, made: Sensor) -> tuple[Array, Array]:
    """Return estimates minus truth, (trials, p), and the stated covariance of the coefficients."""
    p = len(made.coefficients)
    off = estimate.value[..., :p] - truth(draw, made.coefficients)
    stated = estimate.stated_covariance[..., :p, :p]
    return off, np.broadcast_to(stated, (len(off), p, p))


def steps(path: Sequence[Stand | Turn], labels: Sequence[str]) -> list[TableStep]:
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
