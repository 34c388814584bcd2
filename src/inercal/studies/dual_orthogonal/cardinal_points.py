"""Compute the effects of mounting angle, K2 and a tilting base at the four cardinal points."""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.bench import DividingHead, position_plan, sensed_motion
from inercal.methods.dual_orthogonal.patent_estimator import four_points
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0
from inercal.studies import study
from inercal.studies.claim import rms, shown
from inercal.studies.dual_orthogonal import simulated_head as simulated

TEXT = study.read_section_text("inercal.studies.dual_orthogonal", "four-points")

ANGLES = np.array([0.0, 50.0, 100.0, 200.0, 300.0, 400.0, 600.0])  # ″
JUDGED_ANGLE = 300.0  # ″
BASE_DRIFT = 0.1  # ″, tilt of the base between the members of a pair


def gain_errors(mounting: float, trials: int, seed: int) -> tuple[Array, Array]:
    """Return the errors of k1 + K3 without and with the correction, (trials, 2) µg.

    Noise and head errors are excluded; `mounting` is the standard deviation of both mounting
    angles, rad.
    """
    quiet = replace(simulated.nominal_bench(0.0), autocollimator=0.0)
    sizes = simulated.SIZES | {"delta_o": mounting}
    case = simulated.simulate(quiet, trials, seed, position_plan(4), sizes=sizes, noise=0.0)
    true = case.truth["k1"] + case.truth["k3"]
    found = (four_points(case.observations.mean / G0, corrected=c).gain for c in (False, True))
    missing, corrected = ((gain - true) / simulated.MICRO for gain in found)
    return missing, corrected


def mounting_angle_error(angle: float) -> float:
    """Return the uncorrected error of k1 + K3 if A and B have equal mounting angles, µg."""
    y = _exact_readings({"a.delta_o": angle, "b.delta_o": angle}, np.zeros(4))
    return float(four_points(y, corrected=False).gain[0]) / simulated.MICRO


def base_tilt_errors() -> dict[str, Array]:
    """Return the errors of K0 and K2 for A and B by the time when the base tilts, µg."""
    return {
        words: np.stack([found.k0, found.k2], axis=-1).ravel() / simulated.MICRO
        for words, tilt in {
            "before 180°": (0.0, 0.0, 1.0, 1.0),
            "before 270°": (0.0, 0.0, 0.0, 1.0),
        }.items()
        for found in [
            four_points(_exact_readings({}, BASE_DRIFT * simulated.ARCSEC * np.array(tilt)))
        ]
    }


def second_order_slope(trials: int, seed: int) -> tuple[float, float]:
    """Return the slope of A's (n + m)/2 − K0 against K2 over trials, and its standard error."""
    case = simulated.simulate(simulated.nominal_bench(), trials, seed, position_plan(4))
    found = four_points(case.observations.mean / G0)
    off, k2 = (found.k0 + found.k2 - case.truth["k0"])[:, 0], case.truth["k2"][:, 0]
    slope = float(k2 @ off / (k2 @ k2))
    return slope, float((off - slope * k2).std() / np.sqrt(k2 @ k2))


def _exact_readings(coefficients: dict[str, float], pier: Array) -> Array:
    """Return exact readings at the four points, (4, 2) g."""
    steps = position_plan(4)
    exact = DividingHead(simulated.nominal_bench().gravity, collimated="every")
    q = {f"pier[{step.label}]": tilt for step, tilt in zip(steps, pier, strict=True)}
    c = np.array([coefficients.get(name, 0.0) for name in simulated.SENSOR.coefficients])
    return simulated.SENSOR.forward(Motion(sensed_motion(exact, steps, q).f), c) / G0


def section(trials: int, seed: int) -> study.StudySection:
    """Build the section about the four points."""
    missing, corrected = (
        rms(e) for e in gain_errors(JUDGED_ANGLE * simulated.ARCSEC, trials, seed)
    )
    by_up, u = second_order_slope(trials, seed)
    findings = (
        TEXT.judge("first", missing.value, missing.u,
            "the remaining error is ½δ², from the cosine of the mounting angle: "
            f"{shown(-mounting_angle_error(JUDGED_ANGLE * simulated.ARCSEC), 3)} µg "
            f"if the angle is {JUDGED_ANGLE:g}″, and √3 times that if this is its scatter; with "
            f"the correction it is {shown(corrected.value)} µg"),
        TEXT.judge("carried", by_up, u,
            "the mean of readings up and down is K0 + K2; the mean of two level readings is K0"),
    )  # fmt: skip
    angles = ANGLES * simulated.ARCSEC
    left = np.array([mounting_angle_error(angle) for angle in angles.tolist()])
    scatter = np.array(
        [[rms(e).value for e in gain_errors(a, trials, seed)] for a in angles.tolist()]
    )
    tilts = [(words, [shown(x) if abs(x) > 1e-3 else "0" for x in off])
             for words, off in base_tilt_errors().items()]  # fmt: skip
    return TEXT.section(
        *findings,
        study.StudyTable("Error of k1 + K3, µg, by mounting angle; 1σ without noise and head "
              "errors", "mounting angle", ("this angle,\nno correction", "1σ,\nno correction",
                                 "1σ,\ncorrected"),
              [(f"{a:g}″", [shown(left[k], 3),
                            *(shown(x) for x in scatter[k])])
               for k, a in enumerate(ANGLES)]),
        study.StudyTable(f"Errors, µg, from a lasting base tilt of {BASE_DRIFT:g}″", "tilts",
              ("K0 of A", "K2 of A", "K0 of B", "K2 of B"), tilts),
        study.Chart("mounting", "RMS of k1 + K3 against the standard deviation of the mounting "
            "angles, without noise.",
              [study.StudyPanel("", "mounting angle, ″", "RMS, µg",
                     [study.Curve("no correction", ANGLES[1:], scatter[1:, 0]),
                      study.Curve("corrected", ANGLES[1:], scatter[1:, 1])])]),
    )  # fmt: skip
