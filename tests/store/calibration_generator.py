"""Calibrations of a sensor over the years, made from the documented file alone: no inercal.

Truth: each coefficient begins somewhere and drifts by so much a year. Each calibration errs by
what its covariance says.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

G0 = 9.80665  # m/s²
ARCSEC = np.pi / 648_000
UNITS = {
    "k0": "m/s²",
    "k1": "1",
    "delta_o": "rad",
    "delta_p": "rad",
    "bias": "rad/s",
    "scale": "1",
}
STD = {  # of a laboratory's calibration, SI
    "k0": 20e-6 * G0,
    "k1": 10e-6,
    "delta_o": 2 * ARCSEC,
    "delta_p": 2 * ARCSEC,
    "bias": 0.05 * ARCSEC,
    "scale": 10e-6,
}
DAYS_A_YEAR = 365.25
FIRST = datetime(2020, 3, 1, 9, 30, tzinfo=UTC)


def axes(names: Sequence[str]) -> list[dict[str, Any]]:
    """Return axes as the file has them: x, y, z along the body, the next one pendulous."""
    rows = np.eye(3)
    made: list[dict[str, Any]] = []
    for name in names:
        k = "xyz".index(name[1])
        force = name[0] == "a"
        readout = {
            "scale": 1.0,
            "offset": 0.0,
            "unit": "m/s²" if force else "rad/s",
            "full_scale": None,
        }
        made.append(
            {
                "name": name,
                "measures": "f" if force else "w",
                "i": rows[k].tolist(),
                "p": rows[(k + 1) % 3].tolist(),
                "readout": readout,
            }
        )
    return made


def coefficients(names: Sequence[str]) -> list[str]:
    """Return bias, scale and misalignments of axes."""
    made: list[str] = []
    for name in names:
        first = ("k0", "k1") if name[0] == "a" else ("bias", "scale")
        made += [f"{name}.{short}" for short in (*first, "delta_o", "delta_p")]
    return made


@dataclass(frozen=True, eq=False)
class Truth:
    """What a sensor is, at the first calibration, and how it drifts a year; SI by full name."""

    sensor: str
    axes: tuple[str, ...]
    start: Mapping[str, float]
    drift: Mapping[str, float]

    @property
    def names(self) -> list[str]:
        """Coefficients in the order of the file."""
        return coefficients(self.axes)

    def at(self, years: float) -> NDArray[np.float64]:
        """Return all coefficients so many years after the first calibration."""
        return np.array(
            [self.start.get(n, 0.0) + years * self.drift.get(n, 0.0) for n in self.names]
        )


def stds(names: Sequence[str]) -> NDArray[np.float64]:
    """Return the standard uncertainties of coefficients."""
    return np.array([STD[name.partition(".")[2]] for name in names])


def covariance(names: Sequence[str], seed: int, factor: float = 1.0) -> NDArray[np.float64]:
    """Return a covariance with those standard uncertainties and some correlation."""
    rng = np.random.default_rng(seed)
    root = np.eye(len(names)) + 0.1 * rng.standard_normal((len(names), len(names)))
    c = root @ root.T
    s = factor * stds(names) / np.sqrt(np.diag(c))
    return c * np.outer(s, s)


def content(
    truth: Truth,
    years: float,
    rng: np.random.Generator,
    method: str = "turntable_kalman",
    factor: float = 1.0,
    **more: Any,
) -> dict[str, Any]:
    """Return one calibration as its file has it, with its hash."""
    names = truth.names
    c = covariance(names, 7, factor)
    values = truth.at(years) + np.linalg.cholesky(c) @ rng.standard_normal(len(names))
    rows = zip(names, values.tolist(), np.sqrt(np.diag(c)).tolist(), strict=True)
    created = FIRST + timedelta(days=years * DAYS_A_YEAR)
    made: dict[str, Any] = {
        "schema": "inercal/calibration/2",
        "sensor": {
            "name": truth.sensor,
            "form": "reference",
            "reference_temperature_K": 293.15,
            "axes": axes(truth.axes),
        },
        "method": method,
        "estimator": "full",
        "coefficients": [
            {"name": n, "value": v, "std": s, "unit": UNITS[n.partition(".")[2]]}
            for n, v, s in rows
        ],
        "covariance": c.tolist(),
        "frame": "mount",
        "mount": np.eye(3).tolist(),
        "conditions": {"gravity": "9.81 m/s²"},
        "provenance": {
            "recording": "recording.h5",
            "recording sha256": hashlib.sha256(str(created).encode()).hexdigest(),
            "created": created.isoformat(),
        },
        "notes": ["made by a generator"],
    } | more
    return hashed(made)


def hashed(made: dict[str, Any]) -> dict[str, Any]:
    """Return content with the hash that fits it."""
    made = {key: value for key, value in made.items() if key != "sha256"}
    text = json.dumps(made, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return made | {"sha256": hashlib.sha256(text.encode()).hexdigest()}


def write(path: Path, made: dict[str, Any]) -> Path:
    """Write content as a calibration file."""
    path.write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


IMU = ("ax", "ay", "az", "gx", "gy", "gz")
DRIFTING = Truth(
    "MIMU № 17",
    IMU,
    {"ax.k0": 3e-3 * G0, "ay.k1": -4e-4, "gx.bias": 5 * ARCSEC},
    {"ax.k0": 60e-6 * G0, "gz.scale": -25e-6},  # µg and ppm a year
)


def ten(folder: Path, truth: Truth = DRIFTING, seed: int = 1) -> list[Path]:
    """Write ten calibrations of a sensor, one every half year."""
    rng = np.random.default_rng(seed)
    return [write(folder / f"{k}.calibration.json", content(truth, k / 2, rng)) for k in range(10)]
