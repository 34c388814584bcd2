"""Find the deviations of the planar calibration, and the causes of its errors in tilted poses."""

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.rate_table.fixture import PLANES, RPM, planar_plan
from inercal.methods.ship_planar import fit_level_states
from inercal.physics.sensors.affine import AffineModel
from inercal.studies.claim import shown
from inercal.studies.ship_model import simulated_rate_table as simulated
from inercal.studies.ship_model.estimators import UNCALIBRATED, EstimatorComparison
from inercal.studies.study import Chart, Curve, StudyPanel, StudySection, read_section_text

TEXT = read_section_text("inercal.studies.ship_model", "planar")

_SHOWN_ESTIMATORS = (UNCALIBRATED, "planar", "joint")


def level_deviations(model: AffineModel, case: simulated.ShipModelCase) -> Array:
    """Return the deviations from the nominal force at the untilted states, (..., 9, 3) g."""
    return model.correct(case.readings[..., case.level_rows, :]) - case.nominal[case.level_rows]


def level_norm_deviations(model: AffineModel, case: simulated.ShipModelCase) -> Array:
    """Return the rms norm deviation at the untilted states, (...) g."""
    result = np.linalg.norm(model.correct(case.readings[..., case.level_rows, :]), axis=-1)
    away = result - np.linalg.norm(case.nominal[case.level_rows], axis=-1)
    return np.sqrt((away**2).mean(-1))


def exact_mounting_norm_error(trials: int, seed: int) -> Array:
    """Return the norm error of planar at the groups with exact mountings, (trials,) g."""
    case = simulated.simulate(trials, seed, simulated.EXACT_BENCH)
    model = fit_level_states(case.readings[:, case.level_rows], case.nominal[case.level_rows]).model
    return simulated.norm_rms(model, case)


def section(found: EstimatorComparison) -> StudySection:
    """Build the section about the planar calibration."""
    case, model = found.case, found.models["planar"]
    inside, outside = (
        simulated.median_estimate(simulated.rms_length(level_deviations(model, case))),
        simulated.median_estimate(found.vector_errors("planar")),
    )
    there, here = (
        simulated.median_estimate(found.norms("planar")),
        simulated.median_estimate(level_norm_deviations(model, case)),
    )
    left = simulated.median_estimate(exact_mounting_norm_error(len(case.readings), found.seed))
    said_mg = {k: shown(x.value / simulated.MILLI) for k, x in
               {"in": inside, "out": outside, "there": there, "left": left}.items()}  # fmt: skip
    ratios = (
        simulated.median_ratio(outside, inside),
        simulated.median_ratio(there, here),
        simulated.median_ratio(left, there),
    )
    findings = (
        TEXT.judge("itself", *ratios[0],
            f"the error is {said_mg['in']} mg at the states it was fitted to and {said_mg['out']} "
            f"mg elsewhere, because least squares also fits the errors of the three mountings"),
        TEXT.judge("grows", *ratios[1],
            f"the error is {said_mg['there']} mg at the groups and "
            f"{shown(here.value / simulated.MILLI)} mg at its own states"),
        TEXT.judge("coupling", *ratios[2],
            "M has all nine elements, so it includes coupling; with exact mountings, only "
            f"{said_mg['left']} mg would remain, which come from noise"),
    )  # fmt: skip
    return TEXT.section(
        *findings,
        _speed_chart(found),
        _group_chart(found),
        across=shown(simulated.POSE_SD / simulated.MILLI),
    )


def _device_rms(e: Array) -> Array:
    """Return the rms over devices, mg."""
    return np.sqrt((e**2).mean(0)) / simulated.MILLI


def _speed_chart(found: EstimatorComparison) -> Chart:
    """Draw the errors of each axis when it points to the centre, as in Figs. 3–5."""
    case, used = found.case, np.array([0.0, 46.0, 86.0])
    speeds = np.array(simulated.SPEEDS)
    f = simulated.nominal_force(planar_plan([w * RPM for w in simulated.SPEEDS]))
    inside = _device_rms(level_deviations(found.models["planar"], case))
    panels: list[StudyPanel] = []
    for k, (plane, (axis, _)) in enumerate(PLANES.items()):
        at, n = "xyz".index(axis), len(simulated.SPEEDS)
        lines = [
            Curve(
                name,
                speeds,
                _device_rms(
                    simulated.calibration_errors(found.models[name], case.device, f)[:, k * n :][
                        :, :n, at
                    ]
                ),
            )
            for name in _SHOWN_ESTIMATORS
        ]
        lines.append(
            Curve("planar as Figs. 3–5", used, inside[3 * k : 3 * k + 3, at], connected=False)
        )
        panels.append(StudyPanel("", "r/min", f"{axis.upper()} in {plane}, rms, mg", lines))
    return Chart(
        "speeds",
        "Error of the axis that points to the centre against speed, untilted and exactly mounted, "
        "rms over devices. In addition, the deviation of planar from nominal in the mountings it "
        "was fitted to, which the source's Figs. 3–5 would show.",
        panels,
    )


def _group_chart(found: EstimatorComparison) -> Chart:
    """Draw the errors of each axis in each group, as in Figs. 7–9."""
    f = found.case.nominal[found.case.group_rows]
    numbers = np.arange(1.0, len(f) + 1)
    rms = {
        name: _device_rms(simulated.calibration_errors(found.models[name], found.case.device, f))
        for name in ("planar", "damped", "joint")
    }
    panels = [
        StudyPanel("", "group", f"{axis.upper()}, rms, mg",
              [Curve(name, numbers, e[:, k]) for name, e in rms.items()], log_y=False)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    whole = {name: shown(float(simulated.rms_length(e))) for name, e in rms.items()}
    return Chart(
        "groups",
        "Error of each axis in the sixteen groups, exactly mounted, as in the source's Figs. 7–9; "
        "rms over devices. Groups are numbered as planned: XY, YX and ZY at 30°, 60° and 135°, the "
        "pose of two tilts, then 30° and 135° at 46 r/min. Over all groups the error of damped is "
        f"{whole['damped']} mg in the poses it was fitted to, that of planar {whole['planar']} mg "
        f"and that of joint {whole['joint']} mg.",
        panels,
    )
