"""Fit all rests and turns by generalised least squares, with Gauss–Newton steps.

The covariance of the rows is computed once, at the initial attitudes. A step changes coefficients,
lag and attitudes together. Steps are repeated until they are below a thousandth of a standard
deviation.

Rules name the coefficients that no sequence of turns between rests determines. An error
message names these coefficients before the estimation starts. The code uses rules instead
of the rank, because the apparent information about a gauge is only noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import cos, degrees, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.basics.parameters import Parameter
from inercal.benches.turntable.bench import StillTable
from inercal.estimation import Candidate, Estimate, Gaussian, Problem
from inercal.estimation.fitting import estimate_at_solution
from inercal.estimation.nullspace import observability
from inercal.estimation.whitened_problem import LinearisationPoint, WhitenedProblem
from inercal.methods import Priors
from inercal.methods.candidates import candidates_from_columns, extended_sensor, prior_candidates
from inercal.methods.systematic.alignment import attitudes_at, initial_attitudes
from inercal.methods.systematic.navigation import ImuModel
from inercal.methods.systematic.rest_and_turn_rows import TURN_UNITS, RestAndTurnRows
from inercal.methods.systematic.segments import Segments
from inercal.physics.frames import exp_so3, log_so3
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

# The body frame: ax along x, ay in the xy plane
FRAME = ("ax.delta_o", "ax.delta_p", "ay.delta_o")
COMMON_ARM = ("az.arm_i", "az.arm_p", "az.arm_o")
_CUBE = cos(radians(15))  # at a face of the cube, the unit force has a larger component
_FACE = 0.5 * G0
_LEAST_TURN = radians(45)  # total turn about an axis
# Terms that equal another term if |f| is gravity or zero
_ALIKE = {"k1_prime": "k2", "k3": "k1"}


def require_determined(sensor: Sensor, observations: Observations, priors: Priors) -> None:
    """Raise an error if these rests and the priors cannot determine the coefficients.

    Parameters
    ----------
    sensor : Sensor
        The sensor with the selected coefficients.
    observations : Observations
        One row for each rest.
    priors : sequence of Gaussian

    Raises
    ------
    NotObserved
        The rotation of the body frame or a common lever arm is free, or all rests are at faces of a
        cube and even-order terms are free.
    InputError
        An axis has no rest upwards or downwards.
    """
    known = {name for prior in priors for name in prior.names}
    chosen = [name for name in sensor.coefficients if name not in known]
    _refuse_gauge(
        chosen,
        FRAME,
        "rotation of the body frame",
        "no observation fixes the frame to which the misalignments of accelerometers and gyros "
        "refer, so choose nonorthogonality (ax along x, ay in the xy plane)",
    )
    _refuse_gauge(
        chosen,
        COMMON_ARM,
        "common arm",
        "the data do not determine where the common point of all three accelerometers is, "
        "because its velocity is zero at both ends of a turn; choose ax.arm and ay.arm, which "
        "are relative to az",
    )
    force = observations.mean[:, [axis.measures == "f" for axis in sensor.axes]]
    _require_both_faces(sensor, force)
    largest = np.abs(force).max(axis=1) / np.linalg.norm(force, axis=1)
    if (largest < _CUBE).any():
        return
    names = tuple(n for n in chosen if CoefficientName(n).term in _ALIKE)
    if names:
        partners = [
            f"{axis}.{_ALIKE[term]}" for axis, term in (CoefficientName(n).parts for n in names)
        ]
        raise NotObserved(
            f"all rests are within 15° of the faces of a cube, where {', '.join(names)} cannot "
            f"be distinguished from {partners[0]} (forces are gravity or zero); add rests at "
            "45°, or give a prior ([method.prior])",
            tuple(f"{name} and {other}" for name, other in zip(names, partners, strict=True)),
            names=names,
        )


def require_turns(attitudes: Array, sensor: Sensor, priors: Priors) -> None:
    """Raise NotObserved if gyro coefficients need turns about a body axis and there are none.

    Parameters
    ----------
    attitudes : (m, 3, 3) array
        C, body to n, at each rest.
    sensor : Sensor
    priors : sequence of Gaussian

    Raises
    ------
    NotObserved
        The message names the scale factor and the misalignments that sense that axis.
    """
    known = {name for prior in priors for name in prior.names}
    turned = np.abs(log_so3(attitudes[:-1].mT @ attitudes[1:])).sum(axis=0)
    names: list[str] = []
    for axis in (axis for axis in sensor.axes if axis.measures == "w"):
        for term, direction in zip(("scale", "delta_o", "delta_p"), axis.frame, strict=True):
            about = int(np.abs(direction).argmax())
            name = f"{axis.name}.{term}"
            if turned[about] < _LEAST_TURN and name in sensor.coefficients and name not in known:
                names.append(name)
    if names:
        still = [f"{axis} ({degrees(a):.0f}°)" for axis, a in zip("xyz", turned, strict=True)
                 if a < _LEAST_TURN]  # fmt: skip
        raise NotObserved(
            f"the path does not turn about body axis {' and '.join(still)}, so the data do not "
            f"determine {', '.join(names)}; add quarter turns about that axis while it is "
            "level, or give priors",
            tuple(names),
            names=tuple(names),
        )


def _refuse_gauge(chosen: Sequence[str], gauge: Sequence[str], what: str, reason: str) -> None:
    names = tuple(name for name in gauge if name in chosen)
    if names:
        raise NotObserved(
            f"{', '.join(names)}: {what} cannot be determined; {reason}", (what,), names=names
        )


def _require_both_faces(sensor: Sensor, force: Array) -> None:
    for k, axis in enumerate(axis for axis in sensor.axes if axis.measures == "f"):
        for way, reached in (("up", force[:, k].max()), ("down", -force[:, k].min())):
            if reached < _FACE:
                raise InputError(
                    f"{axis.name} is never turned {way} (it reads at most {reached / G0:.2f} g "
                    "that way), but bias and scale need both faces of each axis; add a rest "
                    f"with it {way}",
                    names=(axis.name,),
                )


LAG = "lag"
_LARGEST_STEP = 0.001  # standard deviations
_SURE_STEP = 0.1  # standard deviations; a smaller step needs no test
_HALVINGS = 8  # largest number of halvings of a step until χ² decreases
_MOST_STEPS = 60
_SCALES = {LAG: 1.0, "g": 1.0, "latitude": 1.0}  # s, m/s², rad


def attitude_names(labels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the attitude corrections ψ, such as "attitude_east[p1]"."""
    return tuple(f"attitude_{way}[{label}]" for label in labels for way in ("east", "north", "up"))


