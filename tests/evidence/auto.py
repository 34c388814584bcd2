"""What `also = "auto"` adds: to devices that are as stated, and to devices with one violation.

Devices are made by the generators of `tests.evidence.cases`, which import nothing of inercal. Every
method is counted that can estimate more than it does by default, but `systematic`, which takes
seconds a device.

`python -m tests.evidence.auto` works out all devices in rounds, and after each row writes
docs/evidence/auto.json and the page beside it. `--rounds` stops earlier: every row says how many
devices it has. Rows that are stored go on where they stopped; `--anew` begins with none.
"""

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np
from scipy.stats import binom
from tests.evidence.graded_calibration import calibrate_files
from tests.evidence.stored_counts import FOLDER, current_commit, describe_machine
from tests.evidence.violation_cells import BASE_SEEDS, find_case, visibilities
from tests.evidence.visibility_model import Files, Violation, angle_to_space

DATA, PAGE = FOLDER / "auto.json", FOLDER / "auto.md"
BASE_DEVICES, DEVICES, OTHER_DEVICES = 600, 200, 40  # of each seed; of each violation
QUICK_ROUNDS, SLOW_ROUNDS = 20, 200
ETA, WEAK = 8.0, (4.0, 6.0)
DISTANCE = 3.0  # standard deviations of the difference of two causes' χ² that tell them apart
UNLIKE = (1.0, -0.7, 0.8)  # sizes of a violation on the axes; bench errors act on all axes alike
_TERMS = {
    "g": tuple(f"g{a}.{n}" for n in ("g_i", "g_p", "g_o") for a in "xyz"),
    # Norms do not observe a rotation of the triad.
    "nonorthogonality": ("ay.delta_p", "az.delta_o", "az.delta_p"),
}
_ACCELEROMETERS = ("k2", "k3", "koq")
ESTIMABLE = {
    "multi_position": ("k2", "k3"),
    "multi_position, recorded": ("k2", "k3", "g"),
    "centrifuge_norm": ("k3", "koq", "nonorthogonality"),
    "rates_and_poses": ("scale_prime", "scale2", "scale3"),
    "turntable_discrete": ("k2", "g"),
    "turntable_kalman": ("k2", "g"),
    "turntable_trajectory": ("k2", "g"),
}
"""Coefficients that a method of the cases can estimate, and does not by default."""
QUICK = ("multi_position", "centrifuge_norm", "rates_and_poses")
# Violations of the cases whose quantities are no coefficients of the result.
_OTHER_UNKNOWNS = ("third-order nonlinearity of the gyros", "non-orthogonality")
SWEPT = ("multi_position",)  # also where the tests do not always notice a violation


@dataclass(frozen=True)
class Row:
    """Devices of a kind.

    Parameters
    ----------
    case : str
    violation : str
        Name or group of the coefficients that are left out; the name of another violation of the
        case; empty of none.
    size, eta : float
        In units of `UNLIKE`, SI, or in the unit of the other violation; and η.
    apart : float
        Angle to the nearest other coefficient that the method can estimate, °.
    seed, devices : int
    """

    case: str
    violation: str
    size: float
    eta: float
    apart: float
    seed: int
    devices: int

    @property
    def of_round(self) -> int:
        """Devices of one round: slow methods have more rounds."""
        return self.devices // (QUICK_ROUNDS if self.case in QUICK else SLOW_ROUNDS)

    @property
    def is_estimable(self) -> bool:
        return self.violation in ESTIMABLE[self.case]

    @property
    def change(self) -> dict[str, float]:
        """By how much quantities of the case differ, SI."""
        if self.is_estimable:
            return {n: self.size * one for n, one in _unit_change(self.violation).items()}
        if not self.violation:
            return {}
        one = visibilities(self.case)[self.violation][0]
        return {n: self.size * one.si * by for n, by in one.change.items()}

    def device(self, k: int) -> tuple[Files, dict[str, float]]:
        """Return the files of a device and its coefficients by name, SI."""
        here = find_case(self.case)
        text = f"auto {self.case} {self.violation} {self.eta:.0f}"
        rng = np.random.default_rng([self.seed, k, crc32(text.encode())])
        values = here.draw(rng)
        truth = {name: values[name] for name in here.coefficients}
        for name, by in self.change.items():
            values[name] = values.get(name, 0.0) + by
            truth[name] = truth.get(name, 0.0) + by
        return here.files(values, rng, None), truth


