"""Plans of rates and poses: settings with a case axis up, and poses about level."""

from itertools import product
from math import pi, radians

from inercal.basics.errors import InputError
from inercal.benches.rate_platform.sections import (
    PlatformStep,
    Pose,
    RateDwell,
    dwell_label,
    pose_label,
    whole_turns,
)
from inercal.recordings.data.recording_loader import number_repeated_names

_SETTINGS = {3: ("x", "y", "z"), 6: ("x", "-x", "y", "-y", "z", "-z")}
_SPEEDS = (radians(50), radians(200))
_FACES = ((0, 0), (180, 0), (90, 0), (-90, 0), (0, 90), (0, -90))  # roll and pitch, °
# Three circles in steps of 45°, with x, y and z level, and poses with all axes inclined.
_TILTED = (
    *((roll, 0) for roll in range(0, 360, 45)),
    *((0, pitch) for pitch in (45, 90, 135, -135, -90, -45)),
    *((90, pitch) for pitch in (45, 135, -135, -45)),
    *product((45, -45, 135), (35, -35)),
)
_POSES = {"none": (), "faces": _FACES, "tilted": _TILTED}


def plan(
    seconds: float = 36.0,
    positions: int = 6,
    rates: tuple[float, ...] = _SPEEDS,
    reverse: bool = False,
    attitudes: str = "none",
) -> tuple[PlatformStep, ...]:
    """Return rests and each speed in both senses in every setting; then the poses.

    Parameters
    ----------
    seconds : float
        Longest time of a section: dwells are over whole turns, if one is short enough.
    positions : int
        Number of settings: 3, each axis up, or 6, each up and down.
    rates : tuple of float
        Speeds, rad/s, each positive.
    reverse : bool
        Whether each sense also goes back through the speeds, to show a hysteresis.
    attitudes : str
        Poses at the end: "none", "faces", six of them, or "tilted", 24 in all
        directions.

    Raises
    ------
    InputError
        Another number of settings or other poses, or a speed that is not positive.
    """
    if positions not in _SETTINGS:
        raise InputError(
            f"positions is {positions}; give 3, each axis up, or 6, each up and down",
            key="[method] positions",
        )
    if attitudes not in _POSES:
        raise InputError(
            f"attitudes is {attitudes!r}; the poses are {', '.join(_POSES)}",
            key="[method] attitudes",
        )
    if any(rate <= 0 for rate in rates):
        raise InputError(
            "rates has a speed that is not positive; give speeds, each is turned in both senses",
            key="[method] rates",
        )
    of_setting = _rates_of_setting(rates, reverse)
    dwells = [(axis, rate) for axis in _SETTINGS[positions] for rate in of_setting]
    names = number_repeated_names([dwell_label(axis, rate) for axis, rate in dwells])
    turns = [
        RateDwell(name, axis, rate, whole_turns(rate, seconds))
        for name, (axis, rate) in zip(names, dwells, strict=True)
    ]
    angles = [(roll * pi / 180, pitch * pi / 180) for roll, pitch in _POSES[attitudes]]
    return (*turns, *(Pose(pose_label(*each), *each, seconds) for each in angles))


def _rates_of_setting(rates: tuple[float, ...], reverse: bool) -> list[float]:
    """Return the rates of one setting in their order, rests included."""
    if not rates:
        return [0.0]
    if not reverse:
        return [0.0, *(signed for rate in rates for signed in (rate, -rate)), 0.0]
    through = [*rates, *rates[-2::-1]]
    return [0.0, *through, 0.0, *(-rate for rate in through), 0.0]
