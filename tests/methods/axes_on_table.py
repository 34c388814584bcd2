"""Sensors with any axes on the table of `tests.accuracy.turntable`, without importing inercal."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.methods.axis_devices import draw_truth, read_axes

Array = NDArray[np.float64]
Directions = Sequence[tuple[float, float, float]]
_IDEAL = turntable.Device(0, 0, 0, 0)
_SILENT = turntable.Grade(0, 0, 0, 0)


def draw_motions(
    seed: int,
    trials: int,
    path: list[turntable.Stand | turntable.Turn],
    table: turntable.Table,
    hz: float,
) -> turntable.Draw:
    """Return what an ideal triad of each kind reads on as many tables, and their readback."""
    return turntable.draw(seed, trials, path, _SILENT, table, _IDEAL, hz)


def mount(
    motions: turntable.Draw,
    directions: Mapping[str, Directions],
    grade: turntable.Grade,
    seed: int,
) -> tuple[turntable.Draw, dict[str, Array]]:
    """Return the readings of one device on each table, and the true coefficients by name.

    The coefficients are (n, m), first those of the accelerometers.

    Parameters
    ----------
    motions : Draw
        From `draw_motions`.
    directions : mapping of "f" or "w" to sequence of (3,) floats
        Unit vectors along the accelerometers and the gyros.
    grade : Grade
        Noise and Gauss–Markov drift.
    seed : int
    """
    rng = np.random.default_rng([seed, 7411])
    hz = 1 / float(motions.time[1] - motions.time[0])
    sizes = {"f": (grade.vrw, grade.acc_drift), "w": (grade.arw, grade.gyro_drift)}
    read: dict[str, Array] = {}
    truths: list[dict[str, Array]] = []
    for kind, sensed in (("f", motions.forces), ("w", motions.rates)):
        axes = np.array(directions.get(kind, ()), dtype=float).reshape(-1, 3)
        (n, samples, _), m = sensed.shape, len(axes)
        truths.append(truth := draw_truth(kind, m, n, rng))
        read[kind] = np.zeros((n, samples, 0))
        if m:
            white, drift = sizes[kind]
            noise = white * np.sqrt(hz) * rng.standard_normal((n, samples, m))
            slow = [
                turntable.drift(rng, drift, grade.correlation, samples, hz, n)
                for _ in range(0, m, 3)
            ]
            noise += np.concatenate(slow, axis=-1)[..., :m]
            read[kind] = read_axes(sensed, axes, truth) + noise
    whole = {name: np.concatenate([one[name] for one in truths], axis=1) for name in truths[0]}
    return replace(motions, forces=read["f"], rates=read["w"]), whole
