"""Two calibrations in the same terms: axes, nominal readout, form of the model and body frame."""

import numpy as np

from inercal.calibration import Calibration
from inercal.errors import InercalError, InputError
from inercal.units import ZERO_CELSIUS

_FIXED_STD = 1e-12  # of a coefficient's natural size: what a frame or a user fixed, not the data


def match_frame_and_form(calibration: Calibration, like: Calibration) -> Calibration:
    """Return a calibration in the terms of another.

    Parameters
    ----------
    calibration, like : Calibration

    Raises
    ------
    InputError
        It cannot be brought to them; the message says why.
    """
    if calibration.sensor.axes is not like.sensor.axes:
        _require_same_axes(calibration, like)
    dependent = calibration.sensor.uses("dT") and like.sensor.uses("dT")
    mine, its = (one.sensor.reference_temperature for one in (calibration, like))
    if dependent and mine != its:
        raise InputError(
            f"its reference temperature is {mine - ZERO_CELSIUS:g} °C, "
            f"not {its - ZERO_CELSIUS:g} °C"
        )
    try:
        # The frame first: it keeps the form, and finds more than the form needs.
        return calibration.in_frame(like.frame).in_form(like.sensor.form)
    except InercalError as error:
        raise InputError(
            f"its frame is {calibration.frame} and its form {calibration.sensor.form}, not "
            f"{like.frame} and {like.sensor.form}: {error}"
        ) from None


def _require_same_axes(calibration: Calibration, like: Calibration) -> None:
    others = {axis.name: axis for axis in like.sensor.axes}
    for axis in calibration.sensor.axes:
        other = others.get(axis.name)
        if other is None:
            continue
        if axis.measures != other.measures or not np.allclose(axis.frame, other.frame, atol=1e-9):
            raise InputError(f"its axis {axis.name} lies another way in the body frame")
        mine, its = axis.readout, other.readout
        same = np.allclose([mine.scale, mine.offset], [its.scale, its.offset], rtol=1e-12, atol=0)
        if not same or mine.unit != its.unit:
            raise InputError(
                f"its axis {axis.name} has nominally {mine.scale:.9g} {mine.unit} per SI unit and "
                f"{mine.offset:g} at zero, not {its.scale:.9g} {its.unit} and {its.offset:g}: "
                "coefficients are departures from that"
            )


def fixed_coefficients(calibration: Calibration) -> frozenset[str]:
    """Return the coefficients that no data stand behind: the frame or the user fixed them."""
    sensor = calibration.sensor
    rows = zip(sensor.coefficients, calibration.std, sensor.unit_scale, strict=True)
    return frozenset(name for name, std, unit_scale in rows if std <= _FIXED_STD * unit_scale)


def recording_sha256(calibration: Calibration) -> str:
    """Return the SHA-256 of the recording that a calibration is of; empty where it names none."""
    return calibration.provenance.get("recording sha256", "")
