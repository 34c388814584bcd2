"""Describe the mountings of a triad on a rate table, and the plans of the ship-model paper.

The name of a plane gives the axis that points to the centre, then the other horizontal axis: Z is
up in "XY" and "YX", and X is up in "ZY". With e_r the axis toward the centre, e_n the upward axis
and e_t = e_n × e_r, a tilt α about the tangential direction gives::

    centre = cos α e_r − sin α e_n,   up = sin α e_r + cos α e_n

so that e_r senses A cos α + sin α and e_n −A sin α + cos α, in g. With a tilt about the radial
direction the centre remains along e_r, and up = cos α e_n + sin α e_t.

The source has one pose with two tilts, "XY at 135° to the plane of rotation and ZY at 45°", without
a definition. There are three interpretations of a second tilt β:

* dihedral: both are angles between planes, up·e_n = cos α and up·e_r = cos β; at 135° and 45° this
  is the same as the pose with only the tilt of 135°;
* azimuth: the sensor is turned by β about e_n on the fixture, so that cos β e_r + sin β e_t
  replaces e_r, and then tilted by α;
* successive: the sensor is tilted by α, then by β about the radial direction:
  up = cos β up_α + sin β e_t.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
sections 3.1 and 3.2.
"""

from collections.abc import Sequence
from math import degrees, pi, radians
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.plan import AXES, Attitude, Spin

Plane = Literal["XY", "YX", "ZY"]
TiltConvention = Literal["azimuth", "dihedral", "successive"]
TiltAxis = Literal["tangential", "radial"]
PLANES: dict[Plane, tuple[str, str]] = {"XY": ("x", "z"), "YX": ("y", "z"), "ZY": ("z", "x")}
RPM = pi / 30  # rad/s
FAST_SPEED_RPM, SLOW_SPEED_RPM = 86.0, 46.0  # r/min
_DIGITS = ".9g"  # format of a tilt in °, precise enough that different tilts get different names


def mounting_attitude(
    plane: Plane,
    tilt: float = 0.0,
    second: float | None = None,
    *,
    reading: TiltConvention = "azimuth",
    about: TiltAxis = "tangential",
) -> Attitude:
    """Return the attitude of a mounting, with a name such as "XY", "XY30" or "XY135+45".

    Parameters
    ----------
    plane : "XY", "YX" or "ZY"
    tilt : float
        Angle between the plane and the plane of rotation, rad.
    second : float, optional
        Second tilt, rad; the first tilt is then about the tangential direction.
    reading : "azimuth", "dihedral" or "successive"
        Interpretation of the second tilt.
    about : "tangential" or "radial"
        Axis of a single tilt.

    Raises
    ------
    InputError
        The plane is unknown, or no pose has these two dihedral angles.
    """
    if plane not in PLANES:
        raise InputError(
            f"mounting {plane!r} is unknown; the planes are {', '.join(PLANES)}", key="plane"
        )
    radial, normal = (np.array(AXES[axis]) for axis in PLANES[plane])
    level = np.cross(normal, radial)
    c, s = _cos_sin(tilt)
    c2, s2 = (1.0, 0.0) if second is None else _cos_sin(second)
    name = plane + (f"{degrees(tilt):{_DIGITS}}" if tilt else "")
    along = c2 * radial + s2 * level if reading == "azimuth" else radial
    centre, up = c * along - s * normal, s * along + c * normal
    if second is not None:
        name += f"{degrees(second):+{_DIGITS}}"
        if reading == "successive":
            up = c2 * up + s2 * level
        elif reading == "dihedral":
            rest = 1 - c**2 - c2**2
            if rest < -1e-12 or c**2 + c2**2 < 1e-12:
                raise InputError(
                    f"mounting {name}: no pose has these two dihedral angles; change one of them",
                    key="second",
                )
            up = c2 * radial + c * normal + np.sqrt(max(rest, 0.0)) * level
            centre = np.cross(level, up) / np.hypot(c, c2)
    elif about == "radial" and tilt:
        centre, up, name = radial, c * normal + s * level, f"{name}r"
    return Attitude(_vector(-centre), _vector(up), name)


def planar_plan(
    speeds: Sequence[float] = (0.0, SLOW_SPEED_RPM * RPM, FAST_SPEED_RPM * RPM),
    seconds: float = 150.0,
) -> tuple[Spin, ...]:
    """Return the nine states of the planar method: XY, YX and ZY, each at 0, 46 and 86 r/min.

    Parameters
    ----------
    speeds : sequence of float
        Set speeds, rad/s.
    seconds : float
        Length of each dwell, s.
    """
    return tuple(_dwell(mounting_attitude(plane), w, seconds) for plane in PLANES for w in speeds)


def multi_angle_plan(
    reading: TiltConvention = "azimuth",
    about: TiltAxis = "tangential",
    *,
    one_speed: bool = False,
    seconds: float = 150.0,
) -> tuple[Spin, ...]:
    """Return sixteen groups of tilted mountings.

    By default these are the ten poses that the source names (30°, 60° and 135° in three planes, and
    one pose with two tilts) at 86 r/min. By our choice the poses at 30° and 135° are repeated at
    46 r/min.

    Parameters
    ----------
    reading : "azimuth", "dihedral" or "successive"
        Interpretation of the second tilt in the pose with two tilts.
    about : "tangential" or "radial"
        Axis of the other tilts.
    one_speed : bool
        Whether all sixteen are at 86 r/min, as in the source. The source names only ten of its
        sixteen poses, so poses at 45° and 120° in three planes replace the others.
    seconds : float
        Length of each dwell, s.
    """
    tilts = (30, 45, 60, 120, 135) if one_speed else (30, 60, 135)
    single = [mounting_attitude(p, radians(t), about=about) for p in PLANES for t in tilts]
    poses = [*single, mounting_attitude("XY", radians(135), radians(45), reading=reading)]
    fast = [_dwell(pose, FAST_SPEED_RPM * RPM, seconds) for pose in poses]
    if one_speed:
        return tuple(fast)
    again = [mounting_attitude(p, radians(t), about=about) for p in PLANES for t in (30, 135)]
    return (*fast, *(_dwell(pose, SLOW_SPEED_RPM * RPM, seconds) for pose in again))


def group_by_mounting(steps: Sequence[Spin]) -> list[tuple[Spin, ...]]:
    """Return the steps in the order of a run: grouped by mounting and sorted by speed.

    Mountings are in the order of their first steps.
    """
    own: dict[Attitude | None, list[Spin]] = {}
    for step in steps:
        own.setdefault(step.attitude, []).append(step)
    return [tuple(sorted(each, key=lambda step: abs(step.rate))) for each in own.values()]


def is_tilted(step: Spin) -> bool:
    """Return whether a mounting is tilted, so that no body axis points to the centre or up."""
    if step.attitude is None:
        return False
    parts = np.abs([step.attitude.out, step.attitude.up])
    return bool((parts.max(axis=1) < 1 - 1e-9).any())


def _dwell(attitude: Attitude, w: float, seconds: float) -> Spin:
    return Spin(f"{attitude.name}_{w / RPM:.4g}", w, seconds, attitude)


def _cos_sin(angle: float) -> tuple[float, float]:
    """Return cosine and sine, where a zero has no rounding error."""
    c, s = (float(x) for x in (np.cos(angle), np.sin(angle)))
    return (0.0 if abs(c) < 1e-15 else c), (0.0 if abs(s) < 1e-15 else s)


def _vector(v: Array) -> tuple[float, float, float]:
    x, y, z = (v + 0.0).tolist()
    return x, y, z
