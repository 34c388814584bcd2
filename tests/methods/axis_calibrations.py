"""Calibrations of sensors with one to six axes, and how far they are off."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import ramps
from tests.accuracy.dividing_head import SIZES, Bench, draw
from tests.accuracy.inercal_inputs import make_bench
from tests.methods import axis_devices
from tests.methods.axis_accuracy import errors
from tests.methods.axis_devices import FACES, RATES, Devices, Warmed
from tests.methods.dual_orthogonal_cases import SI, Case, case, declared, known, observed

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.benches.dividing_head.bench import mounted_sensor, position_plan, sensor_in_plane
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.sections import RateDwell
from inercal.estimation import Estimate
from inercal.methods import METHODS, Priors, hand_likelihood, rates_and_poses
from inercal.methods.dual_orthogonal import joint
from inercal.methods.temperature_ramp import ramp, rest
from inercal.methods.tumble import least_squares
from inercal.noise.analysis import analyse_noise
from inercal.physics.plan import ferraris_plan, six_positions
from inercal.physics.sensors import Noise, Readout, Sensor, axes_along
from inercal.recordings import Observations, Recording, Track
from inercal.recordings.environment import Environment

Array = NDArray[np.float64]
Kind = Literal["f", "w"]
Directions = list[tuple[float, float, float]]
WARM_TERMS = ("bias", "bias_dT", "bias_dT2", "bias_dT3")
HEAD = Bench(collimated="none", sizes=SIZES)


class Found(NamedTuple):
    """For each of n devices: NEES over the number of coefficients, and the share within U."""

    nees: Array
    inside: Array


def sensor_along(directions: Directions, kind: Kind) -> Sensor:
    return Sensor("s", axes_along(directions, kind, "a" if kind == "f" else "g"))


def means(made: Devices, sensor: Sensor, labels: list[str], seconds: list[float]) -> Observations:
    r, m = made.reading.shape[1:]
    return Observations(
        labels=tuple(labels),
        mean=made.reading,
        covariance=np.broadcast_to(made.sd**2 * np.eye(m), (r, m, m)),
        duration=np.array(seconds),
        samples=np.ones(r, dtype=np.int64),
        time=np.arange(r, dtype=float),
        channels=sensor.channels,
        timed=False,
    )


def estimated(
    kind: Kind, directions: Directions, made: Devices, *, exact: bool = False
) -> Estimate:
    """Return the estimate of accelerometers on six faces, or of gyros on a rate table."""
    sensor = sensor_along(directions, kind).with_coefficients("bias", "scale", "misalignment")
    if kind == "f":
        seen = means(made, sensor, [*FACES], [1.0] * len(FACES))
        gravity = Measured(axis_devices.G, 0.0 if exact else axis_devices.GRAVITY_SD)
        hand = Hand(gravity, tilt=0.0 if exact else axis_devices.TILT)
        return hand_likelihood.ml(seen, sensor, hand, six_positions())
    labels = [f"{k} {row.name}" for k, row in enumerate(RATES)]
    seen = means(made, sensor, labels, [row.seconds for row in RATES])
    table: dict[str, Any] = axis_devices.PLAIN.stated()
    table = dict.fromkeys(table, 0.0) if exact else table
    # At a pole, no level part of the earth's rate couples the gyros.
    latitude = Measured(np.pi / 2 if exact else np.radians(50.0), 0.0)
    platform = RatePlatform(Measured(axis_devices.G, 1e-4), latitude, **table)
    steps = [
        RateDwell(label, row.name, row.rate, row.seconds, row.setting)
        for label, row in zip(labels, RATES, strict=True)
    ]
    return rates_and_poses.ml(seen, sensor, platform, steps)


def turned(directions: Directions, made: Devices, *, exact: bool = False) -> Estimate:
    """Return the estimate of `ferraris`; with an exact bench that of gyros alone."""
    axes = () if exact else sensor_along(directions, "f").axes
    sensor = Sensor("s", (*axes, *sensor_along(directions, "w").axes))
    sensor = METHODS["ferraris"].prepare(sensor)
    steps = ferraris_plan(axis_devices.SECONDS, turn_seconds=axis_devices.SECONDS)
    seen = means(made, sensor, [step.label for step in steps], [axis_devices.SECONDS] * len(steps))
    bench = make_bench(axis_devices.HANDS)
    if exact:
        gravity, pole = Measured(axis_devices.G, 0.0), np.pi / 2
        bench = Hand(gravity, pole, tilt=0.0, turn_angle=0.0, turn_tilt=0.0, timebase=0.0)
    return hand_likelihood.ml(seen, sensor, bench, steps)


def warmed(directions: Directions, made: Warmed, lag: Measured | None = None) -> Estimate:
    """Return the estimate of gyros along a temperature ramp."""
    noise = Noise(ramps.WHITE, ramps.FLICKER, ramps.WALK)
    axes = axes_along(directions, "w", "g", Readout(1.0, 0.0, "rad/s", None), noise)
    bare = Sensor("s", axes, reference_temperature=ramps.REFERENCE)
    sensor = METHODS["temperature_ramp"].prepare(bare, also=WARM_TERMS)
    n = len(made.reading)
    seen = Observations(
        ("rest",),
        made.reading.mean(axis=0)[None],
        np.diag(made.reading.var(axis=0) / n)[None],
        np.array([float(n)]),
        np.array([n]),
        np.array([n / 2]),
        sensor.channels,
        temperature=np.array([made.kelvin.mean()]),
        track=Track(
            made.time, made.reading, np.zeros((n, 0)), np.zeros(n, dtype=np.int64), made.kelvin
        ),
    )
    bench, environment = Hand(Measured(9.81, 1e-4)), Environment("ramp", lag=lag)
    return ramp(seen, sensor, bench, rest(), environment=environment)


def drifted(directions: Directions, reading: Array) -> tuple[Array, Array]:
    """Return N, B and K of each gyro at rest, and their standard uncertainties, (m, 3) each."""
    sensor = sensor_along(directions, "w")
    time = np.arange(len(reading), dtype=np.float64) * axis_devices.NOISE_TRUTH.dt
    recording = Recording(time, reading, sensor.channels, ("rad/s",) * len(directions))
    found = analyse_noise(recording, terms="NBK", kinds=("oadev",))
    rows = np.array([[(c.value, c.u) for c in one.coefficients] for one in found.channels])
    return rows[..., 0], rows[..., 1]


def on_head(given: Case, axes: str, priors: Priors = ()) -> Estimate:
    """Return the estimate of one accelerometer by `tumble`, or of two by `joint`."""
    terms = ("k0", "k1", "k2", "k3", "kip", "delta_o")
    sensor = mounted_sensor(axes=tuple(axes)).with_coefficients(*terms)
    at = ["ab".index(axis) for axis in axes]
    covariance = np.asarray(given.seen.covariance)[:, at][:, :, at]
    seen = replace(
        given.seen, mean=given.seen.mean[..., at], covariance=covariance, channels=tuple(axes)
    )
    if len(axes) == 1:
        return least_squares(seen, sensor, given.bench, given.steps, priors)
    return joint(seen, sensor, given.bench, given.steps, priors)


def compared(truth: dict[str, Array], found: Estimate, names: list[str] | None = None) -> Found:
    """Return NEES and the share within U of devices with these true coefficients.

    U includes the Birge ratio, which chance enlarges in 5 % of devices; NEES does not.
    """
    assert np.all(found.converged)
    wanted = [name for name in found.names if name in found.wanted] if names is None else names
    off, covariance = errors(truth, found, wanted)
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    scaled = covariance / size[..., :, None] / size[..., None, :]
    whitened = np.linalg.solve(scaled, (off / size)[..., None])[..., 0]
    nees = (off / size * whitened).mean(axis=-1)
    return Found(nees, (np.abs(off) < 2 * size * found.birge[..., None]).mean(axis=-1))


def _faces(directions: Directions, n: int, seed: int) -> Found:
    made = axis_devices.accelerometers(np.array(directions), n, np.random.default_rng(seed))
    return compared(made.truth, estimated("f", directions, made))


def _rates(directions: Directions, n: int, seed: int) -> Found:
    made = axis_devices.gyros(np.array(directions), n, np.random.default_rng(seed))
    return compared(made.truth, estimated("w", directions, made))


def _turned(directions: Directions, n: int, seed: int) -> Found:
    made = axis_devices.by_hand(np.array(directions), n, np.random.default_rng(seed))
    return compared(made.truth, turned(directions, made))


def _warmed(directions: Directions, n: int, seed: int) -> Found:
    parts: list[Found] = []
    for k in range(n):
        made = axis_devices.warmed(np.array(directions), np.random.default_rng([seed, k]))
        found = warmed(directions, made)
        names = [name for name in found.wanted if name.split(".")[1] in made.truth]
        parts.append(compared(made.truth, found, names))
    return joined(parts)


def _drifted(directions: Directions, n: int, seed: int) -> Found:
    truth = axis_devices.NOISE_TRUTH
    true = np.array([truth.white, truth.flicker, truth.walk]) * truth.unit
    parts: list[Found] = []
    for k in range(n):
        reading = axis_devices.drifting(np.array(directions), 1000 * seed + k)
        value, u = drifted(directions, reading)
        off = (value - true) / u
        parts.append(Found((off**2).mean()[None], (np.abs(off) < 2).mean()[None]))
    return joined(parts)


def tumbled(y: Array, ahead: Sequence[float], bench: Bench, first: int = 1) -> Estimate:
    """Return the estimate of accelerometers `ahead` of x by these angles, numbered from `first`."""
    names = tuple(f"a{k}" for k in range(first, first + len(ahead)))
    along = axes_along([(np.cos(a), np.sin(a), 0.0) for a in ahead])
    axes = [replace(one, name=name) for one, name in zip(along, names, strict=True)]
    sensor = sensor_in_plane("s", axes)
    sensor = sensor.with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
    steps = position_plan(y.shape[-2])
    seen = observed(y, steps, bench.noise, names)
    return least_squares(seen, sensor, declared(bench), steps)


def _tumbled(directions: Directions, n: int, seed: int) -> Found:
    ahead = [float(np.arctan2(y, x)) for x, y, _ in directions]
    _, truth, y = draw(seed, n, HEAD, ahead=ahead)
    return compared(_si(truth), tumbled(y, ahead, HEAD))


def _on_head(directions: Directions, n: int, seed: int) -> Found:
    given = case(seed, n, HEAD)
    priors = (known(given, "kip", 20.0), known(given, "k3", 5.0))
    return compared(_si(given.truth), on_head(given, "ab", priors))


def _si(truth: dict[str, Array]) -> dict[str, Array]:
    short = {"delta": "delta_o", "k0": "bias", "k1": "scale"}
    return {short.get(name, name): SI[name] * value for name, value in truth.items()}


def joined(parts: Sequence[Found]) -> Found:
    """Return several batches as one."""
    return Found(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


CALIBRATED: dict[str, Callable[[Directions, int, int], Found]] = {
    "six_position": _faces,
    "rates_and_poses": _rates,
    "ferraris": _turned,
    "temperature_ramp": _warmed,
    "noise": _drifted,
    "tumble": _tumbled,
    "dual_orthogonal": _on_head,
}
