"""Two calibrations compared, coefficient by coefficient and all together.

Both are first converted to the same axes, nominal readout, form of the model and body frame.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InercalError, InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.calibration.comparison import changes
from inercal.calibration.shared_errors import shared_covariance

ROUNDING = 1e-6  # of u, what cancels in full
_FIXED_STD = 1e-12  # of a coefficient's natural size: fixed by a frame or a user, not measured
_MIXED = {"k1", "scale", "delta_o", "delta_p"}  # by a change of the frame or the form


@dataclass(frozen=True, eq=False)
class Comparison:
    """A later calibration minus an earlier one, in the same terms.

    Parameters
    ----------
    first, second : Calibration
    names : tuple of str
        Coefficients that both have, with an uncertainty.
    exclusions : tuple of str
        In words: coefficients that only one has, or that were not measured.
    """

    first: Calibration
    second: Calibration
    names: tuple[str, ...]
    exclusions: tuple[str, ...]

    @cached_property
    def difference(self) -> Array:
        """Second minus first, SI, (p,)."""
        first, second = (np.array([one.value(n) for n in self.names]) for one in self._both)
        return second - first

    @cached_property
    def std(self) -> tuple[Array, Array]:
        """Standard uncertainties (k = 1) of first and second, SI, (p,) each."""
        first, second = (np.array([one.uncertainty(n) for n in self.names]) for one in self._both)
        return first, second

    @cached_property
    def difference_covariance(self) -> Array:
        """Covariance of the difference, SI, (p, p); errors that both state to share cancel."""
        first, second = (
            [one.sensor.coefficients.index(name) for name in self.names] for one in self._both
        )
        shared = shared_covariance(self.first.shared, self.second.shared, (first, second))
        own = self.first.covariance[np.ix_(first, first)]
        own = own + self.second.covariance[np.ix_(second, second)]
        return own - shared - shared.T

    @property
    def states_uncertainty(self) -> bool:
        """Whether one of the calibrations states uncertainties, so that E_n exists."""
        return any(one.states_uncertainty for one in self._both)

    @property
    def states_shared(self) -> bool:
        """Whether both calibrations state what they share with others."""
        return all(one.shared is not None for one in self._both)

    @cached_property
    def difference_std(self) -> Array:
        """Standard uncertainty of the difference, SI, (p,)."""
        variance = np.diag(self.difference_covariance)
        # Where two calibrations share all errors, rounding leaves a little, or less than nothing.
        return np.sqrt(np.maximum(variance, (ROUNDING * np.hypot(*self.std)) ** 2))

    @cached_property
    def normalised_errors(self) -> Array:
        """E_n, (p,)."""
        return changes.normalised_errors(self.difference, self.difference_std)

    @cached_property
    def joint_test(self) -> changes.JointTest | None:
        """All coefficients together; None without a common coefficient, or without covariance."""
        if not self.names or not self.states_uncertainty:
            return None
        return changes.joint_test(self.difference, self.difference_covariance)

    @property
    def same_recording(self) -> bool:
        """Whether both are of the same recording, and so share its errors."""
        first, second = map(recording_sha256, self._both)
        return bool(first) and first == second

    @property
    def exceedances(self) -> int:
        """How many |E_n| exceed 1."""
        return int(np.sum(np.abs(self.normalised_errors) > 1))

    @property
    def expected_exceedances(self) -> float:
        """How many would exceed 1 by chance, without a change."""
        return changes.CHANCE_FRACTION * len(self.names)

    @property
    def _both(self) -> tuple[Calibration, Calibration]:
        return self.first, self.second


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Return two calibrations compared in the terms of the second, else in those of the first.

    Raises
    ------
    InputError
        Neither can be brought to the terms of the other.
    """
    try:
        return build_comparison(match_frame_and_form(first, second), second)
    except InputError as error:
        try:
            return build_comparison(first, match_frame_and_form(second, first))
        except InputError:
            raise error.located(
                "the first calibration cannot be compared with the second"
            ) from None


def build_comparison(first: Calibration, second: Calibration) -> Comparison:
    """Return the comparison of two calibrations that are in the same terms."""
    # Without a covariance no coefficient is known to be fixed.
    fixed = frozenset[str]().union(
        *(fixed_coefficients(one) for one in (first, second) if one.states_uncertainty)
    )
    mine, its = (one.sensor.coefficients for one in (first, second))
    names = tuple(name for name in its if name in mine and name not in fixed)
    left_out = [
        f"{words} {', '.join(found)}"
        for words, found in (
            ("not measured:", [n for n in its if n in fixed and n in mine]),
            ("only the first has", [n for n in mine if n not in its and n not in fixed]),
            ("only the second has", [n for n in its if n not in mine and n not in fixed]),
        )
        if found
    ]
    return Comparison(first, second, names, tuple(left_out))


