"""Many sensors in one call, against `calibrate` for each of them."""

from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError, NotObserved
from inercal.pipeline import batch as batches

UP = np.concatenate([np.eye(3), -np.eye(3)])
LABELS = ["x_p", "y_p", "z_p", "x_a", "y_a", "z_a"]
KEYS: dict[str, Any] = {
    "method": "six_position",
    "sensor": {"accelerometer": {"unit": "g"}},
    "bench": {"gravity": "9.81 m/s² ± 1 mm/s²", "tilt": "0.1 °"},
    "label": "position",
    "sd": {"accelerometer": "0.2 mg"},
}


def table(count: int, **more: Any) -> dict[str, Any]:
    """Return means of sensors with errors of 1 %, the second with a scatter beyond its noise."""
    rng = np.random.default_rng(2)
    matrix = np.eye(3) + 0.01 * rng.normal(size=(count, 3, 3))
    y = UP @ np.swapaxes(matrix, -1, -2) + 0.01 * rng.normal(size=(count, 1, 3))
    y += np.where(np.arange(count) == 1, 5e-2, 2e-4)[:, None, None] * rng.normal(size=y.shape)
    return {"position": LABELS, **{f"acc_{a}": y[..., k] for k, a in enumerate("xyz")}} | more


def one_of(data: dict[str, Any], k: int) -> dict[str, Any]:
    return {name: one if np.ndim(one) == 1 else one[k] for name, one in data.items()}


@pytest.mark.parametrize("count", [1, 25])
def test_each_sensor_has_the_calibration_of_a_call_of_its_own(
    count: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batches, "_BLOCK", 12)
    data = table(count)
    found = inercal.calibrate_batch(data, **KEYS)
    assert found.converged.all()
    assert found.values.shape == (count, len(found.names))
    for k in {0, min(1, count - 1), count - 1}:
        alone = inercal.calibrate(one_of(data, k), kind="means", **KEYS)
        sd = np.sqrt(np.diag(alone.calibration.covariance))
        np.testing.assert_allclose(found.values[k] / sd, alone.calibration.values / sd, atol=1e-6)
        np.testing.assert_allclose(found.std[k], sd, rtol=1e-6)
        np.testing.assert_allclose(
            found.covariance[k] / np.outer(sd, sd),
            alone.calibration.covariance / np.outer(sd, sd),
            atol=1e-6,
        )
        np.testing.assert_allclose(found.p_value[k], alone.estimate.p_value, rtol=1e-6)
        assert found.names == alone.calibration.sensor.coefficients
    if count > 1:
        assert not alone_consistent(found, 1)
        assert found.std[1].min() > 5 * found.std[0].max()


def alone_consistent(found: batches.BatchCalibration, k: int) -> bool:
    return bool(found.p_value[k] > 0.05)


def test_columns_that_do_not_fit_are_refused():
    data = table(4)
    with refused(InputError, key="data"):
        inercal.calibrate_batch(one_of(data, 0), **KEYS)
    with refused(InputError, key="data"):
        inercal.calibrate_batch(data | {"acc_x": data["acc_x"][:3]}, **KEYS)
    wide = np.broadcast_to(np.array(LABELS), (4, 6))
    with refused(InputError, key="data", names=["position"]):
        inercal.calibrate_batch(data | {"position": wide}, **KEYS)


def test_a_reading_that_is_not_finite_is_refused_by_its_sensor():
    data = table(4)
    data["acc_y"][2, 3] = np.nan
    with refused(InputError, key="data", names=["acc_y"]) as refusal:
        inercal.calibrate_batch(data, **KEYS)
    assert "sensor 3, row x_a" in str(refusal.value)


def test_a_plan_that_does_not_determine_a_coefficient_is_refused():
    data = table(4)
    few = {name: np.asarray(one)[..., :4] for name, one in data.items()}
    with pytest.raises(NotObserved):
        inercal.calibrate_batch(few, **KEYS)


def test_an_estimator_of_one_recording_refuses_a_batch():
    other: dict[str, Any] = KEYS | {"method": "multi_position"}
    with pytest.raises(InputError):
        inercal.calibrate_batch(table(4), **other)
