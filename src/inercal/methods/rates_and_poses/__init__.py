"""Calibrate gyros at constant rates and rests, and accelerometers in known poses.

Sections of all kinds can be mixed: rests, dwells at constant rates and turns by known angles about
a vertical axis, in settings with several case axes up, and poses with known angles. The errors of
the table are nuisances whose deviations must be stated, because most of them act like an error of
the sensor and leave no residual. Accelerometer readings are used only at rest, where the position
of each accelerometer in the case does not matter.

Coefficients that a plan does not determine are named in an error message. Residual excitation by
the earth's rate or by errors of the bench does not count
(`inercal.methods.rates_and_poses.plan_structure`).

The classical evaluation of a rate test is a least-squares fit with equal weights. Each axis is
fitted separately with y = c + K ω_I + δ_O ω_P − δ_P ω_O and any further selected terms. The inputs
are the stated rates, rests and poses, with the vertical part of the earth's rate. K is the slope of
the straight line of IEEE Std 528, and equals 1 + scale if no nonlinear term is omitted.

The bench is treated as exact, so the covariance contains only the noise of the means. The problem
of `ml`, in which the errors of the bench have their stated deviations, tests whether the readings
are consistent.

Terms that depend on the sign of the input are omitted for axes without a nominal input. A gyro
across the table's axis senses Ω t, where t is the error of the setting, and its asymmetry adds ½ κ′
|Ω t|. The misalignments are almost free, so the estimate of t is near zero. There this term has a
kink, which stops a search, and the sign of the term only depends on errors. The size of the term,
0.1 °/h at κ′ = 500 ppm, 200 °/s and 0.05°, is below the noise of a dwell.

A plan contains settings with a case axis up, and poses near level.

Sources: IEEE Std 952 and 1431, scale-factor and bias tests on a rate table; IEEE Std 1293,
multipoint tests; IEEE Std 528, 952 and 1431. The likelihood is our own.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from math import degrees, pi, radians

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.benches.rate_platform import sections
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import PlatformSteps
from inercal.estimation import Estimate, Problem
from inercal.methods import Method, Priors, mean_problem, solving
from inercal.methods.observability import require_observed
from inercal.methods.order_effects import noise_only_estimate, with_problem_tests
from inercal.methods.rates_and_poses.plan_structure import require_determined
from inercal.physics.motion import Motion
from inercal.physics.plan import small_loop
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.recordings.data.recording_loader import number_repeated_names

_SETTINGS = {3: ("x", "y", "z"), 6: ("x", "-x", "y", "-y", "z", "-z")}
_SPEEDS = (radians(50), radians(200))
_FACES = ((0, 0), (180, 0), (90, 0), (-90, 0), (0, 90), (0, -90))  # roll and pitch, °
# Three circles in steps of 45°, with x, y and z level, and poses with all axes inclined.
_TILTED = (
    *((roll, 0) for roll in range(0, 360, 45)),
    *((0, pitch) for pitch in (45, 90, 135, -135, -90, -45)),
    *((90, pitch) for pitch in (45, 135, -135, -45)),
    *product((45, -45, 135), (35, -35)),
)
_POSES = {"none": (), "faces": _FACES, "tilted": _TILTED}
_ROUNDED = 1 + 1e-9
_NOTHING = 1e-6  # of g, or of 1 rad/s


def plan(
    seconds: float = 36.0,
    positions: int = 6,
    rates: tuple[float, ...] = _SPEEDS,
    reverse: bool = False,
    attitudes: str = "none",
    small_rates: tuple[float, ...] = (),
) -> tuple[sections.PlatformStep, ...]:
    """Return rests and speeds in both directions for every setting, followed by the poses.

    Parameters
    ----------
    seconds : float
        Longest duration of a section, s. Dwells last whole turns if a turn is short enough.
    positions : int
        Number of settings: 3 (each axis up) or 6 (each axis up and down).
    rates : tuple of float
        Speeds, rad/s, all positive.
    reverse : bool
        Whether the table also steps back through the speeds in each direction, to reveal
        hysteresis.
    attitudes : str
        Poses at the end: "none", "faces" (six poses) or "tilted" (24 poses in all directions).
    small_rates : tuple of float
        Changes of the rate, rad/s, positive, at most `SMALL_RATE`. In each setting the table steps
        through them about zero, in a loop, which shows the threshold. It then steps through them
        about the lowest speed that is above `SMALL_RATE` and at least ten times as large as they
        are, which shows the resolution.

    Raises
    ------
    InputError
        The number of settings or the poses are unknown, or a speed is not positive.
    """
    for key, given in (("rates", rates), ("small_rates", small_rates)):
        if any(rate <= 0 for rate in given):
            raise InputError(
                f"{key} contains a speed that is not positive; give positive speeds, because the "
                "table turns at each speed in both directions",
                key=f"[method] {key}",
            )
    largest = max(small_rates, default=0.0)
    if largest > _ROUNDED * sections.SMALL_RATE:
        raise InputError(
            f"small_rates contains {degrees(largest):g} °/s, but a small rate is at most "
            f"{degrees(sections.SMALL_RATE):g} °/s",
            key="[method] small_rates",
        )
    if positions not in _SETTINGS:
        raise InputError(
            f"positions is {positions}, but it must be 3 (each axis up) or 6 (each axis up and "
            "down)",
            key="[method] positions",
        )
    if attitudes not in _POSES:
        raise InputError(
            f"attitudes is {attitudes!r}, but the poses must be {', '.join(_POSES)}",
            key="[method] attitudes",
        )
    of_setting = _rates_of_setting(rates, reverse)
    least = max(sections.SMALL_RATE, 10 * largest) / _ROUNDED
    centres = sorted(rate for rate in rates if rate > least)[:1]
    for centre in (0.0, *centres) if small_rates else ():
        of_setting += [centre + change for change in small_loop(small_rates)]
    dwells = [(axis, rate) for axis in _SETTINGS[positions] for rate in of_setting]
    names = number_repeated_names([sections.dwell_label(axis, rate) for axis, rate in dwells])
    turns = [
        sections.RateDwell(name, axis, rate, sections.whole_turns(rate, seconds))
        for name, (axis, rate) in zip(names, dwells, strict=True)
    ]
    angles = [(roll * pi / 180, pitch * pi / 180) for roll, pitch in _POSES[attitudes]]
    return (*turns, *(sections.Pose(sections.pose_label(*each), *each, seconds) for each in angles))


def _rates_of_setting(rates: tuple[float, ...], reverse: bool) -> list[float]:
    """Return the rates of one setting in order, including rests."""
    if not rates:
        return [0.0]
    if not reverse:
        return [0.0, *(signed for rate in rates for signed in (rate, -rate)), 0.0]
    through = [*rates, *rates[-2::-1]]
    return [0.0, *through, 0.0, *(-rate for rate in through), 0.0]


def readings_without_input(sensor: Sensor, bench: RatePlatform, steps: PlatformSteps) -> Bools:
    """Return which readings have no nominal input, (r m,), row after row.

    In a pose a gyro senses only the earth's rate, whose level part is unknown, so it has no nominal
    input.
    """
    motion = bench.mean_motion(steps, {}).motion
    dwells = np.array([isinstance(step, sections.RateDwell) for step in steps])
    inputs = {"f": motion.f / G0, "w": motion.w * dwells[:, None]}
    sensed = [inputs[axis.measures] @ np.array(axis.i) for axis in sensor.axes]
    return (np.abs(np.stack(sensed, axis=-1)) < _NOTHING).ravel()


def without_signs(whole: Problem, sensor: Sensor, unsigned: Bools) -> Problem:
    """Return the problem without sign-dependent terms in some readings.

    Parameters
    ----------
    whole : Problem
        Problem with m observations; the sensor's coefficients are its first parameters.
    sensor : Sensor
    unsigned : (m,) array of bool
        The readings without a nominal input.
    """
    terms = [
        k
        for k, name in enumerate(sensor.coefficients)
        if sensor.coefficient(name).basis.uses("si", "swi")
    ]
    if not terms or not unsigned.any():
        return whole

    def linearise(x: Array) -> tuple[Array, Array]:
        residual, jacobian = whole.linearise(x)
        without = x.copy()
        without[..., terms] = 0.0
        plain, slope = whole.linearise(without)
        slope[..., terms] = 0.0
        return np.where(unsigned, plain, residual), np.where(unsigned[:, None], slope, jacobian)

    return replace(whole, linearise=linearise, normal_equations=None)


def least_squares_line(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: PlatformSteps,
    used: Indices,
) -> Estimate:
    """Return the least-squares coefficients, with the noise of the means propagated.

    Parameters
    ----------
    observations : Observations
        Observations from r rows and m axes, without a trial axis.
    sensor : Sensor
        Sensor in the reference form, whose readings are linear in its p coefficients.
    bench : RatePlatform
    steps : sequence of r RateDwell or Pose
    used : (k,) array of int
        Indices of the readings that are used, row after row.
    """
    nominal = bench.mean_motion(steps, {}).motion
    motion = Motion(nominal.f, nominal.w)
    p = len(sensor.coefficients)
    none = np.zeros(p)
    design = sensor.design(motion, none).reshape(-1, p)[used]
    off = (observations.mean - sensor.forward(motion, none)).ravel()[used]
    inverse = np.linalg.pinv(design / sensor.unit_scale) / sensor.unit_scale[:, None]
    noise = observations.full_covariance[np.ix_(used, used)]
    spread = inverse @ noise @ inverse.T
    return noise_only_estimate(sensor, inverse @ off, spread)


def ml(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: PlatformSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the estimate from all readings except accelerometer readings while the table turns.

    Parameters
    ----------
    observations : Observations
        One row per section, (..., r, m) SI.
    sensor : Sensor
        Accelerometers, gyros or both, with the coefficients to estimate.
    bench : RatePlatform
    steps : sequence of RateDwell or Pose
        The steps; planned steps that have no row are ignored.
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        Rows and steps do not match, or a relevant error of the bench is not stated.
    NotObserved
        These sections do not determine all coefficients; the message names them.
    """
    observations = observations.without_drift
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels if label in by_label]
    solving.require_matching_rows(observations, sensor, done)
    declared, suspects = bench.nuisances(done, sensor), bench.suspects(done, sensor)
    _refuse_profiles(sensor, done)
    used = _used_readings(sensor, done)
    require_determined(observations, sensor, bench, done, priors, used)
    unsigned = readings_without_input(sensor, bench, done)

    def problem(some: Observations, own: Priors) -> Problem:
        whole = mean_problem.problem_of_readings(
            some,
            sensor,
            declared,
            lambda q: bench.mean_motion(done, q),
            own,
            with_drift_candidate=True,
            zero_input=unsigned,
            families=_turn_on_family(suspects),
            suspects=suspects,
        )
        return mean_problem.row_subset(without_signs(whole, sensor, unsigned), used)

    estimate = solving.solve(observations, priors, problem)
    require_observed(estimate, sensor, missing=())
    return replace(estimate, tests=observations.tests)


