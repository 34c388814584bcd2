"""Check the units of a centrifuge's rate, its radius and the accelerometers from norms.

The norm of the readings is √(g² + (r ω²)²) on a platform that is locked to the arm. Units of the
readings multiply the norm by the same factor at all rates. Units of the rate or the radius multiply
only its centripetal part. If gravity is too small to tell them apart, the message names both.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.arm_units import fitting_arm_unit
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.settings import CentrifugeData
from inercal.physics.plan import Spin
from inercal.recordings import Finding, Recording
from inercal.recordings.data import EstimatorInput, RunBase
from inercal.recordings.io.rest_norm import UNIT_CONFUSIONS, norm_finding
from inercal.recordings.segments.dwells import ARM_RATE

_AGREES = float(np.log(1.25))  # of the norms, in the right unit
_POSSIBLE = float(np.log(2.0))  # error of a scale factor that is no wrong unit
_ALIKE = 0.03  # difference of two units' errors that decides nothing
_CLEAR = 0.5  # ratio of the scatter of norms in two units that decides
_LEAST = 1e-9  # m/s², instead of a norm of zero
_TURNING = 0.1  # of the fastest rate: samples below this show gravity at most


def norm_refusal(
    run: RunBase[CentrifugeData], bench: Centrifuge, inputs: EstimatorInput
) -> Finding | None:
    """Return a refusal if the norms of the readings disagree with radius, rate and gravity.

    Raises
    ------
    InputError
        The norms agree if the rate or the radius is in another unit; the message names it.
    """
    steps = [step for step in inputs.steps if isinstance(step, Spin)]
    triad = len(run.sensor.select_axes("f").axes)
    norms = np.linalg.norm(inputs.observations.mean[:, :triad], axis=-1)
    rates = np.array([step.rate for step in steps])
    if not rates.size or bench.platform != "locked":
        return None  # on a counter-rotating platform the centripetal acceleration has no mean
    return _refusal(run, bench, norms, rates, inputs.observations.labels)


def require_arm_units(
    run: RunBase[CentrifugeData], bench: Centrifuge, recording: Recording
) -> None:
    """Refuse a recording whose samples show that the rate or the radius is in another unit.

    Rates in a wrong unit would also hide the dwells. `recording` has the rate in rad/s.

    Raises
    ------
    InputError
        The message names the unit.
    """
    rates = recording.readback[ARM_RATE]
    turning = np.abs(rates) > _TURNING * np.abs(rates).max(initial=0.0)
    if not turning.any() or bench.platform != "locked":
        return
    sensor = run.sensor.select_axes("f")
    columns = [recording.channels.index(name) for name in sensor.channels]
    read = sensor.to_si(recording.data[turning][:, columns])
    _refusal(run, bench, np.linalg.norm(read, axis=-1), rates[turning])


def _refusal(
    run: RunBase[CentrifugeData],
    bench: Centrifuge,
    norms: Array,
    rates: Array,
    labels: tuple[str, ...] = (),
) -> Finding | None:
    def ratios(times: float) -> Array:
        across = (rates * times) ** 2 * bench.radius.value
        return np.maximum(norms, _LEAST) / np.hypot(bench.gravity.value, across)

    def off(times: float, scale: float = 1.0) -> float:
        return float(np.median(np.abs(np.log(ratios(times) / scale))))

    if off(1.0) <= _POSSIBLE:
        return None  # the method itself judges radius and scale
    unit, left = fitting_arm_unit(run, bench.radius.value, off)
    of_readings = min(off(1.0, scale) for scale in UNIT_CONFUSIONS)
    alike = abs(left - of_readings) < _ALIKE
    spread, of_rates = (float(np.std(np.log(ratios(times)))) for times in (1.0, unit.times))
    by_rates = left < of_readings if not alike else of_rates < _CLEAR * spread
    if left < _AGREES and by_rates:
        raise unit.error(run)
    k = int(np.argsort(ratios(1.0))[rates.size // 2])
    norm, expected = float(norms[k]), float(norms[k] / ratios(1.0)[k])
    text = (
        f"{labels[k] if labels else 'a sample'}: the norm of the readings is {norm:.4g} m/s², but "
        f"gravity, [bench] radius and the rate give {expected:.4g} m/s²"
    )
    finding = norm_finding(norm, expected, text)
    if finding is None or finding.severity != "refused":
        return None
    if left < _AGREES and alike and spread > _CLEAR * of_rates:
        return replace(finding, message=f"{finding.message}; or {unit.text} ({unit.key})")
    return finding
