"""Check a calibration on the ship model by its acceleration error in waves.

The axes of the model are x forward, y to port and z up. The model heaves by z, pitches by θ (bow
down) and rolls by φ (to starboard)::

    R = R_y(θ) R_x(φ),   ω = (φ', θ' cos φ, −θ' sin φ)
    f = Rᵀ (0, 0, z'' + g) + ω' × ℓ + ω × (ω × ℓ)

ℓ is the vector from the centre of the motion to the accelerometer. In regular waves each motion is
a sine with the wave period. In irregular waves each motion has the Bretschneider spectrum,

    S(ω) ∝ ω⁻⁵ exp(−1.25 (ω_p/ω)⁴),   0.6 ω_p < ω < 1.8 ω_p

where the amplitude is the significant amplitude, twice the root of the variance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import pi, radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import G0
from inercal.studies import study
from inercal.studies.claim import shown
from inercal.studies.ship_model.estimators import UNCALIBRATED, EstimatorComparison
from inercal.studies.ship_model.simulated_rate_table import (
    MILLI,
    calibration_errors,
    median_estimate,
    select_trials,
)

_COMPONENTS = 60
# In units of ω_p; a model does not follow waves much shorter than itself.
_FREQUENCY_BAND = (0.6, 1.8)


@dataclass(frozen=True)
class OscillationParameters:
    """Parameters of one motion: amplitude, m or rad; period, s; phase in regular waves, rad."""

    amplitude: float
    period: float
    phase: float = 0.0


@dataclass(frozen=True)
class WaveConditions:
    """Motion of a model, and position of its accelerometer, m."""

    heave: OscillationParameters
    pitch: OscillationParameters
    roll: OscillationParameters
    place: tuple[float, float, float]
    regular: bool


SENSOR_POSITION = (1.2, 0.1, 0.15)  # m
REGULAR_WAVES = WaveConditions(
    OscillationParameters(0.04, 1.6),
    OscillationParameters(radians(3), 1.6, pi / 2),
    OscillationParameters(radians(8), 1.6, 1.0),
    SENSOR_POSITION,
    True,
)
IRREGULAR_WAVES = WaveConditions(
    OscillationParameters(0.04, 1.6),
    OscillationParameters(radians(3), 1.5),
    OscillationParameters(radians(8), 2.2),
    SENSOR_POSITION,
    False,
)
"""Conditions for a 4 m model in 4 m waves, 0.1 m high, and in a sea of that significant height."""


def motion_derivatives(swing: OscillationParameters, t: Array, seed: int | None = None) -> Array:
    """Return a motion and its first two derivatives at t (n,), as (3, n).

    The motion is irregular if a seed is given.
    """
    peak = 2 * pi / swing.period
    if seed is None:
        w, amplitude, phase = np.array([peak]), np.array([swing.amplitude]), swing.phase
    else:
        rng = np.random.default_rng(seed)
        edges = peak * np.linspace(*_FREQUENCY_BAND, _COMPONENTS + 1)
        # Random within their bands, because evenly spaced frequencies would repeat within minutes.
        w = rng.uniform(edges[:-1], edges[1:])
        power = w**-5 * np.exp(-1.25 * (peak / w) ** 4)
        amplitude = swing.amplitude * np.sqrt(power / power.sum() / 2)
        phase = rng.uniform(0, 2 * pi, len(w))
    angle = w * t[:, None] + phase
    sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
    return np.stack([sine.sum(-1), (w * cosine).sum(-1), -(w**2 * sine).sum(-1)])


@dataclass(frozen=True, eq=False)
class ShipMotion:
    """Heave, pitch and roll with their derivatives, (3, n) each, and specific force, (n, 3)."""

    heave: Array
    pitch: Array
    roll: Array
    f: Array  # m/s²

    @property
    def attitude(self) -> Array:
        """Return the rotation R from model to basin, (n, 3, 3)."""
        return _axis_rotation(1, self.pitch[0]) @ _axis_rotation(0, self.roll[0])


def simulate_ship_motion(waves: WaveConditions, t: Array, seed: int = 0) -> ShipMotion:
    """Return the motion at t (n,), s, and the specific force on the accelerometer."""
    seeds = (None,) * 3 if waves.regular else (3 * seed, 3 * seed + 1, 3 * seed + 2)
    swings = (waves.heave, waves.pitch, waves.roll)
    heave, pitch, roll = (motion_derivatives(s, t, k) for s, k in zip(swings, seeds, strict=True))
    c, s = np.cos(roll[0]), np.sin(roll[0])
    rate = np.stack([roll[1], pitch[1] * c, -pitch[1] * s], axis=-1)
    turning = np.stack(
        [roll[2], pitch[2] * c - pitch[1] * roll[1] * s, -pitch[2] * s - pitch[1] * roll[1] * c],
        axis=-1,
    )
    place = np.array(waves.place)
    result = ShipMotion(heave, pitch, roll, np.zeros((len(t), 3)))
    # Rᵀ (0, 0, z'' + g) is the last row of R.
    held = result.attitude[:, 2] * (heave[2] + G0)[:, None]
    f = held + np.cross(turning, place) + np.cross(rate, np.cross(rate, place))
    return ShipMotion(heave, pitch, roll, f)


def _axis_rotation(axis: int, angle: Array) -> Array:
    return exp_so3(angle[:, None] * np.eye(3)[axis])


TEXT = study.read_section_text("inercal.studies.ship_model", "motion")

WAVES = {"regular": REGULAR_WAVES, "irregular": IRREGULAR_WAVES}
SHOWN_ESTIMATORS = (UNCALIBRATED, "planar", "damped", "joint")
_RATE, _SECONDS = 10.0, 400.0
_TIME = np.arange(0, _SECONDS, 1 / _RATE)
_BATCH = 100  # devices per block
_CHART_SECONDS = 10.0  # s shown in the chart


class ResidualError(NamedTuple):
    """Errors by axis over a run, (trials, 3), g."""

    rms: Array
    peak: Array
    rest_corrected: Array  # rms after subtracting the error at rest


def residual_error(found: EstimatorComparison, name: str, f: Array) -> ResidualError:
    """Return the error that remains after calibration, for f (n, 3), g, without noise."""
    rms, peak, rest_corrected = np.zeros((3, len(found.case.readings), 3))
    model, device = found.models[name], found.case.device
    # One more row at the end, at rest.
    f = np.concatenate([f, [[0.0, 0.0, 1.0]]])
    for k in range(0, len(rms), _BATCH):
        some = slice(k, k + _BATCH)
        e = calibration_errors(select_trials(model, some), select_trials(device, some), f)
        e, rest = e[:, :-1], e[:, -1:]
        rms[some], peak[some] = np.sqrt((e**2).mean(-2)), np.abs(e).max(-2)
        rest_corrected[some] = np.sqrt(((e - rest) ** 2).mean(-2))
    return ResidualError(rms, peak, rest_corrected)


def wave_calls(found: EstimatorComparison) -> list[study.Call]:
    """Return the calls that `section` needs, one per run and estimator."""
    runs = _wave_runs(found.seed)
    return [
        partial(residual_error, found.with_only(way), way, run.f / G0)
        for run in runs.values()
        for way in SHOWN_ESTIMATORS
    ]


def _wave_runs(seed: int) -> dict[str, ShipMotion]:
    return {name: simulate_ship_motion(waves, _TIME, seed) for name, waves in WAVES.items()}


def section(found: EstimatorComparison, results: Sequence[ResidualError]) -> study.StudySection:
    """Build the section about the ship motion check from the results of the calls."""
    runs = _wave_runs(found.seed)
    rest = iter(results)
    by_run = {name: {way: next(rest) for way in SHOWN_ESTIMATORS} for name in runs}
    rough = by_run["irregular"]
    heave = _heave_acceleration(runs["irregular"])[0]
    worst = {way: median_estimate(rough[way].rms.max(-1)) for way in SHOWN_ESTIMATORS}
    rest_corrected = {
        way: median_estimate(rough[way].rest_corrected.max(-1)) for way in SHOWN_ESTIMATORS
    }
    mg = {way: shown(one.value / MILLI) for way, one in worst.items()}
    parts = {way: shown(100 * one.value / heave) for way, one in worst.items()}
    rests = {way: shown(100 * one.value / heave) for way, one in rest_corrected.items()}
    value, u = 100 * worst["damped"].value, 100 * worst["damped"].u
    findings = (
        TEXT.judge("of_force", value, u,
            f"the error is {mg['damped']} mg; it is {mg['planar']} mg with planar, {mg['joint']} "
            f"mg with joint, and {mg[UNCALIBRATED]} mg without calibration"),
        TEXT.judge("of_heave", value / heave, u / heave,
            f"heave is {shown(heave / MILLI)} mg rms; planar leaves {parts['planar']} "
            f"%, joint {parts['joint']} %; after zeroing at rest they leave {rests['damped']} %, "
            f"{rests['planar']} % and {rests['joint']} %, and no calibration {rests[UNCALIBRATED]} "
            "%"),
    )  # fmt: skip
    return TEXT.section(
        *findings,
        *(_table(name, runs[name], by_run[name]) for name in WAVES),
        _chart(found, _TIME, runs["irregular"]),
        place=SENSOR_POSITION,
    )


def _heave_acceleration(run: ShipMotion) -> tuple[float, float]:
    """Return the rms and the peak of the heave acceleration, g."""
    a = run.heave[2] / G0
    return float(np.sqrt((a**2).mean())), float(np.abs(a).max())


def _table(name: str, run: ShipMotion, by_way: dict[str, ResidualError]) -> study.StudyTable:
    rms, peak = _heave_acceleration(run)
    rows: list[tuple[str, list[str]]] = []
    for way, one in by_way.items():
        for what, e, size in (
            ("rms", one.rms, rms),
            ("peak", one.peak, peak),
            ("rms if zeroed at rest", one.rest_corrected, rms),
        ):
            middle = np.median(e, axis=0)
            rows.append((f"{way}, {what}", [shown(x / MILLI) for x in middle]
                         + [f"{shown(100 * x / size)} %"
                            for x in middle]))  # fmt: skip
    return study.StudyTable(
        f"{name.capitalize()} waves: remaining error, median over devices, in mg and relative to "
        f"the heave acceleration ({shown(rms / MILLI)} mg rms, {shown(peak / MILLI)} mg peak)",
        "calibration", ("x", "y", "z", "x, rel.", "y, rel.", "z, rel."), rows,
    )  # fmt: skip


def _chart(found: EstimatorComparison, t: Array, run: ShipMotion) -> study.Chart:
    seen = t < _CHART_SECONDS
    f = run.f[seen] / G0
    off = {
        way: calibration_errors(select_trials(m, 0), select_trials(found.case.device, 0), f)
        for way, m in found.models.items()
        if way in SHOWN_ESTIMATORS and way != UNCALIBRATED
    }
    panels = [
        study.StudyPanel("", "s", f"error along {axis}, mg",
              [study.Curve(way, t[seen], e[:, k] / MILLI) for way, e in off.items()], log_y=False)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    largest = ", ".join(
        f"±{shown(x / MILLI)}" for x in np.abs(f - [0.0, 0.0, 1.0]).max(axis=0).tolist()
    )
    return study.Chart(
        "motion-error",
        "The first seconds in irregular waves, one device: the error that remains with each "
        f"calibration, while the axes sense {largest} mg in addition to 1 g along z.",
        panels,
    )
