"""Simulated laboratories as sessions of inercal."""

import numpy as np
from tests.repeatability.laboratory import AXES, NAMES, Drawn

from inercal.calibration import Calibration, SharedError
from inercal.laboratory.repeatability import RepeatedSession
from inercal.physics.sensors import Axis, Sensor

TRIAD = Sensor(
    "TRIAD-1",
    tuple(
        Axis(name, "f", tuple(np.eye(3)[k]), tuple(np.eye(3)[(k + 1) % 3]))
        for k, name in enumerate(AXES)
    ),
    NAMES,
)
QUANTITIES = ("g", "tilt")


def sessions_of(drawn: Drawn, days: np.ndarray | None = None, *, stated: bool = True):
    """Return the sessions; without `stated` their files do not say what they share."""
    shared = tuple(
        SharedError(name, "1", 1.0, column, "d" * 64)
        for name, column in zip(QUANTITIES, drawn.shared, strict=True)
    )
    days = np.arange(len(drawn.values)) if days is None else days
    return [
        RepeatedSession(
            f"session {k}",
            Calibration(TRIAD, value, drawn.covariance, shared=shared if stated else None),
            str(days[k]), str(k), str(k),
        )
        for k, value in enumerate(drawn.values)
    ]  # fmt: skip
