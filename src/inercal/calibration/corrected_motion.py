"""The motion that a sensor with any number of axes measures, and the residual of a cluster.

One or two axes measure only the components along them. More than three axes of a kind measure a
vector, by least squares with equal weights, because all axes of a kind have the same stated noise.
Their readings minus those that the vector explains are the parity residual. It contains noise and
errors of single axes, but no motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.motion import Motion
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Sensor

KINDS: tuple[Measures, ...] = ("f", "w")


@dataclass(frozen=True, eq=False)
class CorrectedMotion(Motion):
    """A motion that was computed from readings.

    Parameters
    ----------
    parity : mapping of "f" or "w" to (..., n) array
        Norm of the parity residual, m/s² or rad/s, only for kinds with redundant axes.
    """

    parity: dict[Measures, Array] = field(default_factory=dict["Measures", Array])


def kinds_in_part(sensor: Sensor) -> tuple[Measures, ...]:
    """Return the kinds of axes that measure only one or two components."""
    return tuple(kind for kind in KINDS if 0 < sensor.rank(kind) < len("xyz"))


def corrected_motion(
    sensor: Sensor, y: Array, values: Array, motion: Motion, in_part: Sequence[Measures]
) -> CorrectedMotion:
    """Return the motion with the parity residuals, and only the measured components of some kinds.

    Parameters
    ----------
    sensor : Sensor
    y : (..., n, m) array
        Readings in SI.
    values : (p,) array
        Coefficients.
    motion : Motion
        The motion that corresponds to the readings.
    in_part : sequence of "f" or "w"
        Kinds for which the result has one component per axis, along its input axis.
    """
    parity: dict[Measures, Array] = {}
    rest: Array | None = None
    for kind in KINDS:
        rows = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if len(rows) > max(sensor.rank(kind), 1):
            rest = y - sensor.forward(motion, values) if rest is None else rest
            parity[kind] = np.linalg.norm(rest[..., rows], axis=-1)
    sensed = {kind: getattr(motion, kind) @ sensor.input_axes(kind).T for kind in in_part}
    whole = replace(motion, **sensed)
    return CorrectedMotion(whole.f, whole.w, whole.dw, whole.dT, whole.dTdt, parity)


def sensed_components(sensor: Sensor) -> Array:
    """Return the motion (f, ω) for a unit of each component that is measured, (6, k)."""
    blocks: list[Array] = []
    for kind in KINDS:
        axes, rank = sensor.input_axes(kind), sensor.rank(kind)
        if rank:
            own = np.asarray(np.eye(3) if rank == len("xyz") else np.linalg.pinv(axes), dtype=float)
            other = 0 * own
            blocks.append(np.concatenate([own, other] if kind == "f" else [other, own]))
    return np.concatenate(blocks, axis=1)


def component_names(sensor: Sensor, kind: Measures) -> tuple[str, ...]:
    """Return the names of the components that `corrected_motion` returns, such as "wx" or "w1".

    Fewer than three axes are numbered unless they point along different case axes.
    """
    rank, axes = sensor.rank(kind), sensor.select_axes(kind).axes
    if rank == len("xyz"):
        return tuple(kind + letter for letter in "xyz")
    main = [int(np.argmax(np.abs(axis.i))) for axis in axes]
    case = all(axis.i[k] == 1 for axis, k in zip(axes, main, strict=True))
    by_letter = case and len(set(main)) == len(main)
    names = ["xyz"[k] for k in main] if by_letter else map(str, range(1, len(axes) + 1))
    return tuple(f"{kind}{name}" for name in names)
