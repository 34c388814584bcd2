"""Check units from readings at rest: accelerometers read gravity, gyros read only their bias.

Rests do not reveal the scale factor of gyros. Raw counts that are declared as °/s, or an analog
output without its offset, look like a large bias and leave residuals that agree with the noise. The
bound is the initial zero-rate output of a low-grade MEMS gyro, ±20 °/s at 25 °C (InvenSense,
MPU-6000 and MPU-6050 Product Specification, PS-MPU-6000A-00 rev. 3.4, section 6.1). A larger bias
is possible, so the check only warns.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import degrees, radians, sqrt

import numpy as np

from inercal.basics.arrays import Array, median_of_rows
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.estimation import Gaussian
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.plan import Hold, Position, Step
from inercal.physics.sensors import G0, Sensor, nominal_inverse
from inercal.recordings import Finding, Observations, Recording, sample_count
from inercal.recordings.data.recording_loader import unsigned_column
from inercal.recordings.io.column_table import BLOCK_ROWS, row_blocks

LARGEST_BIAS = radians(20.0)  # rad/s, of a gyro at rest
_ALL = 3  # independent directions
_WINDOW_S = 0.5
_QUIETEST = 0.1  # share of all windows
_POSSIBLE = (0.5, 2.0)  # of gravity; outside this range the unit is wrong, not the sensor
_USUAL = (0.9, 1.1)
_WHOLE = 0.1  # share of whole numbers, if readings are counts

UNIT_CONFUSIONS = {
    1 / G0: ("g", "m/s²"),
    G0: ("m/s²", "g"),
    1000.0: ("mg", "g"),
    1 / 1000: ("g", "mg"),
    1000 / G0: ("mg", "m/s²"),
    G0 / 1000: ("m/s²", "mg"),
}
"""For each ratio of the norm to its true value: the columns' apparent unit, the stated unit."""

_NEAR = 1.25  # factor within which a confusion is recognised; the ratios differ by much more
_SAME = 1.015  # factor that tells a scale per m/s² from one that is 10 times too large


def norm_finding(norm: float, expected: float, text: str, unit: str = "SI") -> Finding | None:
    """Return a finding if the norm of accelerometer readings differs from the expected norm.

    Parameters
    ----------
    norm, expected : float
        Measured and expected norm, m/s².
    text : str
        Beginning of the message, which states both norms in words.
    unit : str
        Stated unit of the columns. "SI" means that it is not known.

    Returns
    -------
    Finding or None
        Refused if the norm is below half or above twice the expected norm, with the likely
        confusion of units; a warning if it differs by more than 10 %.
    """
    ratio = norm / expected
    if _USUAL[0] <= ratio <= _USUAL[1]:
        return None
    if _POSSIBLE[0] <= ratio <= _POSSIBLE[1]:
        return Finding("warning", "units", f"{text}: check the nominal scale")
    known = ("SI", *(stated for _, stated in UNIT_CONFUSIONS.values()))
    size = None if unit in known else _acceleration(unit)
    confusions = (
        [(r, units) for r, units in UNIT_CONFUSIONS.items() if unit in ("SI", units[1])]
        if size is None
        else [(size / si_factor(one), (one, unit)) for one in ("g", "m/s²", "mg")]
    )
    near = (units for r, units in confusions if 1 / _NEAR < ratio / r < _NEAR)
    if size is None and unit not in known:
        wrong = f"{ratio:.3g} times too small" if ratio > 1 else f"{1 / ratio:.3g} times too large"
        advice = f"check the scale in [sensor.accelerometer], which is about {wrong}"
        wrong, right = ("g", "m/s²") if ratio > 1 else ("m/s²", "g")
        if 1 / _SAME < max(ratio, 1 / ratio) / G0 < _SAME:
            advice += f"; it may be stated per {wrong} instead of per {right}"
    elif (units := next(near, None)) is None:
        advice = "check the units and the nominal scale of the columns in [sensor.accelerometer]"
    else:
        advice = (
            f"the readings look like {units[0]}, but are declared as {units[1]}: in "
            f'[sensor.accelerometer] state unit = "{units[0]}", or a scale per {units[0]}'
        )
    return Finding("refused", "units", f"{text}: {advice}")


