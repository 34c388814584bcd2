"""What the operator of a dividing head does, position by position, in words.

Where the autocollimator is read in pairs, the head is trimmed until it reads at 180° what it read
at 0°, and at 270° what it read at 90°. Readings are matched as they are: what a certificate says of
the faces is added afterwards, where the angles are worked out
(`inercal.benches.dividing_head.head_angles.sensor_angles`), so that nobody adds it at the head, nor
twice.

The way back comes to 180° before 0°. There the mark is what 0° read in the first pass: a head errs
alike at each visit. Where readings are written down, each pass comes to 0° and 90° by the head
itself: what is trimmed badly shows within a pair, not between passes. Where they are not, all
positions of a pair are trimmed to one mark.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, pi

from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.passes import (
    CARDINAL_ANGLES,
    matches_any_angle,
    missing_cardinal_angles,
    pass_numbers,
)
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.errors import InputError
from inercal.plan import Index

_DEGREE, _MINUTE = 360_000, 6_000  # in 0.01″


@dataclass(frozen=True)
class OperatorRow:
    """A position and what is done there.

    Parameters
    ----------
    number : int
        From 1.
    step : Index
    in_pass : int
        From 1.
    autocollimator : str
        What is done with it, in words; empty is nothing.
    """

    number: int
    step: Index
    in_pass: int
    autocollimator: str

    @property
    def sense(self) -> str:
        """Of the pass."""
        return "forward" if self.step.sense > 0 else "reverse"

    @property
    def angle(self) -> str:
        """Of the head, as it is set."""
        return format_sexagesimal(self.step.angle)


def operator_rows(
    bench: DividingHead, steps: Sequence[Index], recorded: bool
) -> tuple[OperatorRow, ...]:
    """Return what is done at each position.

    Parameters
    ----------
    bench : DividingHead
    steps : sequence of Index
        In order; the first pass is forward.
    recorded : bool
        Whether the autocollimator's readings have a column: they need not be brought to a mark.

    Raises
    ------
    InputError
        Pairs that a pass lacks a position of.
    """
    paired = bench.collimated == "pairs"
    if paired:
        _require_pairs(steps)
    which = dict(zip((step.label for step in steps), pass_numbers(steps), strict=True))

    def act(step: Index) -> str:
        mark = _trim_reference(bench, step, steps)
        if mark is None:
            return ""
        if mark is step or (recorded and not (paired and _is_trimmed_position(step))):
            return "read and write down"
        elsewhere = which[mark.label] != which[step.label]
        where = format_sexagesimal(mark.angle) + f" in pass {which[mark.label] + 1}" * elsewhere
        return f"trim the head until it reads as at {where}" + ", and write down" * recorded

    return tuple(
        OperatorRow(k, step, which[step.label] + 1, act(step))
        for k, step in enumerate(steps, start=1)
    )


def format_sexagesimal(angle: float) -> str:
    """Return an angle, rad, in whole degrees, and in minutes and seconds where it is not whole.

    >>> from math import pi
    >>> [format_sexagesimal(pi / x) for x in (2, 8, 7)]
    ['90°', '22° 30′', '25° 42′ 51.43″']
    """
    whole, rest = divmod(round(degrees(angle) * _DEGREE), _DEGREE)
    minutes, rest = divmod(rest, _MINUTE)
    text = f"{whole}°"
    if minutes or rest:
        text += f" {minutes}′"
    return text + (f" {rest / 100:g}″" if rest else "")


def _trim_reference(bench: DividingHead, step: Index, steps: Sequence[Index]) -> Index | None:
    """Return the position whose reading a step's is matched to; None where none is taken."""
    if bench.collimated == "every":
        return steps[0]
    square = matches_any_angle(step.angle, CARDINAL_ANGLES)
    if bench.collimated == "none" or not square:
        return None
    return next(one for one in steps if matches_any_angle(one.angle, (step.angle, step.angle + pi)))


def _is_trimmed_position(step: Index) -> bool:
    """Return whether a step is the one of a pair that is trimmed: 180° or 270°."""
    return matches_any_angle(step.angle, CARDINAL_ANGLES[2:])


def _require_pairs(steps: Sequence[Index]) -> None:
    for name, angles in missing_cardinal_angles(steps).items():
        missing = ", ".join(map(format_sexagesimal, angles))
        raise InputError(
            f"{name} has no {missing}, and the autocollimator is read in pairs, 180° as 0° and "
            "270° as 90°: take 12 positions or another multiple of 4"
        )


def operator_notes(
    bench: DividingHead, steps: Sequence[Index], data: DividingHeadData
) -> tuple[str, ...]:
    """Return what holds for all positions.

    Parameters
    ----------
    bench : DividingHead
    steps : sequence of Index
    data : DividingHeadData
        With the columns that are filled in.
    """
    turning = any(step.sense < 0 for step in steps)
    found = [
        _mounting_note(data.accelerometer),
        "Follow the rows from the first to the last, "
        + ("forward and back, " if turning else "")
        + "without a longer pause: what drifts is taken to drift evenly.",
        "Come to each position in the sense of its pass. After going too far, go well back and "
        "come again." + " Where the head turns round, go past the position and return." * turning,
        f"Wait until the readings stand still, then average them{_averaging_time(steps)}.",
        "While readings are taken, do not touch the pier or walk about it.",
    ]
    found += _autocollimator_notes(bench, data)
    if data.level is not None:
        found.append(
            f"Read the level at each position, in {data.level_unit}: positive where the base "
            "leans in the sense in which the head's angle grows."
        )
    found.append(
        "A position that went wrong is taken out: its row goes from the file."
        + " One at 0°, 90°, 180° or 270° is taken again." * (bench.collimated == "pairs")
    )
    return tuple(found)


def _mounting_note(accelerometers: Sequence[str | int]) -> str:
    first, *second = accelerometers
    both = "".join(f" and {name} at 0°" for name in second)
    return f"Before the first row make sure that {first} reads most at 90°{both}."


def _averaging_time(steps: Sequence[Index]) -> str:
    seconds = {step.seconds for step in steps}
    return f" for {seconds.pop():g} s" if len(seconds) == 1 and 0.0 not in seconds else ""


def _autocollimator_notes(bench: DividingHead, data: DividingHeadData) -> list[str]:
    if bench.collimated == "none":
        return []
    found: list[str] = []
    if data.autocollimator is not None:
        if bench.collimated == "every":
            found.append("At the first row turn the autocollimator to near zero, and then no more.")
        found.append(
            f"Write down what the autocollimator reads, in {data.autocollimator_unit}: positive "
            "where the head stands beyond its angle, in the sense in which the angle grows."
        )
    if bench.collimated == "pairs" or data.autocollimator is None:
        found.append(
            "Where the head is trimmed, its own scale comes to read a little off the angle: leave "
            "the angle in the table as it is."
        )
    if bench.polygon:
        found.append(
            "Take the readings as they are, and do not add the polygon's certificate: the "
            "calibration allows for the deviations of its faces."
        )
    return found
