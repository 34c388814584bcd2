"""What a calibration is worth on the model: the error of acceleration it leaves in waves."""

from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.sensors import G0
from inercal.studies.claim import shown
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.ship_model.estimators import NONE, Compared
from inercal.studies.ship_model.experiment import MILLI, errors, median, part
from inercal.studies.ship_model.ship_motion import IRREGULAR, PLACE, REGULAR, SpecificForce, feel
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "motion")

WAVES = {"regular": REGULAR, "irregular": IRREGULAR}
SHOWN = (NONE, "planar", "damped", "joint")
_RATE, _SECONDS = 10.0, 400.0
_ACROSS = 100  # devices at a time
_SEEN = 10.0  # s in the chart


class Left(NamedTuple):
    """Errors by axis over a run, of (trials, 3), g."""

    rms: Array
    peak: Array
    zeroed: Array  # rms, what is left at rest taken off


def left(found: Compared, name: str, f: Array) -> Left:
    """Return what a calibration leaves where f (n, 3) g is felt, the readings without noise."""
    rms, peak, zeroed = np.zeros((3, len(found.case.readings), 3))
    model, device = found.models[name], found.case.device
    # At rest at last: one more row.
    f = np.concatenate([f, [[0.0, 0.0, 1.0]]])
    for k in range(0, len(rms), _ACROSS):
        some = slice(k, k + _ACROSS)
        e = errors(part(model, some), part(device, some), f)
        e, rest = e[:, :-1], e[:, -1:]
        rms[some], peak[some] = np.sqrt((e**2).mean(-2)), np.abs(e).max(-2)
        zeroed[some] = np.sqrt(((e - rest) ** 2).mean(-2))
    return Left(rms, peak, zeroed)


def section(found: Compared) -> Section:
    """Return the section of the ship motion check."""
    t = np.arange(0, _SECONDS, 1 / _RATE)
    runs = {name: feel(waves, t, found.seed) for name, waves in WAVES.items()}
    by_run = {
        name: {way: left(found, way, run.f / G0) for way in SHOWN} for name, run in runs.items()
    }
    rough = by_run["irregular"]
    heave = _heave(runs["irregular"])[0]
    worst = {way: median(rough[way].rms.max(-1)) for way in SHOWN}
    zeroed = {way: median(rough[way].zeroed.max(-1)) for way in SHOWN}
    mg = {way: shown(one.value / MILLI) for way, one in worst.items()}
    parts = {way: shown(100 * one.value / heave) for way, one in worst.items()}
    rests = {way: shown(100 * one.value / heave) for way, one in zeroed.items()}
    value, u = 100 * worst["damped"].value, 100 * worst["damped"].u
    findings = (
        WORDS.judge("of_force", value, u,
            f"{mg['damped']} mg; planar leaves {mg['planar']} mg, joint {mg['joint']} mg, no "
            f"calibration {mg[NONE]} mg"),
        WORDS.judge("of_heave", value / heave, u / heave,
            f"heave is {shown(heave / MILLI)} mg rms; planar leaves {parts['planar']} %, joint "
            f"{parts['joint']} %; zeroed at rest they leave {rests['damped']} %, "
            f"{rests['planar']} % and {rests['joint']} %, and no calibration {rests[NONE]} %"),
    )  # fmt: skip
    return WORDS.section(
        findings,
        tuple(_table(name, runs[name], by_run[name]) for name in WAVES),
        (_chart(found, t, runs["irregular"]),),
        place=PLACE,
    )


def _heave(run: SpecificForce) -> tuple[float, float]:
    """Return rms and peak of the heave acceleration, g."""
    a = run.heave[2] / G0
    return float(np.sqrt((a**2).mean())), float(np.abs(a).max())


def _table(name: str, run: SpecificForce, by_way: dict[str, Left]) -> Table:
    rms, peak = _heave(run)
    rows: list[tuple[str, list[str]]] = []
    for way, one in by_way.items():
        for what, e, size in (
            ("rms", one.rms, rms),
            ("peak", one.peak, peak),
            ("rms if zeroed at rest", one.zeroed, rms),
        ):
            middle = np.median(e, axis=0)
            rows.append((f"{way}, {what}", [shown(x / MILLI) for x in middle]
                         + [f"{shown(100 * x / size)} %" for x in middle]))  # fmt: skip
    return Table(
        f"{name.capitalize()} waves: error left, median over devices, mg and over the heave "
        f"acceleration ({shown(rms / MILLI)} mg rms, {shown(peak / MILLI)} mg peak)",
        "calibration", ("x", "y", "z", "x, rel.", "y, rel.", "z, rel."), rows,
    )  # fmt: skip


def _chart(found: Compared, t: Array, run: SpecificForce) -> Chart:
    seen = t < _SEEN
    f = run.f[seen] / G0
    off = {
        way: errors(part(m, 0), part(found.case.device, 0), f)
        for way, m in found.models.items()
        if way in SHOWN and way != NONE
    }
    panels = [
        Panel("", "s", f"error along {axis}, mg",
              [Line(way, t[seen], e[:, k] / MILLI) for way, e in off.items()], log_y=False)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    largest = ", ".join(
        f"±{shown(x / MILLI)}" for x in np.abs(f - [0.0, 0.0, 1.0]).max(axis=0).tolist()
    )
    return Chart(
        "motion-error",
        "The first seconds of the irregular waves, one device: the error that each calibration "
        f"leaves, where the axes feel {largest} mg beside 1 g along z.",
        panels,
    )