def _acceleration(unit: str) -> float | None:
    """Return the SI size of a unit of acceleration; None for other units, such as counts."""
    try:
        return si_factor(unit, "m/s²")
    except InputError:
        return None


def audit_rest_norm(recording: Recording, sensor: Sensor, gravity: float) -> Recording:
    """Return the recording, with a finding if its norm at rest is not gravity.

    Parameters
    ----------
    recording : Recording
        A recording that contains rests, in any attitude.
    sensor : Sensor
        Sensor whose accelerometers, with their nominal readout, are all channels of the recording.
        One or two of them may be across gravity, so they are not checked.
    gravity : float
        Local gravity, m/s².
    """
    accelerometers = sensor.select_axes("f")
    if accelerometers.rank("f") < _ALL:
        return recording
    columns = [recording.channels.index(name) for name in accelerometers.channels]
    to_force = nominal_inverse(accelerometers.axes)[:, :3]

    def sensed(rows: slice) -> Array:
        return accelerometers.to_si(recording.data[rows][:, columns]) @ to_force

    norm = norm_at_rest(sensed, recording)
    unit = accelerometers.axes[0].readout.unit
    finding = norm_finding(norm, gravity, rest_norm_text(norm, gravity), unit)
    if finding is None:
        return recording
    if finding.severity == "refused" and (cause := _thousands(recording, columns)):
        finding = replace(finding, message=f"{rest_norm_text(norm, gravity)}: {cause}")
    return recording.with_findings((*recording.findings, finding))


def _thousands(recording: Recording, columns: Sequence[int]) -> str:
    """Return a text if 8.5 beside 850 seems to be 8500; an empty one otherwise."""
    read = recording.data[:BLOCK_ROWS, columns]
    whole, size = read == np.rint(read), np.abs(read)
    if whole.all() or np.mean(whole) < _WHOLE or size.max() >= 1000 or size[~whole].min() < 1:
        return ""
    if not np.allclose(1000 * read, np.rint(1000 * read), atol=1e-6):
        return ""
    example = float(read[~whole][0])
    return (
        f"some readings are whole numbers and others have three decimals, such as {example:.3f}: "
        f"if this means {1000 * example:.0f}, with a point for thousands, export without separators"
    )


def rest_mean_finding(means: Array, sensor: Sensor, gravity: float) -> Finding | None:
    """Apply `norm_finding` to means at rest.

    Parameters
    ----------
    means : (r, m) array
        Mean readings at rest in any attitude, SI, after the nominal readout.
    sensor : Sensor
        Sensor whose accelerometers are checked if they measure all three components.
    gravity : float
        Local gravity, m/s².
    """
    columns = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    if not len(means) or sensor.rank("f") < _ALL:
        return None
    force = means[:, columns] @ np.linalg.pinv(sensor.input_axes("f")).T
    norm = float(median_of_rows(np.linalg.norm(force, axis=-1)))
    unit = sensor.axes[columns[0]].readout.unit
    return norm_finding(norm, gravity, rest_norm_text(norm, gravity), unit)


def rest_norm_text(norm: float, gravity: float) -> str:
    """Return a text that states both norms, m/s²."""
    return f"specific force at rest is {norm:.4g} m/s² where gravity is {gravity:.5g} m/s²"


