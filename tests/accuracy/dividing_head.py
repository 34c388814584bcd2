"""Two accelerometers on a dividing head from the physics alone: nothing of inercal is imported.

Readings in g, angles in rad. Accelerometer A is level at 0° and up at 90°, B a quarter turn on::

    y = K0 + (1 + k1) a + K2 a² + K3 a³ + Kip a p,   a = sin(ψ + δ) cos λ, p = cos(ψ + δ) cos λ

at the true angle ψ of the position, for B at ψ + 90°; λ is the spindle's lean, and a and p are
larger where gravity is. The common zero of the angle (base tilt) is off by a constant.

Graduations and polygon faces err alike in both passes; the autocollimator, the pier and the noise
anew at each row. Biases and the base go by rates of their own in each pass; the truth is the mean
of the run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARCSEC = pi / 648_000
PAIR = (0.0, pi / 2)
TERMS = ("k0", "k1", "delta", "k2", "k3", "kip")
SIZES = {  # truth 1σ: µg, ppm, ″
    "k0": 300e-6,
    "k1": 200e-6,
    "delta": 100 * ARCSEC,
    "k2": 10e-6,
    "k3": 5e-6,
    "kip": 20e-6,
}
LARGE = SIZES | {"k0": 1e-3, "k1": 1e-3, "delta": 300 * ARCSEC}


@dataclass(frozen=True)
class Bench:
    """Standard deviations of a head and the instruments on it; angles in ″, readings in g."""

    head: float = 3.0
    shares: tuple[float, float, float] = (0.4, 0.3, 0.3)  # of its variance: harmonics 1, 2, white
    collimator: float = 0.1
    collimated: str = "pairs"  # or "every", "none"
    base: float = 5.0
    cross: float = 20.0
    noise: float = 0.2e-6
    drift: float = 0.0  # g per pass, the same in all passes and accelerometers
    drifting: float = 0.0  # g per pass, drawn for each pass and accelerometer
    third: float = 0.0  # of the head's third harmonic
    polygon: tuple[float, ...] = ()  # certified deviation of the face of each position
    certificate: float = 0.0
    pier: float = 0.0
    creep: float = 0.0  # per pass, drawn for each
    gravity: float = 0.0  # relative
    sizes: dict[str, float] = field(default_factory=lambda: dict(SIZES))


def angles(n: int, *, reverse: bool = False) -> Array:
    """Return n even positions from 0, rad; with `reverse` the same again backwards."""
    forward = np.arange(n, dtype=np.float64) * (2 * pi / n)
    return np.concatenate([forward, forward[::-1]]) if reverse else forward


def ramps(rows: int, n: int) -> Array:
    """Return the effect of a unit drift in each pass of n rows, (passes, rows), less its mean."""
    made = np.clip(np.arange(rows) / n - np.arange(rows // n)[:, None], 0, 1)
    return made - made.mean(axis=1, keepdims=True)


def readings(
    truth: dict[str, Array],
    psi: Array,
    lean: Array,
    gravity: Array | float = 1.0,
    ahead: Sequence[float] = PAIR,
) -> Array:
    """Return noise-free readings, (..., r, m) in g, at true angles (..., r)."""
    found = np.empty((*np.broadcast_shapes(psi.shape, truth["k0"][..., :1].shape), len(ahead)))
    for k, angle in enumerate(ahead):
        c = {name: truth[name][..., k, None] for name in TERMS}
        at = psi + angle + c["delta"]
        held = (gravity * np.cos(lean))[..., None]
        a, p = np.sin(at) * held, np.cos(at) * held
        found[..., k] = (
            c["k0"] + (1 + c["k1"]) * a + c["k2"] * a**2 + c["k3"] * a**3 + c["kip"] * a * p
        )
    return found


def draw(
    seed: int,
    trials: int,
    bench: Bench,
    n: int = 12,
    *,
    reverse: bool = False,
    ahead: Sequence[float] = PAIR,
) -> tuple[Array, dict[str, Array], Array]:
    """Return angles (r,), the truth by term (trials, m) and readings (trials, r, m).

    `ahead` is the angle of each accelerometer from the first direction. The same seed makes the
    same draws of everything, whatever the bench's deviations.
    """
    rng, m = np.random.default_rng([seed, 101852817]), len(ahead)
    theta = angles(n, reverse=reverse)
    truth = {name: bench.sizes[name] * rng.standard_normal((trials, m)) for name in TERMS}
    amplitude = rng.standard_normal((trials, 4))
    white = rng.standard_normal((trials, n))
    if reverse:
        white = np.concatenate([white, white[:, ::-1]], axis=1)
    collimated = bench.collimator * rng.standard_normal((trials, len(theta)))
    base, lean = ARCSEC * np.array([[bench.base], [bench.cross]]) * rng.standard_normal((2, trials))
    noise = bench.noise * rng.standard_normal((trials, len(theta), m))
    # What came later has draws of its own, so that those above stay what they were.
    later = np.random.default_rng([seed, 1293])
    third = bench.third * later.standard_normal((trials, 2, 1))
    face = bench.certificate * later.standard_normal((trials, n))
    face = face + (bench.polygon if bench.polygon else 0.0)
    if reverse:
        face = np.concatenate([face, face[:, ::-1]], axis=1)
    pier = bench.pier * later.standard_normal((trials, len(theta)))
    drift_shapes = ramps(len(theta), n)
    creep = bench.creep * later.standard_normal((trials, len(drift_shapes))) @ drift_shapes
    rates = bench.drifting * later.standard_normal((trials, m, len(drift_shapes))) + bench.drift
    gravity = 1 + bench.gravity * later.standard_normal(trials)
    first, second, rest = bench.head * np.sqrt(bench.shares)
    head = (
        first * (amplitude[:, :1] * np.sin(theta) + amplitude[:, 1:2] * np.cos(theta))
        + second * (amplitude[:, 2:3] * np.sin(2 * theta) + amplitude[:, 3:] * np.cos(2 * theta))
        + third[:, 0] * np.sin(3 * theta)
        + third[:, 1] * np.cos(3 * theta)
        + rest * white
    )
    collimated = collimated + face
    if bench.collimated == "every":
        head = collimated
    elif bench.collimated == "pairs":
        for passed in range(0, len(theta), n):
            for target in (0.0, pi / 2):
                one, other = (
                    passed + int(np.argmin(np.abs(theta[passed : passed + n] - angle)))
                    for angle in (target, target + pi)
                )
                # Both members are read on the autocollimator: their difference has both errors.
                head[:, other] = head[:, one] + collimated[:, other] - collimated[:, one]
    psi = theta + ARCSEC * (head + pier + creep) + base[:, None]
    drift = np.swapaxes(rates @ drift_shapes, -1, -2)
    return theta, truth, readings(truth, psi, lean, gravity, ahead) + noise + drift
