"""The class of a calibration, which corrects readings and can be converted to other frames."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.calibration.forms import (
    ConvertedCoefficients,
    Frame,
    convert_form,
    convert_frame,
    ieee1293,
)
from inercal.calibration.grade import Verdict
from inercal.calibration.shared_errors import BenchEstimate, SharedErrors, transform_shared
from inercal.calibration.validity import (
    CorrectedMotion,
    Validity,
    checked_readings,
    checked_temperatures,
    corrected_motion,
)
from inercal.physics.motion import Motion
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Form, Sensor
from inercal.recordings import Recording

if TYPE_CHECKING:
    from inercal.calibration.prediction import Prediction
    from inercal.calibration.specification import Conformity

SIMULATED = "simulated"
"""Key in `Calibration.provenance`; its text says how we know that the data are simulated."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """The result of a calibration.

    Parameters
    ----------
    sensor : Sensor
        Sensor axes with their readouts, and the names of the estimated coefficients.
    values : (p,) array
        Coefficients in SI units, in the order of `sensor.coefficients`.
    covariance : (p, p) array
        Covariance of the coefficients, multiplied by the Birge ratio if χ² exceeds its bound.
    method, estimator : str
    conditions : mapping of str to str
        Gravity, temperature and bench as texts with units.
    provenance : mapping of str to str
        Recording file, its SHA-256, date and program version.
    notes : tuple of str
        Limitations of the result, as texts.
    frame : "mount", "triangular" or "symmetric"
        Body frame of the misalignments; see `in_frame`.
    mount : (3, 3) array
        Rotation that converts vectors from the mounting frame to `frame`.
    verdict : Verdict or None
        Grade of the result and the reasons for it; None if the file does not state a verdict.
    shared : tuple of SharedError or None
        Bench errors that the covariance includes and that other calibrations may share; None if the
        file does not state them.
    validity : Validity or None
        Ranges of motion and temperature that the data cover; None if the file does not state them.
    job : mapping of str to str
        Details of the job and the laboratory as texts ([job] in the run file).
    conformity : Conformity or None
        Conformity of the coefficients with their limits; None if no limits are stated.
    bench_estimates : tuple of BenchEstimate or None
        Bench parameters that were estimated from this run; None if the file does not state them.

    Raises
    ------
    InputError
        If a value is not finite, shapes disagree, or a shared error is listed twice.
    """

    sensor: Sensor
    values: Array
    covariance: Array
    method: str = ""
    estimator: str = ""
    conditions: Mapping[str, str] = field(default_factory=dict[str, str])
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    notes: tuple[str, ...] = ()
    frame: Frame = "mount"
    mount: Array = field(default_factory=lambda: np.eye(3))
    verdict: Verdict | None = None
    shared: SharedErrors = None
    validity: Validity | None = None
    job: Mapping[str, str] = field(default_factory=dict[str, str])
    conformity: "Conformity | None" = None
    bench_estimates: tuple[BenchEstimate, ...] | None = None

    def __post_init__(self) -> None:
        p = len(self.sensor.coefficients)
        if not (np.isfinite(self.values).all() and np.isfinite(self.covariance).all()):
            raise InputError(
                f"calibration of {self.sensor.name}: values and covariance must be finite; remove "
                "the values that are not"
            )
        if self.values.shape != (p,) or self.covariance.shape != (p, p):
            raise InputError(
                f"calibration of {self.sensor.name}: values have shape {self.values.shape}, "
                f"covariance {self.covariance.shape}; expected ({p},) and ({p}, {p})"
            )
        names = [one.name for one in self.shared or ()]
        for one in self.shared or ():
            if one.covariance.shape != (p,) or names.count(one.name) > 1:
                raise InputError(
                    f"calibration of {self.sensor.name}: shared error {one.name} has "
                    f"{one.covariance.size} covariances in {names.count(one.name)} entries; give "
                    f"{p} in a single entry",
                    names=(one.name,),
                )

    def __repr__(self) -> str:
        from inercal.calibration.display import title

        verdict = "" if self.verdict is None else f", {self.verdict.word}"
        count = len(self.sensor.coefficients)
        return f"<Calibration of {title(self)}, {format_count(count, 'coefficient')}{verdict}>"

    def _repr_html_(self) -> str:
        from inercal.calibration.display import to_html

        return to_html(self)

    def to_latex(self) -> str:
        """Return a LaTeX tabular (package booktabs) of the coefficients with U (k = 2)."""
        from inercal.calibration.display import to_latex

        return to_latex(self)

    def to_dataframe(self) -> Any:
        """Return the coefficients as a pandas DataFrame, in the units of the coefficient table.

        Returns
        -------
        pandas.DataFrame
            Rows are indexed by full name; the columns are meaning, value, u (k = 1), U (k = 2) and
            unit.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        from inercal.calibration.display import to_dataframe

        return to_dataframe(self)

    @property
    def std(self) -> Array:
        """Standard uncertainty (k = 1) of each coefficient in SI units, (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def states_uncertainty(self) -> bool:
        """Whether there is a covariance; calibrations imported from other programs have none."""
        return bool(self.covariance.any())

    def value(self, name: str) -> float:
        """Return the SI value of the coefficient with this full name, such as "ax.k0"."""
        return float(self.values[self._index(name)])

    def uncertainty(self, name: str) -> float:
        """Return the standard uncertainty (k = 1), SI, of the coefficient with this full name."""
        k = self._index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def _index(self, name: str) -> int:
        if name not in self.sensor.coefficients:
            raise InputError(
                f"no coefficient {name!r} in this calibration; it has "
                + ", ".join(self.sensor.coefficients),
                names=(name,),
            )
        return self.sensor.coefficients.index(name)

    @property
    def conformity_lines(self) -> list[str]:
        """Text lines on the limits in the specification; empty if there is no specification."""
        from inercal.calibration.specification import conformity_lines

        return conformity_lines(self.conformity, self.sensor, self.verdict)

    def correct(
        self,
        recording: Recording | Array,
        *,
        f: Array | None = None,
        w: Array | None = None,
        m: Array | None = None,
        dw: Array | None = None,
        dT: Array | float | None = None,
        dTdt: Array | float | None = None,
        extrapolate: bool = False,
    ) -> CorrectedMotion:
        """Compute the specific force, the angular rate and the magnetic field from readings.

        Parameters
        ----------
        recording : Recording or (..., n, m) array
            Readings in output units; the columns of an array are the sensor's axes in order.
        f, w, m : (..., n, 3) arrays, optional
            Specific force, rate or magnetic flux density, if the sensor does not measure it, or
            measures only components (`inercal.physics.sensors.inverse`). By default zero.
        dw : (..., n, 3) array, optional
            Angular acceleration in rad/s², needed if the model includes lever arms. For a
            Recording, it is computed.
        dT : (..., n) array or float, optional
            Temperature minus the reference temperature, in K. For a Recording, its temperatures are
            used.
        dTdt : (..., n) array or float, optional
            Time derivative of the temperature in K/s, needed if the model depends on it. For a
            Recording, it is computed.
        extrapolate : bool
            Whether readings outside the temperature range of the calibration are also corrected.

        Returns
        -------
        CorrectedMotion
            f in m/s², ω in rad/s and m in T, in the frame of the calibration; zero if there is no
            such sensor. If the axes of a kind measure only one or two components and the others are
            not passed, the result has one column for each of these axes, the component along it:
            (..., n, 1) for one axis. If there are redundant axes, it has their parity residual.

        Raises
        ------
        InputError
            If a channel is missing or has another unit, if readings or temperatures are not finite,
            or if a temperature is impossible or outside the range of the calibration.
        NotInvertible
            If no motion, or no unique motion, gives a reading, because of the nonlinear terms.
        """
        y = checked_readings(self.sensor, recording)
        dT, dTdt = checked_temperatures(
            self.sensor, self.validity, recording, dT, dTdt, extrapolate=extrapolate
        )
        time = recording.time if isinstance(recording, Recording) else None
        passed: dict[Measures, Array | None] = {"f": f, "w": w, "m": m}
        return corrected_motion(self.sensor, y, self.values, passed, dw, dT, dTdt, time)

    def predict(
        self,
        f: ArrayLike | None = None,
        w: ArrayLike | None = None,
        T: ArrayLike | None = None,
        m: ArrayLike | None = None,
        *,
        extrapolate: bool = False,
    ) -> "Prediction":
        """Predict the error of the readings, and the uncertainty of corrected values, at points.

        Parameters
        ----------
        f : (3,) or (n, 3) array, optional
            Specific force in m/s², in the frame of the calibration; zero by default.
        w : (3,) or (n, 3) array, optional
            Angular rate in rad/s; zero by default.
        T : (n,) array or float, optional
            Temperature in K; by default the temperature of the calibration.
        m : (3,) or (n, 3) array, optional
            Magnetic flux density in T; zero by default.
        extrapolate : bool
            Whether points outside the validity are accepted. U then includes the effects that the
            data cannot show (`inercal.calibration.prediction`).

        Returns
        -------
        Prediction
            One row for each point, in SI units.

        Raises
        ------
        InputError
            If the calibration states no uncertainties, if a point is not finite or outside the
            validity, or if the sensor does not sense a part that is not zero.
        NotInvertible
            If the model has no unique correction at a point.
        """
        from inercal.calibration.prediction import predict

        return predict(self, f, w, T, m, extrapolate=extrapolate)

    def affine_correction(self) -> tuple[Array, Array]:
        """Return C, (k, m), and o, (m,), in motion = C (output − o) for an affine model.

        `motion` contains f (m/s²), ω (rad/s) and then m (T), but only what the sensor measures, as
        `correct` returns it.

        Raises
        ------
        InputError
            If the model has nonlinear terms; use `correct` instead.
        """
        if not self.sensor.affine:
            if replace(self.sensor, form="reference").affine:
                return self.in_form("reference").affine_correction()
            raise InputError(
                "the model has nonlinear terms, so no single matrix can apply it; use correct",
                names=self.sensor.coefficients,
            )
        rest = Motion(np.zeros((1, 3)))
        sensed = self.sensor.sensed
        slope = self.sensor.slope(rest, self.values)[0] @ sensed.basis
        offset = self.sensor.to_output(self.sensor.forward(rest, self.values))[0]
        scale = np.array([axis.readout.scale for axis in self.sensor.axes])
        matrix = np.asarray(sensed.rows @ sensed.basis @ np.linalg.pinv(slope), dtype=np.float64)
        return matrix / scale, offset

    def ieee1293(self) -> ConvertedCoefficients:
        """Return the coefficients of E = K₁ (K₀ + a + K₂ a² + …) of each accelerometer axis."""
        # The equation in the standard corresponds to the reference form. Nonlinear terms act along
        # the same axis as before.
        linear = replace(self.sensor, form="reference").affine
        plain = self.in_form("reference") if linear else self
        return ieee1293(plain.sensor, plain.values, plain.covariance, plain.shared)

    def in_form(self, form: Form) -> "Calibration":
        """Return the calibration with its model in the "reference" or the "tilted" form.

        The conversion is exact, because the terms must be affine in f and ω.

        Raises
        ------
        InputError
            If the model has nonlinear terms.
        """
        if form == self.sensor.form:
            return self
        sensor, values, by = convert_form(self.sensor, self.values, self.covariance)
        return self._replace_coefficients(sensor, values, by)

    def _replace_coefficients(self, sensor: Sensor, values: Array, by: Array) -> "Calibration":
        """Return the calibration with new coefficients; `by` contains their derivatives, (q, p)."""
        covariance, shared = by @ self.covariance @ by.T, transform_shared(self.shared, by)
        # Conformity is dropped, because its limits apply to the original coefficients.
        return replace(
            self,
            sensor=sensor,
            values=values,
            covariance=covariance,
            shared=shared,
            conformity=None,
        )

    def in_frame(self, frame: Frame) -> "Calibration":
        """Convert the calibration to another body frame.

        In the "triangular" frame, x is along the first input axis, and y is in the plane of the
        first two input axes. The "symmetric" frame is the closest frame in which the misalignment
        matrix of the accelerometers is symmetric. The conversion is exact for misalignments of any
        size. The mounting frame cannot be recovered from another frame.

        Raises
        ------
        InputError
            If the sensor has no accelerometer triad, if the model has nonlinear terms, or if
            `frame` is "mount".
        """
        if frame == self.frame:
            return self
        if frame not in ("triangular", "symmetric"):
            raise InputError(
                f"frame {frame!r}: only conversion to 'triangular' or 'symmetric' is possible",
                key="frame",
            )
        plain = self.in_form("reference")
        sensor, values, by, turn = convert_frame(
            plain.sensor, plain.values, plain.covariance, frame
        )
        turned = replace(
            plain._replace_coefficients(sensor, values, by), frame=frame, mount=turn @ self.mount
        )
        return turned.in_form(self.sensor.form)
