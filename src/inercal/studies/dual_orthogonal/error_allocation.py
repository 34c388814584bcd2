"""The error allocation shows what each item contributes to K0, and whether 0.3 µg is reached.

First, a single item has its error, although the estimator assumes that all of them do. Then all
items have their errors together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.bench import DividingHead
from inercal.studies import study
from inercal.studies.claim import Rms, rms, shown
from inercal.studies.dual_orthogonal.simulated_head import (
    ARCSEC,
    AUTOCOLLIMATOR,
    EVERY_FACE,
    HEAD_ERROR,
    HEAD_ZERO,
    JUDGED_COLUMNS,
    METHODS,
    MICRO,
    NOISE,
    SIZES,
    SPINDLE_LEAN,
    estimate_errors,
    method_errors,
    nominal_bench,
    simulate,
)

TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "allocation")

ErrorsByItem = Mapping[str, Mapping[str, Mapping[str, Array]]]
"""Errors by method variant, item and column."""
K0_BUDGET = TEXT.claims["in_all"].expected  # µg
BASE_TILT = 0.1  # ″, tilt of the base at each position
ALL_ITEMS = "together"
_ALLOCATED_METHODS = ("patent", EVERY_FACE)
# µg; smaller values are not in the chart, and are 0 in the table
_CHART_MINIMUM, _TABLE_MINIMUM = 0.01, 0.001

BASE_TILT_ITEM = "tilt of base"  # not an item of the source
_AUTOCOLLIMATOR_ITEM = "autocollimator"


@dataclass(frozen=True)
class AllocationItem:
    """One item in the error allocation.

    Parameters
    ----------
    size : str
    error : mapping of str to float
        Fields of the bench that have an error; all others are perfect.
    random_coefficients : bool
        Whether the coefficients are drawn at random instead of being 0.
    """

    size: str
    error: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict[str, float])
    random_coefficients: bool = False


_FULL_BENCH = nominal_bench()
ITEMS = {
    "readings": AllocationItem(f"{NOISE / MICRO:g} µg"),
    _AUTOCOLLIMATOR_ITEM: AllocationItem(
        f"{AUTOCOLLIMATOR:g}″", {"autocollimator": _FULL_BENCH.autocollimator}
    ),
    "head": AllocationItem(
        f"{HEAD_ERROR:g}″", {"harmonics": _FULL_BENCH.harmonics, "division": _FULL_BENCH.division}
    ),
    "zero of the head": AllocationItem(f"{HEAD_ZERO:g}″", {"base": _FULL_BENCH.base}),
    "lean of the spindle": AllocationItem(f"{SPINDLE_LEAN:g}″", {"lean": _FULL_BENCH.lean}),
    "coefficients": AllocationItem("as drawn", random_coefficients=True),
    BASE_TILT_ITEM: AllocationItem(f"{BASE_TILT:g}″", {"pier": BASE_TILT * ARCSEC}),
}


def _error_free_bench(full: DividingHead) -> DividingHead:
    """Return the bench without any error."""
    return replace(full, harmonics=tuple(0.0 for _ in full.harmonics), division=0.0,
                   autocollimator=0.0, base=0.0, pier=0.0, lean=0.0)  # fmt: skip


def item_errors(way: str, trials: int, seed: int) -> dict[str, dict[str, Array]]:
    """Return the errors by item and column, and for all items except the base's tilt, µg.

    Each item is simulated with the noise of the readings, whose own effect is then subtracted.
    """
    method = METHODS[way]
    full = nominal_bench(collimated=method.collimated)
    nominal = dict.fromkeys(SIZES, 0.0)

    def off(drawn: DividingHead, sizes: dict[str, float]) -> dict[str, Array]:
        case = simulate(drawn, trials, seed, stated=full, sizes=sizes)
        return estimate_errors(method(case), case)

    noise = off(_error_free_bench(full), nominal)
    found = {"readings": noise}
    for name, item in ITEMS.items():
        if name != "readings":
            own = off(
                replace(_error_free_bench(full), **item.error),
                SIZES if item.random_coefficients else nominal,
            )
            found[name] = {column: own[column] - noise[column] for column in own}
    return found | {ALL_ITEMS: off(full, SIZES)}


def allowed_autocollimator_deviation(k0: Mapping[str, float]) -> float:
    """Return the largest autocollimator deviation with which K0 stays within the budget, ″."""
    return AUTOCOLLIMATOR * np.sqrt(K0_BUDGET**2 - k0["readings"] ** 2) / k0[_AUTOCOLLIMATOR_ITEM]


def allocation_calls(trials: int, seed: int) -> list[study.Call]:
    """Return the calls that `section` needs: items and tilting base for each variant."""
    return [
        *(partial(item_errors, way, trials, seed) for way in _ALLOCATED_METHODS),
        *(partial(method_errors, way, trials, seed, pier=BASE_TILT) for way in _ALLOCATED_METHODS),
    ]


def section(results: Sequence[Any]) -> study.StudySection:
    """Build the section about the error allocation from the results of the calls."""
    count = len(_ALLOCATED_METHODS)
    found: ErrorsByItem = dict(zip(_ALLOCATED_METHODS, results[:count], strict=True))
    patent, faces = found.values()
    k0 = {name: rms(by_column["K0"]).value for name, by_column in patent.items()}
    whole = rms(patent[ALL_ITEMS]["K0"])
    moving = {
        way: rms(errors["K0"])
        for way, errors in zip(_ALLOCATED_METHODS, results[count:], strict=True)
    }
    leaning = max(rms(patent["lean of the spindle"][column]) for column in JUDGED_COLUMNS)
    findings = (
        TEXT.judge("in_all", whole.value, whole.u,
            f"two readings of {AUTOCOLLIMATOR:g}″ in each pair already contribute "
            f"{shown(k0[_AUTOCOLLIMATOR_ITEM])} µg; {shown(allowed_autocollimator_deviation(k0))}″ "
            "would be sufficient, or a face at every position, which gives "
            f"{shown(rms(faces[ALL_ITEMS]['K0']).value)} µg"),
        TEXT.judge("tilting", moving["patent"].value, moving["patent"].u,
            "the autocollimator is mounted on the base and does not detect its tilt; with a face "
            f"at every position it is {shown(moving[EVERY_FACE].value)} µg"),
        TEXT.judge("leaning", leaning.value, leaning.u,
            f"effect of a lean of {SPINDLE_LEAN:g}″ on the coefficient that it changes most, k1 + "
            "K3"),
    )  # fmt: skip
    return TEXT.section(*findings, _table(found, moving), _chart(found), pier=BASE_TILT)


def _table(found: ErrorsByItem, moving: Mapping[str, Rms]) -> study.StudyTable:
    requested = [("patent", column) for column in JUDGED_COLUMNS] + [(EVERY_FACE, "K0")]

    def of(name: str) -> Array:
        return np.array([rms(found[way][name][column]).value for way, column in requested])

    def row(name: str, size: str, values: Array) -> tuple[str, list[str]]:
        return name, [
            size,
            *("" if np.isnan(x) else shown(x) if x > _TABLE_MINIMUM else "0" for x in values),
        ]

    counted = {name: of(name) for name in ITEMS if name != BASE_TILT_ITEM}
    tilting = [moving[way].value if column == "K0" else np.nan for way, column in requested]
    rows = [
        *(row(name, ITEMS[name].size, values) for name, values in counted.items()),
        row("root of the sum of squares", "", np.linalg.norm(list(counted.values()), axis=0)),
        row(ALL_ITEMS, "", of(ALL_ITEMS)),
        row(BASE_TILT_ITEM, ITEMS[BASE_TILT_ITEM].size, of(BASE_TILT_ITEM)),
        row("together with the tilt", "", np.array(tilting)),
    ]
    heads = ("size, 1σ", *(f"patent,\n{column}" for column in JUDGED_COLUMNS), "every face,\nK0")
    return study.StudyTable("Contribution of each item, RMS, µg (δ in µrad)", "item", heads, rows)


def _chart(found: ErrorsByItem) -> study.Chart:
    names = [name for name, by in found["patent"].items() if rms(by["K0"]).value > _CHART_MINIMUM]
    lines = [
        study.Curve(
            way,
            np.arange(float(len(names))),
            np.array([rms(by[n]["K0"]).value for n in names]),
            connected=False,
        )
        for way, by in found.items()
    ]
    lines.append(study.Curve("budget", np.array([0.0, len(names) - 1.0]), np.full(2, K0_BUDGET)))
    return study.Chart(
        "allocation",
        "Contribution of each item to K0, with the budget of 0.3 µg; “together” does not include "
        "the tilt of the base. Items below 0.01 µg are omitted.",
        [study.StudyPanel("", "", "RMS of K0, µg", lines, log_y=False, names=names)],
    )