@dataclass(frozen=True)
class Tally:
    """What was added to the devices of a row.

    Parameters
    ----------
    devices, refused : int
    truth, other : int
        Devices to which the violation was added; to which something else was.
    told : int
        Devices to which it was not added, and is named as explaining the residuals as well.
    nees : float
        Sum over the devices that were not refused, of all coefficients.
    exact, exact_nees : int and float
        Devices to which the violation was added and nothing else, and the sum over them.
    """

    devices: int = 0
    refused: int = 0
    truth: int = 0
    other: int = 0
    told: int = 0
    nees: float = 0.0
    exact: int = 0
    exact_nees: float = 0.0

    def __add__(self, more: "Tally") -> "Tally":
        return Tally(
            *(a + b for a, b in zip(vars(self).values(), vars(more).values(), strict=True))
        )

    @property
    def mean_nees(self) -> float:
        """NEES over its degrees of freedom; NaN of no device."""
        counted = self.devices - self.refused
        return self.nees / counted if counted else math.nan

    @property
    def mean_exact_nees(self) -> float:
        """The same of the devices to which the violation was added and nothing else."""
        return self.exact_nees / self.exact if self.exact else math.nan


def _unit_change(word: str) -> dict[str, float]:
    kind = "a" if word in _ACCELEROMETERS else "g"
    names = _TERMS.get(word, tuple(f"{kind}{a}.{word}" for a in "xyz"))
    return {name: UNLIKE[k % 3] for k, name in enumerate(names)}


@cache
def _left(case: str, word: str) -> Any:
    return find_case(case).visibility(Violation(word, change=_unit_change(word)))


@cache
def _space(case: str, word: str) -> Any:
    """Return an orthonormal basis of what a coefficient may leave, each axis by itself, (m, k)."""
    seen = [find_case(case).visibility(Violation(n, change={n: 1.0})) for n in _unit_change(word)]
    basis, _ = np.linalg.qr(np.stack([one.left for one in seen if one.eta > 0], axis=1))
    return basis


def base_rows() -> Iterator[Row]:
    """Yield the devices that are as stated."""
    for name in ESTIMABLE:
        for seed in BASE_SEEDS:
            yield Row(name, "", 0.0, 0.0, 90.0, seed, BASE_DEVICES)


def rows_of(case: str, word: str) -> Iterator[Row]:
    """Yield a violation that a method can estimate, at η = 8 and where rivals are told apart.

    Of two causes at an angle θ, χ² differs by η² sin²θ with a standard deviation of 2 η sin θ.
    """
    seen = _left(case, word)
    rivals = [_space(case, other) for other in ESTIMABLE[case] if other != word]
    apart = min((angle_to_space(seen, one) for one in rivals), default=90.0)
    told = 2 * DISTANCE / math.sin(math.radians(apart))
    for eta in (*(WEAK if case in SWEPT else ()), ETA, *((told,) if told > ETA else ())):
        yield Row(case, word, eta / seen.eta, eta, apart, 1, DEVICES)


def estimable_rows() -> Iterator[Row]:
    """Yield the rows of all violations that a method can estimate."""
    for case, words in ESTIMABLE.items():
        for word in words:
            yield from rows_of(case, word)


def other_rows() -> Iterator[Row]:
    """Yield the other violations of the cases, of all axes alike, at η = 8."""
    for name in QUICK:
        for violation, (_, seen) in visibilities(name).items():
            if math.isfinite(seen.at_six) and violation not in _OTHER_UNKNOWNS:
                yield Row(name, violation, seen.at_six * ETA / 6, ETA, 90.0, 1, OTHER_DEVICES)


def tally_of(row: Row, devices: range) -> Tally:
    """Return what was added to some devices of a row."""
    whole, change = Tally(), row.change
    words = {row.violation, *change}
    if row.violation and not row.is_estimable:
        words |= set(visibilities(row.case)[row.violation][0].suspects)
    for k in devices:
        found = calibrate_files(*row.device(k), also="auto")
        if found.grade == "refused":
            whole += Tally(1, refused=1)
            continue
        right = [bool(set(one.coefficients) & change.keys()) for one in found.additions]
        also = {name for one in found.additions for name in one.indistinguishable}
        told = not any(right) and bool(also & words)
        exact = bool(right) and all(right)
        nees = found.nees
        whole += Tally(1, 0, any(right), not all(right), told, nees, exact, exact * nees)
    return whole


Tallies = dict[Row, Tally]


def work_out(rounds: int, tallies: Tallies) -> Iterator[Tallies]:
    """Yield the tallies of all rows, after every row of every round."""
    rows = [*base_rows(), *estimable_rows(), *other_rows()]
    for k in range(1, rounds + 1):
        for row in rows:
            done = tallies.setdefault(row, Tally())
            more = range(done.devices, min(k * row.of_round, row.devices))
            if more:
                tallies[row] = done + tally_of(row, more)
                yield tallies


def chance_limit(devices: int, share: float = 0.01) -> int:
    """Return how many devices of a share of 1 % chance exceeds once in 2 000 times."""
    return int(binom.ppf(0.9995, devices, share))


