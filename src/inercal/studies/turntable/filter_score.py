"""How many devices came out: root mean squares in the source's units, and NEES."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.studies.rms import Rms, rms
from inercal.studies.turntable.simulated_turntable import ARCSEC, DEG_MIN, MICRO_G, PPM, SENSOR
from inercal.studies.turntable.studied_filters import FilterErrors

CoefficientKind = Literal["bias", "scale", "misalignment"]
COEFFICIENT_KINDS: dict[CoefficientKind, tuple[str, ...]] = {
    "bias": ("bias", "k0"),
    "scale": ("scale", "k1"),
    "misalignment": ("delta_o", "delta_p"),
}
_GYROS = SENSOR.select_axes("w").coefficients


class FilterScore(NamedTuple):
    """Of many devices with one filter, bias °/min or µg, scale ppm, misalignment ″.

    `worst` has the same with only the largest error of each device: what a bound is about.
    """

    bias: Rms
    scale: Rms
    misalignment: Rms
    nees: Rms  # a coefficient
    largest_axis: dict[CoefficientKind, Rms]


def errors_of_kind(found: Sequence[FilterErrors], kind: CoefficientKind, of: str) -> Array:
    """Return the errors of one kind of the gyros ("g") or accelerometers ("a"), (devices, k)."""
    off = np.array([one.error for one in found])
    return off[:, coefficient_indices(kind)] / printed_unit_size(kind, of)


def coefficient_indices(kind: CoefficientKind) -> list[int]:
    """Return the indices of the coefficients of a kind; both triads have the same order."""
    return [
        k for k, name in enumerate(_GYROS) if CoefficientName(name).term in COEFFICIENT_KINDS[kind]
    ]


def printed_unit_size(kind: CoefficientKind, of: str) -> float:
    """Return °/min or µg, ppm, ″ in SI."""
    return {"bias": DEG_MIN if of == "g" else MICRO_G, "scale": PPM, "misalignment": ARCSEC}[kind]


def nees(found: Sequence[FilterErrors]) -> Rms:
    """Return the mean squared error over what is stated, a coefficient: 1 where that is right."""
    each = np.array(
        [one.error @ np.linalg.solve(one.covariance, one.error) / one.error.size for one in found]
    )
    return Rms(float(each.mean()), float(each.std(ddof=1) / np.sqrt(each.size)))


def score_filter(found: Sequence[FilterErrors], of: str) -> FilterScore:
    """Return the score of the gyros ("g") or the accelerometers ("a")."""
    errors: dict[CoefficientKind, Array] = {
        kind: errors_of_kind(found, kind, of) for kind in COEFFICIENT_KINDS
    }
    worst: dict[CoefficientKind, Rms] = {
        k: rms(np.abs(off).max(axis=1), ddof=1) for k, off in errors.items()
    }
    bias, scale, misalignment = (rms(off, ddof=1) for off in errors.values())
    return FilterScore(bias, scale, misalignment, nees(found), worst)