def estimated_attitudes(
    estimate: Estimate, segments: Segments, sensor: Sensor, latitude: float
) -> Array:
    """Return C, body to n, at each rest according to an estimate, (m, 3, 3).

    Parameters
    ----------
    estimate : Estimate
    segments, sensor
        The same as for `solve`.
    latitude : float
        Latitude, rad.
    """
    start, _ = _start(segments, sensor, latitude)
    names = attitude_names(segments.labels)
    if names[0] not in estimate.names:  # from the filter, which estimates no attitude per rest
        found = estimate.value[: len(sensor.coefficients)]
        return attitudes_at(segments, ImuModel(sensor), found, latitude)
    at = [estimate.names.index(name) for name in names]
    return exp_so3(estimate.value[at].reshape(-1, 3)) @ start


def _start(segments: Segments, sensor: Sensor, latitude: float) -> tuple[Array, Array]:
    """Return C at each rest and the coefficients at which the search starts."""
    nominal = np.zeros(len(sensor.coefficients))
    return initial_attitudes(segments, ImuModel(sensor), nominal, latitude)


def solve(segments: Segments, sensor: Sensor, known: StillTable, priors: Priors = ()) -> Estimate:
    """Return the estimate from one recording.

    Parameters
    ----------
    segments : Segments
    sensor : Sensor
        Three accelerometers, then three gyros, with noise and the selected coefficients.
    known : StillTable
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        The latitude is beyond 85°, or the axes do not fit together.
    NotObserved
        These rests and turns do not determine all coefficients.
    """
    model = ImuModel(sensor)
    m = len(segments.labels)
    attitudes, c = _start(segments, sensor, known.latitude.value)
    require_turns(attitudes, sensor, priors)
    rows = RestAndTurnRows(segments, model, attitudes, known.gravity.value, known.latitude.value)
    whole = np.concatenate([c, [0.0, known.gravity.value, known.latitude.value], np.zeros(3 * m)])
    declared = known.nuisances((), sensor)
    names = (*sensor.coefficients, LAG, *declared, *attitude_names(segments.labels))
    exact = {name for name, q in declared.items() if not q.sd > 0}
    free = [k for k, name in enumerate(names) if name not in exact]
    stated = [
        Gaussian.independent((q.name,), [q.value], [q.sd])
        for q in declared.values()
        if q.name not in exact
    ]

    def filled(x: Array) -> Array:
        full = whole.copy()
        full[free] = x
        return full

    def linearise(x: Array) -> tuple[Array, Array]:
        residual, jacobian = rows.linearise(filled(x))
        return residual, jacobian[:, free]

    scale = np.concatenate(
        [sensor.unit_scale, [_SCALES[name] for name in (LAG, *declared)], np.ones(3 * m)]
    )[free]

    def problem(start: Array) -> Problem:
        return Problem(
            names=tuple(names[k] for k in free),
            start=start,
            linearise=linearise,
            noise=covariance,
            scale=scale,
            priors=(*priors, *stated),
            wanted=sensor.coefficients,
            observations=rows.labels,
            correlated=True,
            candidates=lambda x: [
                *omitted_coefficients(rows, filled(x), declared),
                *prior_candidates(
                    sensor,
                    [names[k] for k in free],
                    priors,
                    dict(zip(names, rows.linearise(filled(x))[1].T, strict=True)),
                ),
            ],
        )

    covariance = rows.covariance(whole)
    system = WhitenedProblem(problem(whole[free]))
    observability(system, system.first)  # raises NotObserved before any step
    x, converged, steps = _search(system)
    system = WhitenedProblem(problem(x))
    structure = observability(system, system.first)
    return estimate_at_solution(
        system, system.first, structure, np.array([converged]), np.array([steps])
    )