def match_frame_and_form(calibration: Calibration, like: Calibration) -> Calibration:
    """Return a calibration converted to the terms of another.

    Parameters
    ----------
    calibration, like : Calibration

    Raises
    ------
    InputError
        It cannot be converted; the message gives the reason.
    """
    if calibration.sensor is like.sensor and calibration.frame == like.frame:
        return calibration
    if calibration.sensor.axes is not like.sensor.axes:
        _require_same_axes(calibration, like)
    dependent = calibration.sensor.uses("dT") and like.sensor.uses("dT")
    mine, its = (one.sensor.reference_temperature for one in (calibration, like))
    if dependent and mine != its:
        raise InputError(
            f"its reference temperature is {mine - ZERO_CELSIUS:g} °C, not "
            f"{its - ZERO_CELSIUS:g} °C; calibrate both with one reference temperature"
        )
    frame = calibration.frame if _states_no_frame(like) else like.frame
    if _states_no_frame(calibration):
        calibration = replace(calibration, frame=frame)
    try:
        # The frame first: it keeps the form, and refuses more than the form.
        turned = _keep_unmeasured(calibration, calibration.in_frame(frame))
        return _keep_unstated(calibration, turned.in_form(like.sensor.form))
    except InercalError as error:
        raise InputError(
            f"its frame is {calibration.frame} and its form {calibration.sensor.form}, not "
            f"{frame} and {like.sensor.form}: {error}"
        ) from None


def _states_no_frame(calibration: Calibration) -> bool:
    """Return whether a calibration of another program leaves the body frame open.

    A file without misalignments states scale factors along the sensor's axes only, and these are
    the same in every frame.
    """
    terms = {CoefficientName(name).term for name in calibration.sensor.coefficients}
    return not calibration.states_uncertainty and not terms & {"delta_o", "delta_p"}


def _keep_unstated(calibration: Calibration, turned: Calibration) -> Calibration:
    """Return a converted calibration without the coefficients that it did not state before.

    A conversion gives the value 0 to terms that are missing. Of a calibration that states
    uncertainties these have u = 0 and do not count as measured; of one that another program made,
    0 would be compared as if it had been stated.

    Raises
    ------
    InputError
        A stated coefficient would depend on a missing one.
    """
    stated = calibration.sensor.coefficients
    if calibration.states_uncertainty or set(turned.sensor.coefficients) <= set(stated):
        return turned
    missing = [name for name in turned.sensor.coefficients if name not in stated]
    mixed = [name for name in missing if CoefficientName(name).term in _MIXED]
    if mixed:
        raise InputError(f"it does not state {', '.join(mixed)}", names=tuple(mixed))
    kept = [k for k, name in enumerate(turned.sensor.coefficients) if name in stated]
    sensor = replace(turned.sensor, coefficients=tuple(turned.sensor.coefficients[k] for k in kept))
    covariance = turned.covariance[np.ix_(kept, kept)]
    return replace(turned, sensor=sensor, values=turned.values[kept], covariance=covariance)


def _keep_unmeasured(calibration: Calibration, turned: Calibration) -> Calibration:
    """Return a calibration in another frame without uncertainty of what was not measured.

    Misalignments of gyros that were not measured get the uncertainty of the turn alone, and would
    count as measured. A frame of the accelerometers fixes some of their misalignments by
    definition: these are measured in another frame.
    """
    if turned.frame == calibration.frame:
        return turned
    known = set(calibration.sensor.coefficients) - fixed_coefficients(calibration)
    if calibration.frame != "mount":
        known |= set(turned.sensor.select_axes("f").coefficients)
    measured = np.array([name in known for name in turned.sensor.coefficients])
    return replace(turned, covariance=turned.covariance * np.outer(measured, measured))


def _require_same_axes(calibration: Calibration, like: Calibration) -> None:
    others = {axis.name: axis for axis in like.sensor.axes}
    for axis in calibration.sensor.axes:
        other = others.get(axis.name)
        if other is None:
            continue
        if axis.measures != other.measures or not np.allclose(axis.frame, other.frame, atol=1e-9):
            raise InputError(
                f"its axis {axis.name} has another direction in the body frame; calibrate again "
                "with "
                "the same [sensor]",
                names=(axis.name,),
            )
        mine, its = axis.readout, other.readout
        same = np.allclose([mine.scale, mine.offset], [its.scale, its.offset], rtol=1e-12, atol=0)
        if not same or mine.unit != its.unit:
            raise InputError(
                f"its axis {axis.name} has nominally {mine.scale:.9g} {mine.unit} per SI unit and "
                f"{mine.offset:g} at zero, not {its.scale:.9g} {its.unit} and {its.offset:g}: "
                "coefficients are deviations from the nominal readout; calibrate with the same "
                "[sensor]",
                names=(axis.name,),
            )


def fixed_coefficients(calibration: Calibration) -> frozenset[str]:
    """Return the coefficients that were not measured: the frame or the user fixed them."""
    sensor = calibration.sensor
    rows = zip(sensor.coefficients, calibration.std, sensor.unit_scale, strict=True)
    return frozenset(name for name, std, unit_scale in rows if std <= _FIXED_STD * unit_scale)


def recording_sha256(calibration: Calibration) -> str:
    """Return the SHA-256 of the recording that a calibration is of; empty where it names none."""
    return calibration.provenance.get("recording sha256", "")
