"""A rate table turns three gyros about one case axis after the other; nothing of inercal is used.

In the case, the rate is Ω U + Ω_e sin φ U over whole turns, with U the axis that is up.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EARTH = np.degrees(7.292115e-5)  # °/s
NOISE = 2e-4  # °/s, of a mean
LATITUDE = 50.0  # °, as stated
SPEEDS = (0.0, 20.0, 50.0, 100.0)  # °/s, whole turns in 36 s
STATED = {
    "kind": "rate_platform",
    "latitude": f"{LATITUDE} °",
    "rate_scale": "100 ppm",
    "rate_asymmetry": "0 ppm",
    "rate_stability": "0 ppm",
    "setting": "0.02 °",
}
Change = Callable[[Array, Array, NDArray[np.str_]], None]


def table(
    rng: np.random.Generator,
    axes: str = "xyz",
    speeds: tuple[float, ...] = SPEEDS,
    change: Change | None = None,
    latitude: float = LATITUDE,
    rate_scale: float = 0.0,
) -> dict[str, Any]:
    """Return the columns of a table of means.

    Parameters
    ----------
    rng : Generator
    axes : str
        Case axes that are up, one setting each.
    speeds : tuple of float
        °/s, each in both senses, up and down again.
    change : callable, optional
        Changes the readings (r, 3), given true rates (r, 3) and the setting of each row.
    latitude : float
        The true one, °.
    rate_scale : float
        Of the table, relative.
    """
    up = np.array([*speeds, *speeds[::-1]])
    rates = np.concatenate([up, -up[up > 0]])
    rows = [(axis, rate) for axis in axes for rate in rates]
    setting = np.array([axis for axis, _ in rows])
    w = np.zeros((len(rows), 3))
    # The axis in the case is off by the stated angle, alike in all rows of a setting.
    off = {axis: rng.standard_normal(2) * np.radians(0.02) for axis in axes}
    for k, (axis, rate) in enumerate(rows):
        i = "xyz".index(axis)
        along = rate * (1 + rate_scale) + EARTH * np.sin(np.radians(latitude))
        w[k, i] = along
        w[k, (i + 1) % 3] = along * off[axis][0]
        w[k, (i + 2) % 3] = along * off[axis][1]
    scale, bias = 1 + 3e-3 * rng.standard_normal(3), 0.02 * rng.standard_normal(3)
    y = w * scale + bias + NOISE * rng.standard_normal(w.shape)
    # At rest the level part of the earth's rate is sensed, alike in all rests of a setting.
    level = EARTH * np.cos(np.radians(latitude))
    for axis in axes:
        azimuth = rng.uniform(0, 2 * np.pi)
        rest = (setting == axis) & (np.array([rate for _, rate in rows]) == 0)
        i = "xyz".index(axis)
        y[rest, (i + 1) % 3] += level * np.cos(azimuth)
        y[rest, (i + 2) % 3] += level * np.sin(azimuth)
    if change is not None:
        change(y, w, setting)
    return {
        "axis": setting,
        "rate": np.array([rate for _, rate in rows]),
        "seconds": np.full(len(rows), 36.0),
        **dict(zip(("gx", "gy", "gz"), y.T, strict=True)),
    }


def arguments(
    method: Mapping[str, Any] | None = None, bench: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the sections for a calibration in memory."""
    return {
        "method": {"name": "rates_and_poses", **(method or {})},
        "sensor": {"gyro": {"unit": "°/s"}},
        "bench": STATED | dict(bench or {}),
        "kind": "means",
        "axis": "axis",
        "table_rate": "rate",
        "seconds": "seconds",
        "gyro": ["gx", "gy", "gz"],
        "sd": {"gyro": f"{NOISE} °/s"},
    }