def norm_at_rest(sensed: Callable[[slice], Array], recording: Recording) -> float:
    """Return the median of the mean norms in the windows in which the norm varies least.

    Parameters
    ----------
    sensed : callable
        Function from rows of the recording to the accelerometers' readings, (k, m) m/s².
    recording : Recording
        Recording with n samples.
    """
    n = recording.time.size
    window = max(2, min(sample_count(_WINDOW_S, recording.median_step), n))
    scatter: list[Array] = []
    mean: list[Array] = []
    for rows in row_blocks(n // window * window, -(-BLOCK_ROWS // window) * window):
        force = sensed(rows)
        windows = np.sqrt(np.vecdot(force, force)).reshape(-1, window)  # faster than `norm`
        scatter.append(windows.std(axis=1))
        mean.append(windows.mean(axis=1))
    spread = np.concatenate(scatter)
    quiet = np.argsort(spread)[: max(1, round(_QUIETEST * spread.size))]
    return float(np.median(np.concatenate(mean)[quiet]))


def rate_finding(
    rates: Sequence[tuple[str, float]], advice: str, columns: Sequence[str] = ()
) -> Finding | None:
    """Return a warning about gyros that read more at rest than any plausible bias.

    Parameters
    ----------
    rates : sequence of (str, float)
        Names of these gyros, and their readings, rad/s.
    advice : str
        Further advice, after "check unit, scale and offset in [sensor.gyro]".
    columns : sequence of str
        Columns of these gyros, which are named if they differ from the names.
    """
    if not rates:
        return None
    numbers = [f"{degrees(rate):.0f}".replace("-", "−") for _, rate in rates]
    listed = ", ".join(f"{rates[k][0]} {number} °/s" for k, number in enumerate(numbers))
    if columns and [*columns] != [name for name, _ in rates]:
        listed += f" (column{'s' * (len(columns) > 1)} {', '.join(columns)})"
    text = (  # the verdict prints the part before the first semicolon, or before the bracket
        f"at rest the gyros read {listed}; a bias is rarely beyond ±"
        f"{degrees(LARGEST_BIAS):.0f} °/s: raw counts or volts declared as a rate look like "
        f"this; check unit, scale and offset in [sensor.gyro]{advice}"
    )
    return Finding("warning", "units", text)


def check_zero_rates(
    observations: Observations,
    sensor: Sensor,
    steps: Sequence[Step],
    priors: Sequence[Gaussian],
    columns: Sequence[str | int],
) -> tuple[Finding, ...]:
    """Return a warning if gyros at rest read more than a plausible bias: check the unit.

    Parameters
    ----------
    observations : Observations
        Means in SI units from the nominal readout, without a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Step of each row; rests are steps of the classes `Hold` and `Position`, and steps whose rate
        is 0.
    priors : sequence of Gaussian
        Priors of biases. The difference from the mean of a prior may be 20 °/s, or the expanded
        uncertainty of the prior if this is larger.
    columns : sequence of str or int
        Columns that [data] gyro names, in the order of the sensor's gyros.
    """
    resting = [isinstance(s, Hold | Position) or getattr(s, "rate", None) == 0 for s in steps]
    if observations.track is not None or not any(resting):
        return ()
    expected = _expected_values(priors)
    gyros = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    large: list[tuple[str, float]] = []
    sources: list[str] = []
    for k, column in zip(gyros, columns, strict=False):
        name = sensor.axes[k].name
        rate = float(np.median(observations.mean[resting, k]))
        bias, sd = expected.get(f"{name}.bias", (0.0, 0.0))
        if abs(rate - bias) > max(LARGEST_BIAS, COVERAGE * sd):
            large.append((name, rate))
            sources.append(str(unsigned_column(column)))
    finding = rate_finding(large, ", or state the bias in [method.prior]", sources)
    return () if finding is None else (finding,)


def _expected_values(priors: Sequence[Gaussian]) -> dict[str, tuple[float, float]]:
    """Return the mean and standard deviation of each coefficient that has a prior."""
    return {
        name: (float(prior.mean[..., k]), sqrt(float(prior.covariance[k, k])))
        for prior in priors
        for k, name in enumerate(prior.names)
    }
