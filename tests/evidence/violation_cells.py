"""Cells of the table: a case, a violation of some size, devices; what inercal said is counted."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from zlib import crc32

import numpy as np
from tests.evidence import graded_calibration
from tests.evidence.cases import (
    centrifuge,
    dividing_head,
    hand,
    hand_recordings,
    rate_platform,
    rate_table,
    turntable,
)
from tests.evidence.visibility_model import (
    Case,
    Files,
    Violation,
    Visibility,
    angle,
    angle_to_space,
)

CASES: Mapping[str, Callable[[], Case]] = {
    "six_position": hand.six_position,
    "ferraris": hand.ferraris,
    "six_position, recorded": hand_recordings.six_position,
    "multi_position": hand_recordings.multi_position_means,
    "multi_position, recorded": hand_recordings.multi_position,
    "centrifuge_norm": centrifuge.centrifuge_norm,
    "dual_orthogonal": dividing_head.dual_orthogonal,
    "tumble": dividing_head.tumble,
    "rates_and_poses": rate_platform.rates_and_poses,
    "ship_planar": rate_table.ship_planar,
    "ship_multi_angle": rate_table.ship_multi_angle,
    "turntable_discrete": turntable.turntable_discrete,
    "turntable_kalman": turntable.turntable_kalman,
    "turntable_trajectory": turntable.turntable_trajectory,
}
FIVE_U, ETA_SIX, WITHOUT_SIZE, BASE = "5 u", "η = 6", "as it is", "base"
GRADES = ("consistent", "reservations", "unreliable", "refused")
VISIBLE_ETA = 6.0  # η from which a violation must be said
MIN_RIVAL_ANGLE = 30.0  # ° from which two causes can be told apart
DEVICES, BASE_SEEDS, BASE_DEVICES = 40, (1, 2, 3), 300


@dataclass(frozen=True)
class Cell:
    """One cell.

    Parameters
    ----------
    case, violation : str
        Names; no violation is the base.
    at : str
        How the size was chosen.
    size : float
        In the violation's unit.
    eta : float
        At that size, computed apart from inercal.
    apart : float
        Angle to the nearest other violation of the case, °.
    seed, devices : int
    """

    case: str
    violation: str
    at: str
    size: float
    eta: float
    apart: float
    seed: int
    devices: int

    @property
    def visible(self) -> bool:
        return self.eta >= VISIBLE_ETA


@dataclass(frozen=True)
class Count:
    """How many devices of a cell were graded how, and in how many the true cause was named.

    Parameters
    ----------
    consistent, reservations, unreliable, refused : int
    first, group : int
        The true cause is the suspect; it is among the group that is named.
    printed : int
        A limitation that is printed names the cause, where no key of the run file counts it; or
        it is in the group that is named.
    nees : float
        Mean over devices that gave a result; NaN without.
    p_values : mapping of str to tuple of float
        Of base cells: those of χ² and of each group of residuals, of all devices that gave a
        result, sorted, to four digits.
    """

    consistent: int = 0
    reservations: int = 0
    unreliable: int = 0
    refused: int = 0
    first: int = 0
    group: int = 0
    printed: int = 0
    nees: float = math.nan
    p_values: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])

    @property
    def devices(self) -> int:
        return self.consistent + self.reservations + self.unreliable + self.refused

    @property
    def noticed(self) -> int:
        return self.devices - self.consistent

    def __add__(self, other: "Count") -> "Count":
        one, two = self.devices - self.refused, other.devices - other.refused
        parts = [n * c.nees for n, c in ((one, self), (two, other)) if n]
        return Count(
            self.consistent + other.consistent,
            self.reservations + other.reservations,
            self.unreliable + other.unreliable,
            self.refused + other.refused,
            self.first + other.first,
            self.group + other.group,
            self.printed + other.printed,
            sum(parts) / (one + two) if parts else math.nan,
            {
                name: tuple(sorted((*self.p_values.get(name, ()), *other.p_values.get(name, ()))))
                for name in {**self.p_values, **other.p_values}
            },
        )


@cache
def find_case(name: str) -> Case:
    return CASES[name]()


@cache
def visibilities(name: str) -> dict[str, tuple[Violation, Visibility]]:
    """Return the violations of a case that have a size, by name, with what one unit does."""
    return {violation.name: (violation, seen) for violation, seen in find_case(name).sized()}


def nearest_rival_angle(name: str, violation: str) -> float:
    """Return the angle to the nearest other cause, °: a violation, a coefficient or a row."""
    own, seen = visibilities(name)[violation]
    spaces = find_case(name).spaces
    around = [
        angle_to_space(seen, basis)
        for key, basis in spaces.items()
        if key not in own.suspects
        and not set(find_case(name).rivals.get(key, ())) & set(own.change)
    ]
    rivals = [
        angle(seen, other)
        for key, (one, other) in visibilities(name).items()
        if key != violation and not set(one.suspects) & set(own.suspects)
    ]
    return min([*rivals, *around], default=90.0)


def case_cells(name: str, seed: int = 1, devices: int = DEVICES) -> Iterator[Cell]:
    """Yield the cells of a case but for its base.

    A size beyond what needs a test to be noticed is left out, as is one at which nothing shifts.
    """
    for violation in find_case(name).violations:
        if violation.gross is not None:
            eta = find_case(name).eta_of_gross(violation)
            yield Cell(name, violation.name, WITHOUT_SIZE, math.nan, eta, 90.0, seed, devices)
            continue
        seen = visibilities(name)[violation.name][1]
        apart = nearest_rival_angle(name, violation.name)
        sizes = ((FIVE_U, seen.at_five, seen.eta_at_five), (ETA_SIX, seen.at_six, VISIBLE_ETA))
        for at, size, eta in sizes:
            if math.isfinite(size):
                yield Cell(name, violation.name, at, size, eta, apart, seed, devices)


def base_cells(name: str, devices: int = BASE_DEVICES) -> Iterator[Cell]:
    """Yield the base of a case with each of its seeds."""
    for seed in BASE_SEEDS:
        yield Cell(name, "", BASE, 0.0, 0.0, 90.0, seed, devices)


def split_cell(cell: Cell, most: int = 10) -> list[tuple[Cell, range]]:
    """Return parts of a cell that can be worked on side by side."""
    starts = range(0, cell.devices, most)
    return [(cell, range(k, min(k + most, cell.devices))) for k in starts]


def count_answers(part: tuple[Cell, range]) -> Count:
    """Return what inercal said of some devices of a cell."""
    cell, devices = part
    whole = Count()
    for k in devices:
        answer = calibrate_device(cell, k)
        own = next((v for v in find_case(cell.case).violations if v.name == cell.violation), None)
        suspects = own.suspects if own else ()
        grades = [int(answer.grade == word) for word in GRADES]
        named = [int(bool(set(names) & set(suspects))) for names in (answer.first, answer.group)]
        printed = own is not None and own.limit != "" and answer.limits_name(own.limit)
        printed |= bool(named[1])
        p_values = {name: (round(p, 4),) for name, p in answer.p_values.items() if cell.at == BASE}
        whole = whole + Count(
            *grades, *named, printed=int(printed), nees=answer.nees, p_values=p_values
        )
    return whole


def calibrate_device(cell: Cell, k: int) -> graded_calibration.GradedCalibration:
    """Return what inercal said of one device of a cell."""
    files, truth = device_files(cell, k)
    return graded_calibration.calibrate_files(files, truth)


def device_files(cell: Cell, k: int) -> tuple[Files, dict[str, float]]:
    """Return the files of one device of a cell, and its coefficients by name, SI."""
    here = find_case(cell.case)
    rng = np.random.default_rng([cell.seed, k, crc32(f"{cell.case} {cell.violation}".encode())])
    values = here.draw(rng)
    truth = {name: values[name] for name in here.coefficients}
    gross = None
    for violation in here.violations:
        if violation.name != cell.violation:
            continue
        if violation.gross is not None:
            gross = violation
        size = 1.0 if violation.gross is not None else cell.size * violation.si
        for name, per_unit in violation.change.items():
            change = size * per_unit
            values[name] = values.get(name, 0.0) + change
    return here.files(values, rng, gross), truth
