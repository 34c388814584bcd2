"""What a calibration is worth on the model: the error of acceleration it leaves in waves."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.sensors import G0
from inercal.studies.claim import format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.ship_model.estimators import UNCALIBRATED, EstimatorComparison
from inercal.studies.ship_model.ship_motion import (
    IRREGULAR_WAVES,
    REGULAR_WAVES,
    SENSOR_POSITION,
    ShipMotion,
    simulate_ship_motion,
)
from inercal.studies.ship_model.simulated_rate_table import (
    MILLI,
    calibration_errors,
    median_estimate,
    select_trials,
)
from inercal.studies.stages import Call
from inercal.studies.study_content import Chart, Curve, StudyPanel, StudySection, StudyTable

TEXT = read_section_text("inercal.studies.ship_model", "motion")

WAVES = {"regular": REGULAR_WAVES, "irregular": IRREGULAR_WAVES}
SHOWN_ESTIMATORS = (UNCALIBRATED, "planar", "damped", "joint")
_RATE, _SECONDS = 10.0, 400.0
_TIME = np.arange(0, _SECONDS, 1 / _RATE)
_BATCH = 100  # devices at a time
_CHART_SECONDS = 10.0  # s in the chart


class ResidualError(NamedTuple):
    """Errors by axis over a run, of (trials, 3), g."""

    rms: Array
    peak: Array
    rest_corrected: Array  # rms, what is left at rest taken off


def residual_error(found: EstimatorComparison, name: str, f: Array) -> ResidualError:
    """Return what a calibration leaves where f (n, 3) g is sensed, the readings without noise."""
    rms, peak, rest_corrected = np.zeros((3, len(found.case.readings), 3))
    model, device = found.models[name], found.case.device
    # At rest at last: one more row.
    f = np.concatenate([f, [[0.0, 0.0, 1.0]]])
    for k in range(0, len(rms), _BATCH):
        some = slice(k, k + _BATCH)
        e = calibration_errors(select_trials(model, some), select_trials(device, some), f)
        e, rest = e[:, :-1], e[:, -1:]
        rms[some], peak[some] = np.sqrt((e**2).mean(-2)), np.abs(e).max(-2)
        rest_corrected[some] = np.sqrt(((e - rest) ** 2).mean(-2))
    return ResidualError(rms, peak, rest_corrected)


def wave_calls(found: EstimatorComparison) -> list[Call]:
    """Return the calls that `section` needs: one a run and estimator."""
    runs = _wave_runs(found.seed)
    return [
        partial(residual_error, found.with_only(way), way, run.f / G0)
        for run in runs.values()
        for way in SHOWN_ESTIMATORS
    ]


def _wave_runs(seed: int) -> dict[str, ShipMotion]:
    return {name: simulate_ship_motion(waves, _TIME, seed) for name, waves in WAVES.items()}


def section(found: EstimatorComparison, results: Sequence[ResidualError]) -> StudySection:
    """Return the section of the ship motion check, from the results of the calls."""
    runs = _wave_runs(found.seed)
    rest = iter(results)
    by_run = {name: {way: next(rest) for way in SHOWN_ESTIMATORS} for name in runs}
    rough = by_run["irregular"]
    heave = _heave_acceleration(runs["irregular"])[0]
    worst = {way: median_estimate(rough[way].rms.max(-1)) for way in SHOWN_ESTIMATORS}
    rest_corrected = {
        way: median_estimate(rough[way].rest_corrected.max(-1)) for way in SHOWN_ESTIMATORS
    }
    mg = {way: format_significant(one.value / MILLI) for way, one in worst.items()}
    parts = {way: format_significant(100 * one.value / heave) for way, one in worst.items()}
    rests = {
        way: format_significant(100 * one.value / heave) for way, one in rest_corrected.items()
    }
    value, u = 100 * worst["damped"].value, 100 * worst["damped"].u
    findings = (
        TEXT.judge("of_force", value, u,
            f"{mg['damped']} mg; planar leaves {mg['planar']} mg, joint {mg['joint']} mg, no "
            f"calibration {mg[UNCALIBRATED]} mg"),
        TEXT.judge("of_heave", value / heave, u / heave,
            f"heave is {format_significant(heave / MILLI)} mg rms; planar leaves {parts['planar']} "
            f"%, joint {parts['joint']} %; zeroed at rest they leave {rests['damped']} %, "
            f"{rests['planar']} % and {rests['joint']} %, and no calibration {rests[UNCALIBRATED]} "
            "%"),
    )  # fmt: skip
    return TEXT.section(
        findings,
        tuple(_table(name, runs[name], by_run[name]) for name in WAVES),
        (_chart(found, _TIME, runs["irregular"]),),
        place=SENSOR_POSITION,
    )


def _heave_acceleration(run: ShipMotion) -> tuple[float, float]:
    """Return rms and peak of the heave acceleration, g."""
    a = run.heave[2] / G0
    return float(np.sqrt((a**2).mean())), float(np.abs(a).max())


def _table(name: str, run: ShipMotion, by_way: dict[str, ResidualError]) -> StudyTable:
    rms, peak = _heave_acceleration(run)
    rows: list[tuple[str, list[str]]] = []
    for way, one in by_way.items():
        for what, e, size in (
            ("rms", one.rms, rms),
            ("peak", one.peak, peak),
            ("rms if zeroed at rest", one.rest_corrected, rms),
        ):
            middle = np.median(e, axis=0)
            rows.append((f"{way}, {what}", [format_significant(x / MILLI) for x in middle]
                         + [f"{format_significant(100 * x / size)} %"
                            for x in middle]))  # fmt: skip
    return StudyTable(
        f"{name.capitalize()} waves: error left, median over devices, mg and over the heave "
        f"acceleration ({format_significant(rms / MILLI)} mg rms, "
        f"{format_significant(peak / MILLI)} mg peak)",
        "calibration", ("x", "y", "z", "x, rel.", "y, rel.", "z, rel."), rows,
    )  # fmt: skip


def _chart(found: EstimatorComparison, t: Array, run: ShipMotion) -> Chart:
    seen = t < _CHART_SECONDS
    f = run.f[seen] / G0
    off = {
        way: calibration_errors(select_trials(m, 0), select_trials(found.case.device, 0), f)
        for way, m in found.models.items()
        if way in SHOWN_ESTIMATORS and way != UNCALIBRATED
    }
    panels = [
        StudyPanel("", "s", f"error along {axis}, mg",
              [Curve(way, t[seen], e[:, k] / MILLI) for way, e in off.items()], log_y=False)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    largest = ", ".join(
        f"±{format_significant(x / MILLI)}"
        for x in np.abs(f - [0.0, 0.0, 1.0]).max(axis=0).tolist()
    )
    return Chart(
        "motion-error",
        "The first seconds of the irregular waves, one device: the error that each calibration "
        f"leaves, where the axes feel {largest} mg beside 1 g along z.",
        panels,
    )
