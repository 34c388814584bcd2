"""Compare two calibrations, coefficient by coefficient and all together.

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

ROUNDING = 1e-6  # in u: the rounding error where shared errors cancel completely
_FIXED_STD = 1e-12  # of a coefficient's natural size; below, a frame or a user fixed it
_MIXED = {"k1", "scale", "delta_o", "delta_p"}  # mixed by a change of the frame or the form


@dataclass(frozen=True, eq=False)
class Comparison:
    """A later calibration minus an earlier one, in the same terms.

    Parameters
    ----------
    first, second : Calibration
    names : tuple of str
        Coefficients that both calibrations have, with an uncertainty.
    exclusions : tuple of str
        Descriptions of the coefficients that only one has or that were not measured.
    """

    first: Calibration
    second: Calibration
    names: tuple[str, ...]
    exclusions: tuple[str, ...]

    @cached_property
    def difference(self) -> Array:
        """Values of the second minus those of the first calibration, SI, (p,)."""
        first, second = (np.array([one.value(n) for n in self.names]) for one in self._both)
        return second - first

    @cached_property
    def std(self) -> tuple[Array, Array]:
        """Standard uncertainties (k = 1) of the first and the second, SI, (p,) each."""
        first, second = (np.array([one.uncertainty(n) for n in self.names]) for one in self._both)
        return first, second

    @cached_property
    def difference_covariance(self) -> Array:
        """Covariance of the difference, SI, (p, p); errors that both share cancel."""
        first, second = (
            [one.sensor.coefficients.index(name) for name in self.names] for one in self._both
        )
        shared = shared_covariance(self.first.shared, self.second.shared, (first, second))
        own = self.first.covariance[np.ix_(first, first)]
        own = own + self.second.covariance[np.ix_(second, second)]
        return own - shared - shared.T

    @property
    def states_uncertainty(self) -> bool:
        """Whether at least one calibration states uncertainties, so that E_n exists."""
        return any(one.states_uncertainty for one in self._both)

    @property
    def states_shared(self) -> bool:
        """Whether both calibrations state the errors that they share with others."""
        return all(one.shared is not None for one in self._both)

    @cached_property
    def difference_std(self) -> Array:
        """Standard uncertainty of the difference, SI, (p,)."""
        variance = np.diag(self.difference_covariance)
        # If two calibrations share all errors, rounding leaves a tiny or even negative variance.
        return np.sqrt(np.maximum(variance, (ROUNDING * np.hypot(*self.std)) ** 2))

    @cached_property
    def normalised_errors(self) -> Array:
        """Normalised errors E_n, (p,)."""
        return changes.normalised_errors(self.difference, self.difference_std)

    @cached_property
    def joint_test(self) -> changes.JointTest | None:
        """Joint test of all coefficients; None without common coefficients or a covariance."""
        if not self.names or not self.states_uncertainty:
            return None
        return changes.joint_test(self.difference, self.difference_covariance)

    @property
    def same_recording(self) -> bool:
        """Whether both are from the same recording and therefore share its errors."""
        first, second = map(recording_sha256, self._both)
        return bool(first) and first == second

    @property
    def exceedances(self) -> int:
        """Number of coefficients whose |E_n| exceeds 1."""
        return int(np.sum(np.abs(self.normalised_errors) > 1))

    @property
    def expected_exceedances(self) -> float:
        """Number of coefficients whose |E_n| would exceed 1 by chance if nothing changed."""
        return changes.CHANCE_FRACTION * len(self.names)

    @property
    def _both(self) -> tuple[Calibration, Calibration]:
        return self.first, self.second


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Compare two calibrations in the frame and form of the second, or else of the first.

    Raises
    ------
    InputError
        If neither calibration can be converted to the frame and form of the other.
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
    """Return the comparison of two calibrations that have the same frame and form."""
    # Without a covariance we cannot know which coefficients are fixed.
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
    """Return a calibration converted to the body frame and form of another.

    Parameters
    ----------
    calibration, like : Calibration

    Raises
    ------
    InputError
        If it cannot be converted; the message gives the reason.
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
            f"{its - ZERO_CELSIUS:g} °C; calibrate both with the same reference temperature"
        )
    frame = calibration.frame if _states_no_frame(like) else like.frame
    if _states_no_frame(calibration):
        calibration = replace(calibration, frame=frame)
    try:
        # Convert the frame first: this keeps the form and refuses more cases than the form does.
        turned = _keep_unmeasured(calibration, calibration.in_frame(frame))
        return _keep_unstated(calibration, turned.in_form(like.sensor.form))
    except InercalError as error:
        raise InputError(
            f"its frame is {calibration.frame} and its form {calibration.sensor.form}, not "
            f"{frame} and {like.sensor.form}: {error}"
        ) from None


def _states_no_frame(calibration: Calibration) -> bool:
    """Return whether a calibration from another program leaves the body frame open.

    A file without misalignments states only scale factors along the sensor's axes, and these are
    the same in every frame.
    """
    terms = {CoefficientName(name).term for name in calibration.sensor.coefficients}
    return not calibration.states_uncertainty and not terms & {"delta_o", "delta_p"}


def _keep_unstated(calibration: Calibration, turned: Calibration) -> Calibration:
    """Return a converted calibration without the coefficients that it did not state before.

    A conversion gives missing terms the value 0. If the calibration states uncertainties, these
    terms have u = 0 and do not count as measured. If it comes from another program, the 0 would be
    compared as if it had been stated.

    Raises
    ------
    InputError
        If a stated coefficient would depend on a missing one.
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
    """Return a calibration in another frame with u = 0 for coefficients that were not measured.

    Otherwise gyro misalignments that were not measured would get the uncertainty of the rotation
    and count as measured. A frame that is defined by the accelerometers fixes some of their
    misalignments by definition; in another frame these do count as measured.
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
                "with the same [sensor]",
                names=(axis.name,),
            )
        mine, its = axis.readout, other.readout
        same = np.allclose([mine.scale, mine.offset], [its.scale, its.offset], rtol=1e-12, atol=0)
        if not same or mine.unit != its.unit:
            raise InputError(
                f"its axis {axis.name} has nominally {mine.scale:.9g} {mine.unit} per SI unit and "
                f"{mine.offset:g} at zero, not {its.scale:.9g} {its.unit} and {its.offset:g}. "
                "Coefficients are deviations from the nominal readout, so calibrate with the same "
                "[sensor]",
                names=(axis.name,),
            )


def fixed_coefficients(calibration: Calibration) -> frozenset[str]:
    """Return the coefficients that the frame or the user fixed, so that they were not measured."""
    sensor = calibration.sensor
    rows = zip(sensor.coefficients, calibration.std, sensor.unit_scale, strict=True)
    return frozenset(name for name, std, unit_scale in rows if std <= _FIXED_STD * unit_scale)


def recording_sha256(calibration: Calibration) -> str:
    """Return the SHA-256 of the recording of a calibration; empty if it is not stated."""
    return calibration.provenance.get("recording sha256", "")
