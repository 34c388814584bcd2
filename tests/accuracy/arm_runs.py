"""Recordings of arm runs from the physics alone: nothing of inercal is imported.

In the frame of the ground (z along the spindle) the sensor is accelerated by −ω²R outwards and ω̇R
forwards, and gravity's reaction leans by λ against the spindle. A platform locked to the arm turns
the body with it; a counter-rotating one keeps the body to the ground.
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.centrifuge import EARTH, PAPER_G, RATES, Triad

Array = NDArray[np.float64]
ACCELERATION = 4.0  # rad/s²


@dataclass(frozen=True, eq=False)
class Run:
    """Time s, output (n, 3), rate read back rad/s, name of the attitude, true force (n, 3) m/s²."""

    time: Array
    output: Array
    rate: Array
    position: NDArray[np.str_]
    force: Array


def record(
    device: Triad,
    attitudes: list[tuple[float, float]],
    rng: np.random.Generator,
    *,
    rates: list[float] = RATES,
    turns: int = 8,
    fs: float = 50.0,
    noise: float = 1e-4,
    lean: tuple[float, float] = (0.0, 0.0),
    locked: bool = True,
    error: float = 0.0,
    wander: float = 0.0,
    sense: int = 1,
    latitude: float = 0.0,
) -> Run:
    """Return runs through all rates in each attitude, with `noise` in output units a sample.

    `error` is the relative error of the rate read back, `wander` that of each dwell besides.
    """
    parts: list[tuple[Array, Array]] = []
    names: list[str] = []
    azimuth = 0.3
    for k, (psi, theta) in enumerate(attitudes):
        rate, truth = profile(rates, turns, fs, rng, error, wander)
        spin = sense * truth
        swept = azimuth + np.concatenate([[0], np.cumsum((spin[1:] + spin[:-1]) / 2)]) / fs
        azimuth = swept[-1]
        felt = spin + EARTH * sin(latitude)
        outwards = np.stack([np.cos(swept), np.sin(swept), 0 * swept], axis=-1)
        forwards = np.stack([-np.sin(swept), np.cos(swept), 0 * swept], axis=-1)
        up = np.array([lean[0], lean[1], 1.0])
        ground = -(felt**2)[:, None] * outwards + np.gradient(spin, 1 / fs)[:, None] * forwards
        ground = ground + PAPER_G * up / np.linalg.norm(up)
        # Coriolis' acceleration 2 Ω × v of the earth's level rate, north along y.
        ground[:, 2] += 2 * EARTH * cos(latitude) * spin * np.sin(swept)
        out = np.array([cos(psi) * cos(theta), sin(psi), cos(psi) * sin(theta)])
        top = np.array([sin(theta), 0.0, -cos(theta)])
        body = np.stack([out, np.cross(top, out), top])  # rows: outwards, forwards, up
        if locked:
            along = [(ground * outwards).sum(-1), (ground * forwards).sum(-1), ground[:, 2]]
            force = np.stack(along, axis=-1) @ body
        else:
            force = ground @ body
        parts.append((rate, force))
        names += [f"p{k + 1:02d}"] * rate.size
    force = np.concatenate([part[1] for part in parts])
    output = device.output(force / PAPER_G)
    output = output + noise * rng.standard_normal(output.shape)
    rate = np.concatenate([part[0] for part in parts])
    return Run(np.arange(rate.size) / fs, output, rate, np.array(names), force)


def profile(
    rates: list[float],
    turns: int,
    fs: float,
    rng: np.random.Generator,
    error: float,
    wander: float,
) -> tuple[Array, Array]:
    """Return the rate as read back and the true one, from rest through all rates to rest."""
    said, true = [np.zeros(round(fs))], [np.zeros(round(fs))]
    before = 0.0
    for w in [*rates, 0.0]:
        ramp = np.linspace(before, w, round(abs(w - before) / ACCELERATION * fs) + 2)
        hold = np.full(round((2.0 + (turns + 0.37) * 2 * pi / w if w else 1.0) * fs), w)
        own = 1 + error + wander * rng.standard_normal()
        said += [ramp, hold]
        true += [ramp * own, hold * own]
        before = w
    return np.concatenate(said), np.concatenate(true)
