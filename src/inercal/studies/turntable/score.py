"""How many devices came out: root mean squares in the source's units, and NEES."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.keys import CoefficientName
from inercal.studies.rms import Rms, rms
from inercal.studies.turntable.experiment import ARCSEC, DEG_MIN, MICRO_G, PPM, SENSOR
from inercal.studies.turntable.filters import Found

Kind = Literal["bias", "scale", "misalignment"]
KINDS: dict[Kind, tuple[str, ...]] = {
    "bias": ("bias", "k0"),
    "scale": ("scale", "k1"),
    "misalignment": ("delta_o", "delta_p"),
}
_GYROS = SENSOR.only("w").coefficients


class Score(NamedTuple):
    """Of many devices with one filter, bias °/min or µg, scale ppm, misalignment ″.

    `worst` has the same with only the largest error of each device: what a bound is about.
    """

    bias: Rms
    scale: Rms
    misalignment: Rms
    nees: Rms  # a coefficient
    worst: dict[Kind, Rms]


def part(found: Sequence[Found], kind: Kind, of: str) -> Array:
    """Return the errors of one kind of the gyros ("g") or accelerometers ("a"), (devices, k)."""
    off = np.array([one.off for one in found])
    return off[:, places(kind)] / unit(kind, of)


def places(kind: Kind) -> list[int]:
    """Return where coefficients of a kind stand among twelve; both triads have one order."""
    return [k for k, name in enumerate(_GYROS) if CoefficientName(name).term in KINDS[kind]]


def unit(kind: Kind, of: str) -> float:
    """Return °/min or µg, ppm, ″ in SI."""
    return {"bias": DEG_MIN if of == "g" else MICRO_G, "scale": PPM, "misalignment": ARCSEC}[kind]


def nees(found: Sequence[Found]) -> Rms:
    """Return the mean squared error over what is stated, a coefficient: 1 where that is right."""
    each = np.array(
        [one.off @ np.linalg.solve(one.covariance, one.off) / one.off.size for one in found]
    )
    return Rms(float(each.mean()), float(each.std(ddof=1) / np.sqrt(each.size)))


def score(found: Sequence[Found], of: str) -> Score:
    """Return the score of the gyros ("g") or the accelerometers ("a")."""
    errors: dict[Kind, Array] = {kind: part(found, kind, of) for kind in KINDS}
    worst: dict[Kind, Rms] = {k: rms(np.abs(off).max(axis=1), ddof=1) for k, off in errors.items()}
    bias, scale, misalignment = (rms(off, ddof=1) for off in errors.values())
    return Score(bias, scale, misalignment, nees(found), worst)
