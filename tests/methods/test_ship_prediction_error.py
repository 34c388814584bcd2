"""The stated error of fresh poses against the true error of corrected readings there."""

from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.rate_table import RADIUS
from tests.base_seeds import evidence
from tests.methods.ship_cases import ESTIMATORS, SENSOR, case

from inercal.estimation import Estimate
from inercal.methods.ship_planar import expected_error, pose_forces, prediction_note
from inercal.physics.sensors import G0
from inercal.physics.sensors.affine import to_affine

FASTEST = 86 * np.pi / 30


def one(found: Estimate, k: int) -> Estimate:
    """Return one trial of many."""
    covariance = np.broadcast_to(found.covariance, (*found.value.shape, found.value.shape[-1]))
    return replace(
        found,
        value=found.value[k],
        covariance=covariance[k],
        chi2=np.zeros(()),
        dof=0,
        residual=found.residual[k],
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar", evidence("joint"), evidence("damped")])
def test_fresh_poses_err_as_is_said(name: str):
    given = case(1, 300)
    found = ESTIMATORS[name](given.seen, SENSOR, given.bench, given.steps)
    f = pose_forces(FASTEST, RADIUS, G0)
    said: list[float] = []
    true: list[float] = []
    for k in range(300):
        model, _ = to_affine(SENSOR, found.value[k, :12])
        reading = f / G0 @ given.draw.matrix[k].T + given.draw.bias[k]
        off = reading @ model.matrix.T + model.offset - f / G0
        true.append(float(np.mean(np.sum(off**2, axis=-1))))
        said.append((expected_error(SENSOR, one(found, k), f) / G0) ** 2)
    ratio = np.sqrt(np.mean(true) / np.mean(said))
    print(name, "rms on fresh poses over what is said", ratio)
    assert ratio == pytest.approx(1, abs=0.1)


def test_it_is_said_beside_the_residuals():
    given = case(1, 1)
    found = one(ESTIMATORS["damped"](given.seen, SENSOR, given.bench, given.steps), 0)
    text = prediction_note(SENSOR, found, FASTEST, RADIUS, G0)
    assert text.startswith("In new poses, at any attitude and up to 86 r/min, the corrected vector")
    framed = replace(SENSOR, frame="symmetric")
    found = one(ESTIMATORS["damped"](given.seen, framed, given.bench, given.steps), 0)
    assert "vector, in the symmetric frame, is wrong by" in prediction_note(
        framed, found, FASTEST, RADIUS, G0
    )
    assert np.linalg.norm(pose_forces(FASTEST, RADIUS, G0), axis=-1).max() < 2.4 * G0
