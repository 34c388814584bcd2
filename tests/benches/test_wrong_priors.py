"""Every method names a prior that contradicts its data, and a right prior raises no alarm."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence, slow
from tests.benches.generated_runs import simulate_run, write_run

import inercal
from inercal.estimation import Gaussian
from inercal.methods import METHODS
from inercal.pipeline import Outcome
from inercal.runfile import Run, read

CASES = [
    ("six_position", "ml", "ax.k0"),
    slow("ferraris", "ml", "gz.g_o"),
    ("tumble", "least_squares", "a.kip"),
    slow("dual_orthogonal", "joint", "a.k0"),
    slow("centrifuge_norm", "ml", "az.k2"),
    slow("rates_and_poses", "ml", "gz.delta_p"),
    slow("ship_multi_angle", "joint", "az.delta_p"),
    ("temperature_ramp", "gls", "gz.bias_dT"),
    ("multi_position", "joint", "gz.delta_p"),
    slow("multi_position", "sequential", "ax.k0"),
    slow("turntable_discrete", "least_squares", "gz.delta_p"),
    slow("field_and_rates", "gls", "gx.bias"),
    slow("systematic", "batch", "ax.k0"),
    slow("systematic", "kalman", "gz.delta_p"),
    slow("turntable_kalman", "full", "ax.k0"),
    evidence("turntable_trajectory", "trajectory", "gz.delta_p"),
]
WITHOUT_PRIORS = {"ship_planar"}


def calibrate(run: Run, name: str, mean: float, sd: float) -> Outcome:
    """Return the outcome with one more prior."""
    prior = Gaussian((name,), np.array([mean]), np.array([[sd**2]]))
    return inercal.calibrate(replace(run, priors=(*run.priors, prior)))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "estimator", "name"), CASES)
def test_a_prior_that_the_data_contradict_is_named_with_the_shift_that_it_causes(
    tmp_path: Path, method: str, estimator: str, name: str
):
    truth = simulate_run(write_run(method, tmp_path), 1).truth
    run = replace(read(write_run(method, tmp_path, f'estimator = "{estimator}"')), truth=truth)
    found = inercal.calibrate(run)
    assert found.verdict.grade == "consistent"
    k = found.calibration.sensor.coefficients.index(name)
    value, u = float(found.calibration.values[k]), float(found.calibration.std[k])

    assert calibrate(run, name, value + 0.5 * u, u).verdict.grade == "consistent"

    tight = calibrate(run, name, value + 15 * u, 0.3 * u)
    suspect = tight.verdict.suspect
    assert suspect is not None
    assert suspect.name == f"prior of {name}"
    moved = (tight.calibration.values[k] - value) / (2 * tight.calibration.std[k])
    assert suspect.shift == pytest.approx(abs(moved), rel=0.1)
    assert tight.verdict.grade == "unreliable"

    # The data decide the value, and are not worse for it, but the prior is still wrong.
    wide = calibrate(run, name, value + 50 * u, 5 * u)
    assert wide.verdict.suspect is not None
    assert wide.verdict.suspect.name == f"prior of {name}"


def test_every_method_that_uses_priors_is_tested():
    tested = {getattr(case, "values", case)[0] for case in CASES}
    assert tested == set(METHODS) - WITHOUT_PRIORS
