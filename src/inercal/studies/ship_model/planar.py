"""The planar calibration: what its deviations show, and what makes it err at tilted poses."""

import numpy as np

from inercal.arrays import Array
from inercal.benches.rate_table.fixture import PLANES, RPM, planar_plan
from inercal.methods.ship_planar import level
from inercal.sensors.affine import Affine
from inercal.studies.claim import shown
from inercal.studies.section import Chart, Line, Panel, Section
from inercal.studies.ship_model.estimators import NONE, Compared
from inercal.studies.ship_model.experiment import (
    EXACT,
    MILLI,
    POSE,
    SPEEDS,
    Case,
    errors,
    length,
    median,
    norm_rms,
    over,
    said,
    simulate,
)
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "planar")

_SHOWN = (NONE, "planar", "joint")


def own(model: Affine, case: Case) -> Array:
    """Return the deviations at the untilted states from what the bench says, (..., 9, 3) g."""
    return model.correct(case.readings[..., case.level, :]) - case.nominal[case.level]


def own_norms(model: Affine, case: Case) -> Array:
    """Return the rms of the norms' deviations at the untilted states, (...) g."""
    made = np.linalg.norm(model.correct(case.readings[..., case.level, :]), axis=-1)
    away = made - np.linalg.norm(case.nominal[case.level], axis=-1)
    return np.sqrt((away**2).mean(-1))


def exactly_mounted(trials: int, seed: int) -> Array:
    """Return planar's norm error at the groups where no mounting errs, (trials,) g."""
    case = simulate(trials, seed, EXACT)
    model = level(case.readings[:, case.level], case.nominal[case.level]).model
    return norm_rms(model, case)


def section(found: Compared) -> Section:
    """Return the section of the planar calibration."""
    case, model = found.case, found.models["planar"]
    inside, outside = median(length(own(model, case))), median(found.vectors("planar"))
    there, here = median(found.norms("planar")), median(own_norms(model, case))
    left = median(exactly_mounted(len(case.readings), found.seed))
    said_mg = {k: shown(x.value / MILLI) for k, x in
               {"in": inside, "out": outside, "there": there, "left": left}.items()}  # fmt: skip
    ratios = over(outside, inside), over(there, here), over(left, there)
    findings = (
        WORDS.judge("itself", *ratios[0],
            f"{said_mg['in']} mg at the states it was fitted to, {said_mg['out']} mg elsewhere: "
            "the least squares fit the errors of the three mountings too"),
        WORDS.judge("grows", *ratios[1],
            f"{said_mg['there']} mg at the groups, {shown(here.value / MILLI)} mg at its own"),
        WORDS.judge("coupling", *ratios[2],
            "M has all nine elements, coupling included; were every mounting exact, "
            f"{said_mg['left']} mg would be left, by noise"),
    )  # fmt: skip
    return WORDS.section(
        findings, (), (_by_speed(found), _by_group(found)), across=shown(POSE / MILLI)
    )


def _root(e: Array) -> Array:
    """Return the rms over devices, mg."""
    return np.sqrt((e**2).mean(0)) / MILLI


def _by_speed(found: Compared) -> Chart:
    """Each axis toward the centre, as in Figs. 3–5."""
    case, used = found.case, np.array([0.0, 46.0, 86.0])
    speeds = np.array(SPEEDS)
    f = said(planar_plan([w * RPM for w in SPEEDS]))
    inside = _root(own(found.models["planar"], case))
    panels: list[Panel] = []
    for k, (plane, (axis, _)) in enumerate(PLANES.items()):
        at, n = "xyz".index(axis), len(SPEEDS)
        lines = [
            Line(
                name,
                speeds,
                _root(errors(found.models[name], case.device, f)[:, k * n :][:, :n, at]),
            )
            for name in _SHOWN
        ]
        lines.append(Line("planar as Figs. 3–5", used, inside[3 * k : 3 * k + 3, at], joined=False))
        panels.append(Panel("", "r/min", f"{axis.upper()} in {plane}, rms, mg", lines))
    return Chart(
        "speeds",
        "Error of the axis toward the centre against speed, untilted and exactly mounted, rms "
        "over devices, and what the source's Figs. 3–5 would show of planar: its deviation from "
        "nominal in the mountings it was fitted to.",
        panels,
    )


def _by_group(found: Compared) -> Chart:
    """Each axis in each group, as in Figs. 7–9."""
    f = found.case.nominal[found.case.groups]
    numbers = np.arange(1.0, len(f) + 1)
    rms = {
        name: _root(errors(found.models[name], found.case.device, f))
        for name in ("planar", "damped", "joint")
    }
    panels = [
        Panel("", "group", f"{axis.upper()}, rms, mg",
              [Line(name, numbers, e[:, k]) for name, e in rms.items()], log_y=False)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    whole = {name: shown(float(length(e))) for name, e in rms.items()}
    return Chart(
        "groups",
        "Error of each axis in the sixteen groups, exactly mounted, as the source's Figs. 7–9; rms "
        "over devices. Groups are numbered as planned: XY, YX and ZY at 30°, 60° and 135°, the "
        "pose of two tilts, then 30° and 135° at 46 r/min. Over all groups damped errs by "
        f"{whole['damped']} mg in the very poses it was fitted to, planar by {whole['planar']}, "
        f"joint by {whole['joint']}.",
        panels,
    )