_PAGE = """\
# A model that fits itself: what is added, counted

Written by `python -m tests.evidence.auto`; do not edit. Each device was calibrated with
`also = "auto"`, which adds the coefficients that the score tests ask for. The devices are those of
[the table of violations](violations.md). They were made by generators that are independent of
inercal. NEES is the mean of (error)ᵀ covariance⁻¹ (error) over the number of coefficients. It
includes all coefficients of the result and all devices, whatever was added to them; 1 is expected.

Seeds: {seeds} for devices without a violation, 1 for the others. Commit {commit}; {machine}.

## Nothing to add

In these devices, everything is as the run file states. The score tests reject at most 0.8 % of such
devices. The fourth column is the number that a true share of 1 % exceeds by chance in only one of
2 000 cases.

| method | devices | something was added | limit for a true 1 % | NEES |
|---|--:|--:|--:|--:|
{base}

## A coefficient that the method can estimate

All three axes have the violation, with sizes in the ratio 1 : −0.7 : 0.8. η is the norm of the
whitened residuals that the violation leaves; it was computed without inercal. The angle is the
angle to the nearest other coefficient of this table. If this angle is small, either of the two
coefficients may explain the residuals better by chance. The column "beside" counts the devices to
which the other coefficient was added, with a warning in the verdict that the true coefficient would
explain the residuals as well. For such coefficients, a further row has the η at which the data can
distinguish the two.

At η = 4 and 6, the tests do not always notice the violation. The filters of turntable_kalman begin
with an expected size of k2, so χ² drops by some units less than predicted. Near η = 8, some
coefficients are therefore not added. A coefficient is also not added if the leading suspect is one
that the method cannot estimate; koq, for example, may lead instead of k3. A device without the
addition has the errors of a calibration with the violation, so a few such devices increase the mean
NEES. The last column is the NEES of the devices to which only the violation was added. The column
"other" counts the devices to which something else was added.

| method | violation | angle | η | devices | added, % | beside, % | other, % | NEES | where added |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|
{estimable}

## Other causes

These violations concern the bench, or they concern the sensor but the method cannot estimate them,
or they have the same size on all axes, as an error of the bench has. In all rows, η is 8. If the
cause is not a coefficient of the method, any coefficient that was added is wrong, and only
resembles the cause. The verdict then gives a warning and also names the true cause. If NEES is
large although nothing was added, any calibration with this violation has this NEES.

| method | violation | devices | something was added, % | named beside, % | NEES |
|---|---|--:|--:|--:|--:|
{others}
"""


def page(tallies: Tallies, run: dict[str, str]) -> str:
    """Return the page of tallies."""
    base: dict[str, Tally] = {}
    lines: dict[str, list[str]] = {"base": [], "estimable": [], "others": []}
    for row, one in tallies.items():
        begin = f"| {row.case} | {row.violation} | "
        share = [100 * n / max(one.devices, 1) for n in (one.truth, one.told, one.other)]
        if not row.violation:
            base[row.case] = base.get(row.case, Tally()) + one
        elif row.is_estimable:
            cells = " | ".join(f"{n:.1f}" for n in share)
            lines["estimable"].append(
                f"{begin}{row.apart:.0f}° | {row.eta:.0f} | {one.devices} | {cells} | "
                f"{one.mean_nees:.2f} | {one.mean_exact_nees:.2f} |"
            )
        else:
            some = 100 * (one.truth + one.other) / max(one.devices, 1)
            lines["others"].append(
                f"{begin}{one.devices} | {some:.0f} | {share[1]:.0f} | {one.mean_nees:.1f} |"
            )
    lines["base"] = [
        f"| {name} | {one.devices} | {one.other} | {chance_limit(one.devices)} | "
        f"{one.mean_nees:.3f} |"
        for name, one in base.items()
    ]
    tables = {name: "\n".join(text) for name, text in lines.items()}
    return _PAGE.format(seeds=", ".join(map(str, BASE_SEEDS)), **run, **tables)


def read_tallies() -> tuple[Tallies, dict[str, str]]:
    """Return what is stored, and the commit and machine that it is of."""
    content = json.loads(DATA.read_text(encoding="utf-8"))
    rows = [(Row(**one["row"]), Tally(**one["tally"])) for one in content["rows"]]
    return dict(rows), content["run"]


def _write(tallies: Tallies, run: dict[str, str]) -> None:
    rows: list[Any] = [{"row": asdict(c), "tally": asdict(t)} for c, t in tallies.items()]
    lines = ",\n".join("  " + json.dumps(one, ensure_ascii=False) for one in rows)
    head = json.dumps(run, ensure_ascii=False)
    DATA.write_text(f'{{"run": {head},\n "rows": [\n{lines}\n]}}\n', encoding="utf-8")
    PAGE.write_text(page(tallies, run), encoding="utf-8")


def main() -> None:
    """Work out the rows that are not complete."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence.auto", description=__doc__)
    parser.add_argument("--rounds", type=int, default=SLOW_ROUNDS)
    parser.add_argument("--anew", action="store_true", help="forget what is stored")
    chosen = parser.parse_args()
    run = {"commit": current_commit(), "machine": describe_machine()}
    tallies = {} if chosen.anew or not DATA.exists() else read_tallies()[0]
    for found in work_out(chosen.rounds, tallies):
        _write(found, run)


if __name__ == "__main__":
    main()