def _search(system: WhitenedProblem) -> tuple[Array, bool, int]:
    """Return the solution, whether the steps became small, and the number of steps."""
    point, scale = system.first, system.problem.scale
    inverse, tried = system.first_whitener, system.first
    for count in range(1, _MOST_STEPS + 1):
        # Columns are scaled to unit length: azimuth and bias differ by ten orders of magnitude.
        rows = np.concatenate([point.weight[0][:, None] * point.rows[0], system.prior_rows])
        right = np.concatenate([point.whitened[0], point.prior[0]])
        size = np.linalg.norm(rows, axis=0)
        size[size == 0] = 1.0 / scale[size == 0]
        q, r = np.linalg.qr(rows / size)
        back = np.linalg.inv(r)
        step = back @ (q.T @ right)
        sd = np.linalg.norm(back, axis=1)
        largest = float(np.abs(step / sd).max())
        if not np.isfinite(largest):
            return point.x[0], False, count
        for _ in range(_HALVINGS):
            x = point.x + step / size
            tried = system.point(x, *system.evaluate(x), inverse)
            if largest < _SURE_STEP or _cost(tried) < _cost(point):
                break
            step, largest = 0.5 * step, 0.5 * largest
        point = tried
        if largest < _LARGEST_STEP:
            return point.x[0], True, count
    return point.x[0], False, _MOST_STEPS


def _cost(point: LinearisationPoint) -> float:
    """Return χ² for observations and priors; infinite if the point is far from the solution."""
    cost = float(np.sum(point.whitened**2) + np.sum(point.prior**2))
    return cost if np.isfinite(cost) else np.inf


def omitted_coefficients(
    rows: RestAndTurnRows, x: Array, declared: Mapping[str, Parameter]
) -> list[Candidate]:
    """Return the candidates for score tests: parameters not estimated, and single rows.

    Parameters
    ----------
    rows : RestAndTurnRows
    x : array
        The solution for all parameters.
    declared : mapping of str to Parameter
        Stated gravity and latitude.
    """
    sensor, p = rows.model.sensor, rows.count
    extended = extended_sensor(sensor)
    # The accelerometers' coefficients come before the gyros'.
    ordered = extended.with_coefficients(*extended.coefficients)
    larger = replace(rows, model=ImuModel(ordered))
    values = dict(zip(sensor.coefficients, x[:p].tolist(), strict=True))
    names = larger.model.sensor.coefficients
    at = np.concatenate([[values.get(name, 0.0) for name in names], x[p:]])
    _, jacobian = larger.linearise(at)
    # Gauges turn the frame or move its origin and explain no residual, but the verdict lists them.
    column = {name: jacobian[:, k] for k, name in enumerate(names)}
    q = len(names)
    column |= {"g": jacobian[:, q + 1], "latitude": jacobian[:, q + 2]}
    return candidates_from_columns(
        rows.labels, sensor, sensor.coefficients, declared, column, further_units=TURN_UNITS
    )
