"""Calibrate many sensors of one type together, from tables of means with the same plan.

All sensors share the bench, the plan, the deviations and the priors. They form one problem with a
trial axis, which the estimators solve in compiled code, block by block.
"""
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.process_settings import with_one_thread
from inercal.basics.units import format_count
from inercal.physics.sensors import Sensor
from inercal.pipeline.run_arguments import stated_run
from inercal.recordings import Observations
from inercal.recordings.data.recording_loader import reader_columns
from inercal.runfile import Run

_BLOCK = 2000  # number of sensors whose estimates and nuisances are in memory at once


@dataclass(frozen=True, eq=False, repr=False)
class BatchCalibration:
    """The coefficients of n sensors of one type.

    Parameters
    ----------
    sensor : Sensor
        Sensor type, with the p coefficients that were estimated.
    method, estimator : str
    values : (n, p) array
        Coefficients in SI units.
    covariance : (n, p, p) array
        Covariance to report. It includes the Birge ratio for each sensor whose χ² exceeds the 95 %
        bound.
    chi2 : (n,) array
    dof : int
        Degrees of freedom of each χ².
    converged : (n,) array of bool
        False if no minimum was found for a sensor; its values must not be used.
    """

    sensor: Sensor
    method: str
    estimator: str
    values: Array
    covariance: Array
    chi2: Array
    dof: int
    converged: NDArray[np.bool_]

    def __repr__(self) -> str:
        n, p = self.values.shape
        counts = format_count(n, "sensor"), format_count(p, "coefficient")
        return f"<BatchCalibration: {counts[0]}, {self.method}, {self.estimator}, {counts[1]}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, in the order of `values`."""
        return self.sensor.coefficients

    @property
    def std(self) -> Array:
        """Standard uncertainties to report, (n, p), in SI units."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def p_value(self) -> Array:
        """Probability of a χ² at least this large if noise and model are correct, (n,)."""
        return scipy.special.chdtrc(self.dof, self.chi2) if self.dof else np.ones(len(self.chi2))


@with_one_thread
def calibrate_batch(
    data: Mapping[str, ArrayLike],
    *,
    method: str | Mapping[str, object],
    sensor: Mapping[str, object],
    bench: Mapping[str, object] | None = None,
    **data_keys: Any,
) -> BatchCalibration:
    """Calibrate many sensors of one type from their means in one call.

    Values and covariances are the same as if `calibrate` were called for each sensor, but they are
    computed in compiled code. There is no verdict. Plan, bench and the first sensor are checked as
    in `calibrate`; use `p_value` and `converged` to check the other sensors.

    Parameters
    ----------
    data : mapping of str to array
        A table of means. Each column of readings has the shape (n, r) for n sensors and r rows. The
        other columns have the shape (r,).
    method, sensor, bench, **data_keys
        See `calibrate`; `kind` is always "means".

    Raises
    ------
    InercalError
        See `calibrate`. The error is also raised if the shape of a column is wrong, or if the
        estimator accepts only one recording at a time.

    Examples
    --------
    >>> up = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    >>> errors = np.array([0.001, 0.002, 0.003])[:, None]
    >>> batch = calibrate_batch(
    ...     {
    ...         "position": ["x_p", "x_a", "y_p", "y_a", "z_p", "z_a"],
    ...         **{f"acc_{axis}": up[:, k] + errors for k, axis in enumerate("xyz")},
    ...     },
    ...     method="six_position",
    ...     sensor={"accelerometer": {"unit": "g"}},
    ...     bench={"gravity": "9.80665 m/s² ± 0.001 m/s²", "tilt": "0.1 °"},
    ...     label="position",
    ...     sd={"accelerometer": "0.2 mg"},
    ... )
    >>> batch
    <BatchCalibration: 3 sensors, six_position, ml, 12 coefficients>
    >>> batch.values[:, batch.names.index("ax.k0")] / 9.80665
    array([0.001, 0.002, 0.003])
    """
    columns = {name: np.asarray(column) for name, column in data.items()}
    varied = {name: column for name, column in columns.items() if column.ndim == 2}
    counts = {len(column) for column in varied.values()}
    if len(counts) != 1 or 0 in counts:
        shapes = ", ".join(f"{name} {column.shape}" for name, column in varied.items())
        raise InputError(
            f"calibrate_batch: the columns have the shapes {shapes or 'of one sensor'}; give each "
            "column of readings as an array (sensors, rows)",
            key="data",
        )
    first = {name: column[0] if name in varied else column for name, column in columns.items()}
    keys = {"kind": "means", **data_keys}
    sections = {"method": method, "sensor": sensor, "bench": bench or {}}
    with stated_run(first, sections, keys) as run:
        if run.adds_coefficients:
            raise InputError(
                '[method] also: "auto" may add different coefficients for each sensor, but all '
                "sensors of a batch need the same ones; state them as a list",
                key="[method] also",
            )
        return _calibrate_all(run, columns, counts.pop())


def _calibrate_all(run: Run, columns: Mapping[str, NDArray[Any]], count: int) -> BatchCalibration:
    inputs = run.kind.observe(run)
    observations, bench, solver = inputs.observations, inputs.bench or run.bench, run.solver()
    readings = _readings(run, columns, observations)
    p = len(run.sensor.coefficients)
    values, covariance = np.empty((count, p)), np.empty((count, p, p))
    chi2, converged = np.empty(count), np.empty(count, dtype=bool)
    dof = 0
    ends = np.linspace(0, count, -(-count // _BLOCK) + 1).astype(int).tolist()
    for some in map(slice, ends[:-1], ends[1:]):
        output = np.stack(
            [np.broadcast_to(one, (count, *one.shape[-1:]))[some] for one in readings]
        )
        mean = run.sensor.to_si(np.moveaxis(output, 0, -1))
        found = solver(replace(observations, mean=mean), run.sensor, bench, inputs.plan, run.priors)
        values[some], chi2[some], converged[some] = found.value[:, :p], found.chi2, found.converged
        covariance[some] = found.birge[:, None, None] ** 2 * found.covariance[:, :p, :p]
        dof = found.dof
    return BatchCalibration(
        run.sensor, run.method.name, run.estimator, values, covariance, chi2, dof, converged
    )


def _readings(
    run: Run, columns: Mapping[str, NDArray[Any]], observations: Observations
) -> Sequence[Array]:
    """Return the readings of each channel, (sensors, rows) or (rows,), in output units.

    Raises
    ------
    InputError
        If a column other than the readings differs between sensors, or a reading is not finite.
    """
    names = {axis: column for axis, column, _ in reader_columns(run).channels}
    rows = len(observations.labels)
    if other := tuple(n for n, one in columns.items() if one.ndim > 1 and n not in names.values()):
        raise InputError(
            f"calibrate_batch: column {other[0]!r} differs between sensors, but only the readings "
            f"{', '.join(names.values())} may differ; give it as an array ({rows},)",
            key="data",
            names=other,
        )
    result = [np.asarray(columns[names[axis]], dtype=float) for axis in run.sensor.channels]
    for axis, one in zip(run.sensor.channels, result, strict=True):
        bad = np.argwhere(~np.isfinite(one))
        if len(bad):
            *at, row = bad[0].tolist()
            raise InputError(
                f"calibrate_batch: column {names[axis]!r} of sensor {at[0] + 1 if at else 1}, row "
                f"{observations.labels[row]}, is not finite; correct or remove the sensor",
                key="data",
                names=(names[axis],),
            )
    first = np.stack([one if one.ndim == 1 else one[0] for one in result], axis=-1)
    if not np.array_equal(run.sensor.to_si(first), observations.mean):
        raise InputError(
            f"calibrate_batch: bench {run.kind.name} changes the readings of a table before "
            "they are used; calibrate each sensor separately",
            key="data",
        )
    return result
