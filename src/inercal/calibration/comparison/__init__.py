"""Compare two calibrations, coefficient by coefficient and all together.

Both calibrations are first converted to the same axes, nominal readout, model form and body frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InercalError, InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.calibration import Calibration
from inercal.calibration.comparison import changes
from inercal.calibration.shared_errors import shared_covariance

ROUNDING = 1e-6  # in u: rounding error that remains if shared errors cancel completely
_FIXED_STD = 1e-12  # u over a coefficient's natural size, below which it was fixed
_MIXED = {"k1", "scale", "delta_o", "delta_p"}  # a change of frame or form mixes these


@dataclass(frozen=True, eq=False)
class Comparison:
    """The difference between a later and an earlier calibration, in the same frame and form.

    Parameters
    ----------
    first, second : Calibration
    names : tuple of str
        Coefficients that both calibrations state with an uncertainty.
    exclusions : tuple of str
        Descriptions of coefficients that only one calibration has or that were not measured.
    """

    first: Calibration
    second: Calibration
    names: tuple[str, ...]
    exclusions: tuple[str, ...]

    @cached_property
    def difference(self) -> Array:
        """Values of the second calibration minus values of the first calibration, SI, (p,)."""
        first, second = (np.array([one.value(n) for n in self.names]) for one in self._both)
        return second - first

    @cached_property
    def std(self) -> tuple[Array, Array]:
        """Standard uncertainties (k = 1) of the first and second calibrations, SI, (p,) each."""
        first, second = (np.array([one.uncertainty(n) for n in self.names]) for one in self._both)
        return first, second

    @cached_property
    def difference_covariance(self) -> Array:
        """Covariance of the difference, SI, (p, p); errors that both share have cancelled."""
        first, second = (
            [one.sensor.coefficients.index(name) for name in self.names] for one in self._both
        )
        shared = shared_covariance(self.first.shared, self.second.shared, (first, second))
        own = self.first.covariance[np.ix_(first, first)]
        own = own + self.second.covariance[np.ix_(second, second)]
        return own - shared - shared.T

    @property
    def states_uncertainty(self) -> bool:
        """Whether at least one calibration states uncertainties, as E_n requires."""
        return any(one.states_uncertainty for one in self._both)

    @property
    def states_shared(self) -> bool:
        """Whether both calibrations state the errors that they share with other calibrations."""
        return all(one.shared is not None for one in self._both)

    @cached_property
    def difference_std(self) -> Array:
        """Standard uncertainty of the difference, SI, (p,)."""
        variance = np.diag(self.difference_covariance)
        # If two calibrations share all errors, the remaining variance is tiny or, by rounding, even
        # negative.
        return np.sqrt(np.maximum(variance, (ROUNDING * np.hypot(*self.std)) ** 2))

    @cached_property
    def normalised_errors(self) -> Array:
        """Normalised errors E_n, (p,)."""
        return changes.normalised_errors(self.difference, self.difference_std)

    @cached_property
    def joint_test(self) -> changes.JointTest | None:
        """Joint test of all coefficients; None if no coefficients are common, or no covariance."""
        if not self.names or not self.states_uncertainty:
            return None
        return changes.joint_test(self.difference, self.difference_covariance)

    @property
    def same_recording(self) -> bool:
        """Whether both calibrations are from the same recording and therefore share its errors."""
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
    """Compare two calibrations in the frame and form of the second or, if impossible, the first.

    Raises
    ------
    InputError
        If neither calibration can be converted to the frame and form of the other, or if they have
        no measured coefficient in common.
    """
    if not (found := _compare_converted(first, second)).names:
        axes = " and ".join(
            f"{sensor.name} has {', '.join(sensor.channels)}"
            for sensor in (first.sensor, second.sensor)
        )
        raise InputError(
            "there is nothing to compare, because the calibrations have no measured coefficient "
            f"in common ({axes}); give two calibrations of the same sensor",
            names=(first.sensor.name, second.sensor.name),
        )
    return found


def _compare_converted(first: Calibration, second: Calibration) -> Comparison:
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
    # Without a covariance, it is unknown which coefficients are fixed.
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
        If the calibration cannot be converted; the message states the reason.
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
        # The frame is converted first, because this does not change the form and is impossible in
        # more cases than a conversion of the form.
        turned = _keep_unmeasured(calibration, calibration.in_frame(frame))
        return _keep_unstated(calibration, turned.in_form(like.sensor.form))
    except InercalError as error:
        raise InputError(
            f"its frame is {calibration.frame} and its form {calibration.sensor.form}, not "
            f"{frame} and {like.sensor.form}: {error}"
        ) from None


def _states_no_frame(calibration: Calibration) -> bool:
    """Return whether a calibration from another program does not define a body frame.

    A file without misalignments states only scale factors along the sensor's axes, which are the
    same in every frame.
    """
    terms = {CoefficientName(name).term for name in calibration.sensor.coefficients}
    return not calibration.states_uncertainty and not terms & {"delta_o", "delta_p"}


def _keep_unstated(calibration: Calibration, turned: Calibration) -> Calibration:
    """Return a converted calibration without coefficients that the original did not state.

    A conversion gives missing terms the value 0. If the calibration states uncertainties, these
    terms have u = 0 and do not count as measured. If the calibration comes from another program,
    the value 0 would be compared as if the program had stated it.

    Raises
    ------
    InputError
        If a stated coefficient would depend on a missing coefficient.
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
    """Set u = 0, in a new frame, for coefficients that were not measured in the old frame.

    Without this, gyro misalignments that were not measured would get the uncertainty of the
    rotation and would count as measured. A frame that the accelerometers define fixes some of their
    misalignments by definition. In another frame, these misalignments do count as measured.
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
        # A readout in g is the same as one in m/s².
        sizes = [1.0 if one.unit == "SI" else si_factor(one.unit) for one in (mine, its)]
        nominal = np.array([[mine.scale, mine.offset], [its.scale, its.offset]])
        first, second = nominal * np.array(sizes)[:, None]
        if not np.allclose(first, second, rtol=1e-12, atol=0):
            raise InputError(
                f"its axis {axis.name} has nominally {mine.scale:.9g} {mine.unit} per SI unit and "
                f"{mine.offset:g} at zero, not {its.scale:.9g} {its.unit} and {its.offset:g}. "
                "Coefficients are deviations from the nominal readout, so calibrate with the same "
                "[sensor]",
                names=(axis.name,),
            )


def fixed_coefficients(calibration: Calibration) -> frozenset[str]:
    """Return the coefficients that were not measured, because the frame or the user fixed them."""
    sensor = calibration.sensor
    rows = zip(sensor.coefficients, calibration.std, sensor.unit_scale, strict=True)
    return frozenset(name for name, std, unit_scale in rows if std <= _FIXED_STD * unit_scale)


_UNNAMED = "sensor"  # default of [sensor] name


def different_sensors(*sensors: tuple[str, Mapping[str, str]]) -> tuple[str, str]:
    """Return the serial numbers of sensors (name, [job]) if they differ, or else their names.

    Both are empty if nothing differs, or if all serial numbers are stated and equal.
    """
    serials = [job["serial number"] for _, job in sensors if "serial number" in job]
    names = list(dict.fromkeys(name for name, _ in sensors if name != _UNNAMED))
    if len(set(serials)) > 1:
        return " and ".join(dict.fromkeys(serials)), ""
    return "", "" if len(serials) == len(sensors) or len(names) < 2 else " and ".join(names)


def recording_sha256(calibration: Calibration) -> str:
    """Return the SHA-256 hash of a calibration's recording; empty if it is not stated."""
    return calibration.provenance.get("recording sha256", "")


def largest_change(
    calibration: Calibration, names: Sequence[str], values: Array, u: Array
) -> float:
    """Return by how many stored u a value or its u differs at most from the stored one.

    Parameters
    ----------
    calibration : Calibration
    names : sequence of str
        Names of the stored coefficients. If the calibration has other names, the result is inf.
    values, u : (p,) array
        Stored values and standard uncertainties, SI.
    """
    if tuple(calibration.sensor.coefficients) != tuple(names):
        return float("inf")
    changes = np.abs([calibration.values - values, calibration.std - u])
    known = u > 0
    if np.any(changes[:, ~known] > 0):
        return float("inf")
    return float(np.max(changes[:, known] / u[known], initial=0.0))
