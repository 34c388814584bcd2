"""Tumble test: accelerometers are read at n positions of a dividing head in gravity.

The spindle is horizontal and the output axis lies along it. At the spindle angle θ the input axis
senses g sin θ and the pendulous axis g cos θ. At 0°, 90°, 180°, 270° the input axis is level, up,
level, down. With s = sin θ, c = cos θ the reading is::

    y = K₀ + (1 + k₁) g s + δ_O g c + K₂ g² s² + K_ip g² s c + K₃ g³ s³
      = A₀ + S₁ sin θ + C₁ cos θ + S₂ sin 2θ + C₂ cos 2θ + S₃ sin 3θ

One tumble observes, with s² = (1 − cos 2θ)/2, s c = sin 2θ / 2, s³ = (3 sin θ − sin 3θ)/4::

    A₀ = K₀ + K₂ g²/2            C₁ = δ_O g          C₂ = −K₂ g²/2
    S₁ = (1 + k₁ + ¾ K₃ g²) g    S₂ = K_ip g²/2      S₃ = −K₃ g³/4

* The mean contains K₀ + K₂ g²/2 and the sine k₁ + ¾ K₃ g². Only the second harmonic separates K₂,
  and only the third K₃: K₀ = A₀ + C₂, k₁ = (S₁ + 3 S₃)/g − 1. At the four cardinal positions
  s³ = s, so only k₁ + K₃ g² can be determined. K_ip is the sine of 2θ and affects no other
  coefficient.
* g cannot be separated from the scale factor, so its relative uncertainty is an uncertainty of k₁.
* s² + c² = 1, so K_pp cannot be separated from K₀ and K₂. Output-axis terms are not observed.

To first order, an error ε(θ) = ε₀ + Σ a_h sin hθ + b_h cos hθ of the head's angle adds g c ε to
the reading. From products of sines and cosines it follows that::

    ε₀          C₁ by g ε₀                      δ_O by ε₀: a constant error looks like δ_O
    a₁ sin θ    S₂ by g a₁/2                    K_ip by a₁/g
    b₁ cos θ    A₀ and C₂ by g b₁/2             K₀ by g b₁, K₂ by −b₁/g    (c² = 1 − s²)
    a₂ sin 2θ   S₁ and S₃ by g a₂/2             k₁ by 2 a₂, K₃ by −2 a₂/g² (2 s c² = 2 s − 2 s³)
    b₂ cos 2θ   C₁ (and C₃) by g b₂/2           δ_O by b₂/2
    a₃ sin 3θ   S₂ (and S₄) by g a₃/2           K_ip by a₃/g
    b₃ cos 3θ   C₂ (and C₄) by g b₃/2           K₀ by g b₃/2, K₂ by −b₃/g
    a₄ sin 4θ   S₃ (and S₅) by g a₄/2           k₁ by 3 a₄/2, K₃ by −2 a₄/g²
    b₄ cos 4θ   C₃ and C₅ by g b₄/2             nothing

Higher harmonics have no effect unless n positions fold harmonic h ± 1 onto a lower one. None of the
errors in the first four lines shows in the residuals. A white error σ adds (σ dy/dθ)² to the
variance of a reading, approximately (σ g c)². Second-order effects of angles, −σ²/2 on k₁, are
neglected: 1e-10 at 3″.

The reference form is linear in its coefficients, and `fourier` and `least_squares` are exact for
it. A sensor whose case is rotated by δ reads sin(θ + δ). In the reference form k₁ then has an error
of −δ²/2, and each other coefficient has an error of its product with δ. In the tilted form the
coefficients of the input axis have neither error.

Source: IEEE Std 1293, static multipoint (tumble) test.
"""

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.benches.dividing_head.bench import (
    DividingHead,
    bench_covariance,
    reading_sensitivities,
    sensed_motion,
)
from inercal.benches.dividing_head.passes import SAME_ANGLE, TILT
from inercal.benches.dividing_head.passes import evenly_spaced_angles as even_angles
from inercal.estimation import Estimate
from inercal.estimation.uncertainty import value_and_jacobian
from inercal.methods import Method, Priors, dividing_head_problem, solving
from inercal.methods import tumble_harmonics as harmonics
from inercal.methods.dual_orthogonal import notes as notes_on_sums
from inercal.methods.observability import require_observed
from inercal.methods.order_effects import with_tests
from inercal.physics.motion import Motion
from inercal.physics.plan import Index, Indexings, small_loop
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

_FEWEST_TILTS = 2  # on each side
_MAX_ANGLE_CORRECTION = 0.01  # rad, from a stated to the evenly spaced angle, in `fourier`
# Each iteration reduces the error at least by the factor `_MAX_ANGLE_CORRECTION`.
_CORRECTION_ITERATIONS = 6
_ROUNDING_LIMIT = 1e-12  # relative to g


