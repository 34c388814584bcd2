"""The error allocation: what each item adds to the zero-order term, and the budget of 0.3 µg.

One item errs at a time, the estimator being told of all of them as ever; then all together.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.dividing_head.bench import DividingHead
from inercal.studies.claim import shown
from inercal.studies.dual_orthogonal.experiment import (
    ARCSEC,
    AUTOCOLLIMATOR,
    BASE,
    HEAD,
    JUDGED,
    LEAN,
    MICRO,
    NOISE,
    SIZES,
    bench,
    errors,
    simulate,
)
from inercal.studies.dual_orthogonal.methods import FACES, METHODS, tried
from inercal.studies.rms import Rms, rms
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.dual_orthogonal", "allocation")

Found = Mapping[str, Mapping[str, Mapping[str, Array]]]
"""Errors by way, item and column."""
BUDGET = WORDS.claims["in_all"].expected  # µg
PIER = 0.1  # ″, of the base at each position
TOGETHER = "together"
_WAYS = ("patent", FACES)
_LEAST, _NONE = 0.01, 0.001  # µg; less is left out of the chart, and 0 in the table

EXTRA = "tilt of base"  # not among the items of the source
_OPTICS = "autocollimator"


@dataclass(frozen=True)
class Item:
    """One line of the allocation.

    Parameters
    ----------
    size : str
    error : mapping of str to float
        What it sets of the bench, all else being perfect.
    drawn : bool
        Whether the coefficients are drawn, and not 0.
    """

    size: str
    error: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict[str, float])
    drawn: bool = False


def _items() -> dict[str, Item]:
    full = bench()
    head = {"harmonics": full.harmonics, "division": full.division}
    return {
        "readings": Item(f"{NOISE / MICRO:g} µg"),
        _OPTICS: Item(f"{AUTOCOLLIMATOR:g}″", {"autocollimator": full.autocollimator}),
        "head": Item(f"{HEAD:g}″", head),
        "zero of the head": Item(f"{BASE:g}″", {"base": full.base}),
        "lean of the spindle": Item(f"{LEAN:g}″", {"lean": full.lean}),
        "coefficients": Item("as drawn", drawn=True),
        EXTRA: Item(f"{PIER:g}″", {"pier": PIER * ARCSEC}),
    }


ITEMS = _items()


def _perfect(full: DividingHead) -> DividingHead:
    """Return the bench without an error."""
    return replace(full, harmonics=tuple(0.0 for _ in full.harmonics), division=0.0,
                   autocollimator=0.0, base=0.0, pier=0.0, lean=0.0)  # fmt: skip


def contributions(way: str, trials: int, seed: int) -> dict[str, dict[str, Array]]:
    """Return the errors, µg, by item and column, and of all but the base's tilt together.

    An item is drawn with the readings' noise, and what that does by itself taken off again.
    """
    method = METHODS[way]
    full = bench(collimated=method.collimated)
    nominal = dict.fromkeys(SIZES, 0.0)

    def off(drawn: DividingHead, sizes: dict[str, float]) -> dict[str, Array]:
        case = simulate(drawn, trials, seed, told=full, sizes=sizes)
        return errors(method(case), case)

    noise = off(_perfect(full), nominal)
    found = {"readings": noise}
    for name, item in ITEMS.items():
        if name != "readings":
            own = off(replace(_perfect(full), **item.error), SIZES if item.drawn else nominal)
            found[name] = {column: own[column] - noise[column] for column in own}
    return found | {TOGETHER: off(full, SIZES)}


def allowed(k0: Mapping[str, float]) -> float:
    """Return the autocollimator's deviation that keeps K0 within the budget beside noise, ″."""
    return AUTOCOLLIMATOR * np.sqrt(BUDGET**2 - k0["readings"] ** 2) / k0[_OPTICS]


def section(trials: int, seed: int) -> Section:
    """Return the section of the error allocation."""
    found = {way: contributions(way, trials, seed) for way in _WAYS}
    patent, faces = found.values()
    k0 = {name: rms(by_column["K0"]).value for name, by_column in patent.items()}
    whole = rms(patent[TOGETHER]["K0"])
    moving = {way: rms(tried(way, trials, seed, pier=PIER)["K0"]) for way in _WAYS}
    leaning = max(rms(patent["lean of the spindle"][column]) for column in JUDGED)
    findings = (
        WORDS.judge("in_all", whole.value, whole.u,
            f"two readings of {AUTOCOLLIMATOR:g}″ in each pair alone make {shown(k0[_OPTICS])} "
            f"µg; {shown(allowed(k0))}″ would do, or a face at every position, with "
            f"{shown(rms(faces[TOGETHER]['K0']).value)} µg"),
        WORDS.judge("tilting", moving["patent"].value, moving["patent"].u,
            "the autocollimator stands on the base and does not see it tilt; with a face at "
            f"every position it is {shown(moving[FACES].value)} µg"),
        WORDS.judge("leaning", leaning.value, leaning.u,
            f"what a lean of {LEAN:g}″ adds to the coefficient that it moves most, k1 + K3"),
    )  # fmt: skip
    return WORDS.section(findings, (_table(found, moving),), (_chart(found),), pier=PIER)


def _table(found: Found, moving: Mapping[str, Rms]) -> Table:
    asked = [("patent", column) for column in JUDGED] + [(FACES, "K0")]

    def of(name: str) -> Array:
        return np.array([rms(found[way][name][column]).value for way, column in asked])

    def row(name: str, size: str, values: Array) -> tuple[str, list[str]]:
        return name, [
            size,
            *("" if np.isnan(x) else shown(x) if x > _NONE else "0" for x in values),
        ]

    counted = {name: of(name) for name in ITEMS if name != EXTRA}
    tilting = [moving[way].value if column == "K0" else np.nan for way, column in asked]
    rows = [
        *(row(name, ITEMS[name].size, values) for name, values in counted.items()),
        row("root of the sum of squares", "", np.linalg.norm(list(counted.values()), axis=0)),
        row(TOGETHER, "", of(TOGETHER)),
        row(EXTRA, ITEMS[EXTRA].size, of(EXTRA)),
        row("together with the tilt", "", np.array(tilting)),
    ]
    heads = ("size, 1σ", *(f"patent,\n{column}" for column in JUDGED), "every face,\nK0")
    return Table("What each item adds, RMS, µg (δ µrad)", "item", heads, rows)


def _chart(found: Found) -> Chart:
    names = [name for name, by in found["patent"].items() if rms(by["K0"]).value > _LEAST]
    lines = [
        Line(way, np.arange(float(len(names))), np.array([rms(by[n]["K0"]).value for n in names]),
             joined=False)
        for way, by in found.items()
    ]  # fmt: skip
    lines.append(Line("budget", np.array([0.0, len(names) - 1.0]), np.full(2, BUDGET)))
    return Chart(
        "allocation",
        "What each item adds to K0, beside the budget of 0.3 µg; the tilt of the base is not in "
        "“together”. Items below 0.01 µg are left out.",
        [Panel("", "", "RMS of K0, µg", lines, log_y=False, names=names)],
    )