def ieee(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: PlatformSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the least-squares estimate with equal weights; arguments as for `ml`, exact bench.

    Raises
    ------
    InputError
        The same as for `ml`; or there are priors, temperature coefficients, the tilted form or a
        trial axis.
    NotObserved
        The same as for `ml`.
    """
    solving.require_plain_means(observations, sensor, priors, "ieee")
    solving.refuse_tilted_form(sensor, "ieee", "ml")
    by_problem = ml(observations, sensor, bench, steps)
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels]
    line = least_squares_line(observations, sensor, bench, done, _used_readings(sensor, done))
    return with_problem_tests(line, by_problem)


def _turn_on_family(suspects: Mapping[str, Parameter]) -> dict[str, tuple[str, ...]]:
    """Return the gyro biases that differ between settings, as one candidate and separately."""
    result: dict[str, tuple[str, ...]] = {}
    for full in suspects:
        name = ErrorName(full)
        if name.name.startswith("turn_on"):
            for kind in ("turn_on", name.vector):
                result[kind] = (*result.get(kind, ()), full)
    return result


def _used_readings(sensor: Sensor, steps: PlatformSteps) -> Indices:
    """Return the indices of the readings that are used, row after row."""
    turning = np.array([isinstance(step, sections.RateDwell) and step.rate != 0 for step in steps])
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    return np.flatnonzero(~(turning[:, None] & forces))


def _refuse_profiles(sensor: Sensor, steps: PlatformSteps) -> None:
    """Reject nonlinear terms for turns by an angle: the mean rate does not determine its square."""
    terms = tuple(
        name for name in sensor.coefficients if CoefficientName(name).term in ("scale2", "scale3")
    )
    if terms and any(isinstance(step, sections.KnownTurn) for step in steps):
        raise InputError(
            f"[method] {', '.join(terms)}: a turn by an angle has no constant rate, so its "
            "mean does not determine these coefficients; remove them, or turn only at constant "
            "rates",
            key="[method]",
            names=terms,
        )


METHOD = Method(
    name="rates_and_poses",
    bench=RatePlatform,
    default_coefficients={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "scale", "misalignment"),
    },
    also={
        "f": ("nonlinearity", "asymmetry", "cross", "temperature", "temperature_order"),
        "w": ("nonlinearity", "asymmetry", "g", "g2", "temperature", "temperature_order"),
    },
    needs=(),
    plan=plan,
    estimators={"ml": ml, "ieee": ieee},
    closed_formulas=("ieee",),
    constant_rates=True,
    weighs_common_errors=True,
    source="IEEE Std 952 and 1431, rate tests; IEEE Std 1293, multipoint tests",
)
