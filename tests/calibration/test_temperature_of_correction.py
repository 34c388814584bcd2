"""`Calibration.correct` refuses temperatures as `apply` does."""

from dataclasses import replace

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration, Validity
from inercal.methods import METHODS
from inercal.physics.sensors import Noise, Readout, triad
from inercal.recordings import Recording

READING = np.array([[0.1, -0.2, 9.8]])


def calibration(*, known: bool = True) -> Calibration:
    """Return a calibration of biases against temperature from 0 to 40 °C."""
    sensor = triad("accelerometer", "f", "a", Readout(1.0, 0.0, "m/s²", None), Noise(0, 0, 0))
    sensor = METHODS["six_position"].prepare(sensor, also=("k0_dT",))
    n = len(sensor.coefficients)
    limits = (ZERO_CELSIUS, ZERO_CELSIUS + 40.0)
    return Calibration(
        sensor,
        np.zeros(n),
        np.eye(n) * 1e-12,
        "six_position",
        "ml",
        validity=Validity(temperature=limits) if known else None,
    )


@pytest.mark.parametrize("dT", [0.0, 20.9, -20.9])
def test_temperatures_of_the_calibration_are_corrected(dT: float):
    assert np.isfinite(calibration().correct(READING, dT=dT).f).all()


@pytest.mark.parametrize("dT", [60.0, -21.5, np.array([0.0, 21.5])])
def test_temperatures_beyond_are_refused_unless_asked_for(dT: float | np.ndarray):
    found, readings = calibration(), np.repeat(READING, np.size(dT), axis=0)
    with refused(InputError, key="dT"):
        found.correct(readings, dT=dT)
    assert np.isfinite(found.correct(readings, dT=dT, extrapolate=True).f).all()


def test_a_recording_beyond_is_refused_unless_asked_for():
    hot = Recording(
        np.arange(2.0),
        np.repeat(READING, 2, axis=0),
        ("ax", "ay", "az"),
        ("m/s²",) * 3,
        temperature=np.full(2, ZERO_CELSIUS + 60.0),
    )
    with refused(InputError, key="dT"):
        calibration().correct(hot)
    assert np.isfinite(calibration().correct(hot, extrapolate=True).f).all()


def test_nothing_below_zero_kelvin_is_corrected_whatever_is_asked_for():
    for found in (calibration(), calibration(known=False)):
        with refused(InputError, key="dT"):
            found.correct(READING, dT=-1812.0, extrapolate=True)


def test_without_a_known_range_only_possible_temperatures_are_corrected():
    found = calibration(known=False)
    assert np.isfinite(found.correct(READING, dT=100.0).f).all()
    with refused(InputError, key="dT"):
        found.correct(READING, dT=584.0)
    assert np.isfinite(found.correct(READING, dT=584.0, extrapolate=True).f).all()


def test_a_model_without_temperature_takes_any():
    whole = calibration()
    kept = [k for k, name in enumerate(whole.sensor.coefficients) if "_dT" not in name]
    sensor = replace(whole.sensor, coefficients=tuple(whole.sensor.coefficients[k] for k in kept))
    one = replace(
        whole,
        sensor=sensor,
        values=whole.values[kept],
        covariance=whole.covariance[np.ix_(kept, kept)],
    )
    assert np.isfinite(one.correct(READING, dT=60.0).f).all()
