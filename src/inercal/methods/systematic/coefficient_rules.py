"""Name the coefficients that no sequence of turns between rests determines.

An error message names these coefficients before the estimation starts. The code uses rules instead
of the rank, because the apparent information about a gauge is only noise.
"""

from collections.abc import Sequence
from math import cos, degrees, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.methods import Priors
from inercal.physics.frames import log_so3
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

# The body frame: ax along x, ay in the xy plane
FRAME = ("ax.delta_o", "ax.delta_p", "ay.delta_o")
COMMON_ARM = ("az.arm_i", "az.arm_p", "az.arm_o")
_CUBE = cos(radians(15))  # at a face of the cube, the unit force has a larger component
_FACE = 0.5 * G0
_LEAST_TURN = radians(45)  # total turn about an axis
# Terms that equal another term if |f| is gravity or zero
_ALIKE = {"k1_prime": "k2", "k3": "k1"}


def require_determined(sensor: Sensor, observations: Observations, priors: Priors) -> None:
    """Raise an error if these rests and the priors cannot determine the coefficients.

    Parameters
    ----------
    sensor : Sensor
        The sensor with the selected coefficients.
    observations : Observations
        One row for each rest.
    priors : sequence of Gaussian

    Raises
    ------
    NotObserved
        The rotation of the body frame or a common lever arm is free, or all rests are at faces of a
        cube and even-order terms are free.
    InputError
        An axis has no rest upwards or downwards.
    """
    known = {name for prior in priors for name in prior.names}
    chosen = [name for name in sensor.coefficients if name not in known]
    _refuse_gauge(
        chosen,
        FRAME,
        "rotation of the body frame",
        "no observation fixes the frame to which the misalignments of accelerometers and gyros "
        "refer, so choose nonorthogonality (ax along x, ay in the xy plane)",
    )
    _refuse_gauge(
        chosen,
        COMMON_ARM,
        "common arm",
        "the data do not determine where the common point of all three accelerometers is, "
        "because its velocity is zero at both ends of a turn; choose ax.arm and ay.arm, which "
        "are relative to az",
    )
    force = observations.mean[:, [axis.measures == "f" for axis in sensor.axes]]
    _require_both_faces(sensor, force)
    largest = np.abs(force).max(axis=1) / np.linalg.norm(force, axis=1)
    if (largest < _CUBE).any():
        return
    names = tuple(n for n in chosen if CoefficientName(n).term in _ALIKE)
    if names:
        partners = [
            f"{axis}.{_ALIKE[term]}" for axis, term in (CoefficientName(n).parts for n in names)
        ]
        raise NotObserved(
            f"all rests are within 15° of the faces of a cube, where {', '.join(names)} cannot "
            f"be distinguished from {partners[0]} (forces are gravity or zero); add rests at "
            "45°, or give a prior ([method.prior])",
            tuple(f"{name} and {other}" for name, other in zip(names, partners, strict=True)),
            names=names,
        )


def require_turns(attitudes: Array, sensor: Sensor, priors: Priors) -> None:
    """Raise NotObserved if gyro coefficients need turns about a body axis and there are none.

    Parameters
    ----------
    attitudes : (m, 3, 3) array
        C, body to n, at each rest.
    sensor : Sensor
    priors : sequence of Gaussian

    Raises
    ------
    NotObserved
        The message names the scale factor and the misalignments that sense that axis.
    """
    known = {name for prior in priors for name in prior.names}
    turned = np.abs(log_so3(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:])).sum(axis=0)
    names: list[str] = []
    for axis in (axis for axis in sensor.axes if axis.measures == "w"):
        for term, direction in zip(("scale", "delta_o", "delta_p"), axis.frame, strict=True):
            about = int(np.abs(direction).argmax())
            name = f"{axis.name}.{term}"
            if turned[about] < _LEAST_TURN and name in sensor.coefficients and name not in known:
                names.append(name)
    if names:
        still = [f"{axis} ({degrees(a):.0f}°)" for axis, a in zip("xyz", turned, strict=True)
                 if a < _LEAST_TURN]  # fmt: skip
        raise NotObserved(
            f"the path does not turn about body axis {' and '.join(still)}, so the data do not "
            f"determine {', '.join(names)}; add quarter turns about that axis while it is "
            "level, or give priors",
            tuple(names),
            names=tuple(names),
        )


def _refuse_gauge(chosen: Sequence[str], gauge: Sequence[str], what: str, reason: str) -> None:
    names = tuple(name for name in gauge if name in chosen)
    if names:
        raise NotObserved(
            f"{', '.join(names)}: {what} cannot be determined; {reason}", (what,), names=names
        )


def _require_both_faces(sensor: Sensor, force: Array) -> None:
    for k, axis in enumerate(axis for axis in sensor.axes if axis.measures == "f"):
        for way, reached in (("up", force[:, k].max()), ("down", -force[:, k].min())):
            if reached < _FACE:
                raise InputError(
                    f"{axis.name} is never turned {way} (it reads at most {reached / G0:.2f} g "
                    "that way), but bias and scale need both faces of each axis; add a rest "
                    f"with it {way}",
                    names=(axis.name,),
                )