def least_squares(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return the estimate with the sensor's exact model, in either form and at any positions.

    Gravity, angles and drift are nuisances with the bench's deviations as priors.

    Parameters
    ----------
    observations : Observations
        One row per position, (..., r, m) in SI.
    sensor : Sensor
        m accelerometers with O along z, with the coefficients to estimate.
    bench : DividingHead
    steps : sequence of r Index
        The steps of the rows.
    priors : sequence of Gaussian
        Priors on coefficients, from other measurements.

    Raises
    ------
    InputError
        There is a gyro or an axis with another output axis, readings of another axis, no
        coefficient, fewer than four different positions, steps that do not match the rows, two
        steps with the same label, or a row without noise.
    NotObserved
        These positions do not determine all coefficients; the message names them and the harmonics
        that fold.
    """
    angle = _checked_angles(observations, sensor, steps)
    try:
        estimate = solving.solve(
            observations,
            priors,
            lambda some, own: dividing_head_problem.head_problem(some, sensor, bench, steps, own),
        )
        require_observed(estimate, sensor, missing=())
    except NotObserved as error:
        raise harmonics.not_observed_error(
            sensor, error.directions, angle, "give a prior"
        ) from None
    notes = (*harmonics.folding_notes(angle), *notes_on_sums(estimate, bench, priors))
    return replace(estimate, notes=(*notes, *estimate.notes))


def fourier(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return k0, k1, delta_o, k2, kip and k3, as selected, by closed formulas from harmonics.

    All readings have equal weight, including those near level, where angle errors have the largest
    effect. A white error can therefore increase the uncertainty of k2 by a factor √2 compared with
    `least_squares`. The uncertainties due to noise, drift, angles and gravity are propagated. If
    the level, autocollimator or certificate states a difference from the evenly spaced angle, the
    reading is corrected for it along the fitted curve. Coefficients that are not selected are
    assumed to be zero. The arguments are as for `least_squares`, with one recording and without
    priors.

    Raises
    ------
    InputError
        The same as for `least_squares`; or positions are not evenly spaced, not visited equally
        often, or too far from evenly spaced angles; or there are priors, the tilted form, or other
        coefficients.
    NotObserved
        Harmonics fold; the message names their coefficients and says which harmonic folds onto
        which.
    """
    solving.refuse_priors(priors, "fourier", "least_squares")
    solving.require_single_recording(observations, "estimator fourier")
    angle = _checked_angles(observations, sensor, steps)
    terms = [CoefficientName(name).term for name in sensor.coefficients]
    if others := tuple(
        n for n, term in zip(sensor.coefficients, terms, strict=True) if term not in harmonics.TERMS
    ):
        raise InputError(
            f"estimator fourier estimates {', '.join(harmonics.TERMS)}, but not "
            f"{', '.join(others)}; use estimator least_squares, or leave the others out",
            key="[method]",
            names=others,
        )
    solving.refuse_tilted_form(sensor, "fourier", "least_squares")
    if [axis.i for axis in sensor.axes] != [(1.0, 0.0, 0.0)]:
        raise InputError(
            "estimator fourier needs a single accelerometer along x; use estimator least_squares",
            key="[method] estimator",
            names=sensor.channels,
        )
    harmonics.require_even_spacing(angle)
    matrix = harmonics.harmonic_basis(angle, harmonics.harmonic_names(terms))
    harmonics.require_distinct_harmonics(sensor, terms, matrix, angle)
    sums = matrix / np.sum(matrix**2, axis=0)

    def formulas(x: Array) -> Array:
        # Gravity is an argument, so its uncertainty is propagated together with the others.
        values: list[Array] = []
        for row in x.reshape(-1, x.shape[-1]):
            to_term, add = harmonics.amplitude_map(terms, float(row[-1]))
            values.append(to_term @ (row[:-1] @ sums) + add)
        return np.stack(values).reshape(*x.shape[:-1], len(terms))

    y, f = observations.mean[:, 0], sensed_motion(bench, steps, {}).f
    even = _force_at_even_angles(bench, steps, f)
    x = np.append(y, bench.gravity.value)
    value = formulas(x)
    if np.abs(f - even).max() > _ROUNDING_LIMIT * G0:
        for _ in range(_CORRECTION_ITERATIONS):
            there, here = (sensor.forward(Motion(at), value)[:, 0] for at in (f, even))
            x[:-1] = y - (there - here)
            value = formulas(x)
    spread = np.zeros((len(x), len(x)))
    noise = dividing_head_problem.with_drift_covariance(observations, bench, steps).full_covariance
    spread[:-1, :-1] = noise + bench_covariance(sensor, bench, steps, value, gravity=False)
    spread[-1, -1] = bench.gravity.sd**2
    value, gain = value_and_jacobian(formulas, x, spread)
    covariance = gain @ spread @ gain.T
    columns = reading_sensitivities(sensor, bench, steps, value)
    moved = {name: -gain[:, :-1] @ column for name, column in columns.items()}
    variance = np.linalg.eigvalsh(covariance / np.outer(sensor.unit_scale, sensor.unit_scale))
    singular = 1 / np.sqrt(variance)
    estimate = Estimate.from_closed_form(sensor.coefficients, value, covariance, singular)
    estimate = with_tests(
        estimate, dividing_head_problem.head_problem(observations, sensor, bench, steps)
    )
    return replace(
        estimate, notes=harmonics.folding_notes(angle), sensitivities=moved | {"g": gain[:, -1]}
    )


def _nominal_angles(steps: Indexings) -> Array:
    """Return the evenly spaced angles of the steps, (r,) rad, or the stated angles if uneven."""
    grid = even_angles(steps)
    return np.array([step.angle for step in steps]) if grid is None else grid


def _force_at_even_angles(bench: DividingHead, steps: Indexings, f: Array) -> Array:
    """Return the force at the nominal angles, given the force f at the stated ones, (r, 3) m/s².

    Raises
    ------
    InputError
        A position is more than 0.57° from its evenly spaced angle.
    """
    plain = [
        replace(step, angle=float(a), level=0.0, reading=0.0)
        for a, step in zip(_nominal_angles(steps), steps, strict=True)
    ]
    even = sensed_motion(DividingHead(bench.gravity), plain, {}).f
    away = np.linalg.norm(f - even, axis=-1) / bench.gravity.value
    worst = int(np.argmax(away))
    if away[worst] > _MAX_ANGLE_CORRECTION:
        raise InputError(
            f"position {steps[worst].label} is {np.degrees(away[worst]):.3g}° from its nominal "
            "angle, but estimator fourier corrects at most "
            f"{np.degrees(_MAX_ANGLE_CORRECTION):.2g}°; use estimator least_squares",
            names=(steps[worst].label,),
        )
    return even


def _checked_angles(observations: Observations, sensor: Sensor, steps: Indexings) -> Array:
    """Return the nominal angle of each row, (r,) rad, after checks of the observations."""
    for axis in sensor.axes:
        output = axis.frame[2]
        if axis.measures != "f" or not np.allclose(output, (0.0, 0.0, 1.0)):
            found = "is a gyro" if axis.measures == "w" else f"has it along {output.tolist()}"
            raise InputError(
                "a tumble test needs accelerometers with their output axes along the spindle, z, "
                f"but {axis.name} {found}",
                key="[sensor]",
                names=sensor.channels,
            )
    if not sensor.coefficients:
        raise InputError(
            f"sensor {sensor.name} has no coefficients to estimate; choose coefficients",
            key="[method]",
        )
    solving.require_matching_rows(observations, sensor, steps)
    variance = np.linalg.diagonal(observations.covariance)
    positive = (variance > 0).all(axis=-1).reshape(-1, len(observations.labels)).all(axis=0)
    if not positive.all():
        label = observations.labels[int(np.argmin(positive))]
        raise InputError(
            f"the reading at {label} has no positive variance; state the variance of every reading",
            key="observations",
            names=(label,),
        )
    angle = _nominal_angles(steps)
    n = len(harmonics.distinct_angles(angle)[0]) if len(angle) else 0
    if n < dividing_head_problem.MIN_POSITIONS:
        raise InputError(
            f"the steps have {n} different positions, but a tumble test needs "
            f"{dividing_head_problem.MIN_POSITIONS} or more; add positions",
            key="steps",
        )
    return angle


def plan(
    positions: int = 12,
    reverse: bool = True,
    seconds: float = 60.0,
    small_tilts: tuple[float, ...] = (),
    warm_up: int = 0,
) -> tuple[Index, ...]:
    """Return evenly spaced positions of the head, forward and back, followed by small tilts.

    Parameters
    ----------
    positions, reverse, seconds, warm_up
        The same as for `inercal.methods.dividing_head_problem.plan`.
    small_tilts : tuple of float
        Tilts, rad, all positive. The head goes through them in a loop about 30°, where the input is
        g/2, and about 0°, where it is zero. The loops show resolution and threshold.

    Raises
    ------
    InputError
        There are fewer than four positions or small tilts, or a tilt is not between 0.02″ and 0.5°.
    """
    steps = list(dividing_head_problem.plan(positions, reverse, seconds, warm_up))
    if not small_tilts:
        return tuple(steps)
    if len(set(small_tilts)) < _FEWEST_TILTS or not all(SAME_ANGLE < t < TILT for t in small_tilts):
        raise InputError(
            f"small_tilts needs {_FEWEST_TILTS} or more different tilts between 0.02″ and 0.5°",
            key="[method] small_tilts",
        )
    for name, centre in (("m", pi / 6), ("n", 0.0)):
        loop = small_loop(small_tilts)
        senses = [1, *(1 if after > before else -1 for before, after in pairwise(loop))]
        steps += [
            Index(f"{name}{k:02d}", centre + tilt, -1 if sense < 0 else 1, seconds=seconds)
            for k, (tilt, sense) in enumerate(zip(loop, senses, strict=True), start=1)
        ]
    return tuple(steps)


METHOD = Method(
    name="tumble",
    bench=DividingHead,
    default_coefficients={"f": harmonics.TERMS},
    also={"f": ("temperature",)},
    needs=("f",),
    plan=plan,
    estimators={"least_squares": least_squares, "fourier": fourier},
    closed_formulas=("fourier",),
    weighs_common_errors=True,
    remarks=dividing_head_problem.remarks,
    source="IEEE Std 1293, static multipoint (tumble) test",
)
