"""Tumble test of one accelerometer: n positions of a dividing head in the field of gravity.

The spindle is horizontal and the output axis lies along it. At the angle θ of the spindle the
input axis feels g sin θ and the pendulous axis g cos θ: at 0°, 90°, 180°, 270° the input axis is
level, up, level, down. With s = sin θ, c = cos θ the reading is::

    y = K₀ + (1 + k₁) g s + δ_O g c + K₂ g² s² + K_ip g² s c + K₃ g³ s³
      = A₀ + S₁ sin θ + C₁ cos θ + S₂ sin 2θ + C₂ cos 2θ + S₃ sin 3θ

What one tumble sees, by s² = (1 − cos 2θ)/2, s c = sin 2θ / 2, s³ = (3 sin θ − sin 3θ)/4::

    A₀ = K₀ + K₂ g²/2            C₁ = δ_O g          C₂ = −K₂ g²/2
    S₁ = (1 + k₁ + ¾ K₃ g²) g    S₂ = K_ip g²/2      S₃ = −K₃ g³/4

* The mean holds K₀ + K₂ g²/2 and the sine k₁ + ¾ K₃ g²; K₂ separates through the second harmonic
  alone, K₃ through the third: K₀ = A₀ + C₂, k₁ = (S₁ + 3 S₃)/g − 1. On the four cardinal positions
  s³ = s: only k₁ + K₃ g² is left. K_ip is the sine of 2θ and disturbs nothing else.
* g is not told from the scale factor: its relative uncertainty is one of k₁.
* s² + c² = 1: K_pp is not told from K₀ and K₂. What acts along the output axis is not seen at all.

What an error ε(θ) = ε₀ + Σ a_h sin hθ + b_h cos hθ of the head's angle does to first order: it adds
g c ε to the reading (that is by products of sines and cosines)::

    ε₀          C₁ by g ε₀                      δ_O by ε₀: a constant error looks like δ_O
    a₁ sin θ    S₂ by g a₁/2                    K_ip by a₁/g
    b₁ cos θ    A₀ and C₂ by g b₁/2             K₀ by g b₁, K₂ by −b₁/g    (c² = 1 − s²)
    a₂ sin 2θ   S₁ and S₃ by g a₂/2             k₁ by 2 a₂, K₃ by −2 a₂/g² (2 s c² = 2 s − 2 s³)
    b₂ cos 2θ   C₁ (and C₃) by g b₂/2           δ_O by b₂/2
    a₃ sin 3θ   S₂ (and S₄) by g a₃/2           K_ip by a₃/g
    b₃ cos 3θ   C₂ (and C₄) by g b₃/2           K₀ by g b₃/2, K₂ by −b₃/g
    a₄ sin 4θ   S₃ (and S₅) by g a₄/2           k₁ by 3 a₄/2, K₃ by −2 a₄/g²
    b₄ cos 4θ   C₃ and C₅ by g b₄/2             nothing

Higher ones do nothing until n positions fold harmonic h ± 1 onto a lower one. None of the first
four lines shows in the residuals. A white error σ adds (σ dy/dθ)² to the variance of a reading,
nearly (σ g c)², and harmonics of stated deviation add covariance between rows. What angles do to
second order, k₁ by −σ²/2, is left out: 1e-10 at 3″.

The reference form is linear in its coefficients, and `fourier` and `least_squares` are exact for
it. A sensor whose case is turned by δ reads sin(θ + δ): in the reference form k₁ then is off by
−δ²/2 and other coefficients by their products with δ; the tilted form has neither error in what
acts along the input axis.

Source: IEEE Std 1293, static multipoint (tumble) test.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian, Problem
from inercal.estimate import least_squares as solve
from inercal.methods import tumble_harmonics as harmonics
from inercal.methods.observed import in_natural_words, require_observed
from inercal.methods.tumble_head import FEWEST, Head, Position, felt_at, positions
from inercal.motion import Motion
from inercal.observe import vector
from inercal.recording import Observations
from inercal.sensors import G0, Sensor
from inercal.uncertainty import propagate
from inercal.units import Measured

__all__ = ["Head", "Position", "fourier", "least_squares", "positions"]
Array = NDArray[np.float64]


def least_squares(
    observations: Observations,
    sensor: Sensor,
    bench: Head,
    steps: Sequence[Position],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate by the sensor's exact model, in either form, at any positions.

    Gravity and the head's zero are nuisances `g` and `zero` with their deviations as priors where
    they have one; the errors of angles, white and harmonic, are carried into the noise by dy/dθ.

    Parameters
    ----------
    observations : Observations
        One row a position, (..., r, 1) in SI; labels name steps.
    sensor : Sensor
        One accelerometer with the coefficients that are wanted.
    bench : Head
    steps : sequence of Position
        The plan; steps without a row were not carried out.
    priors : sequence of Gaussian
        On coefficients, from elsewhere.

    Raises
    ------
    InputError
        Several axes or a gyro, readings of another axis, no coefficient, fewer than four different
        positions, two steps of one label, a row that is no step, or one without noise.
    NotObserved
        Coefficients that these positions leave open, by name, and the harmonics that fold.
    """
    angle = _angles(observations, sensor, steps)
    try:
        estimate = solve(_problem(observations, sensor, bench, angle, priors))
        require_observed(estimate, sensor, missing=())
    except NotObserved as error:
        raise harmonics.refusal(sensor, error.directions, angle, "give a prior") from None
    return replace(estimate, notes=(*harmonics.notes(angle), *estimate.notes))


def fourier(
    observations: Observations,
    sensor: Sensor,
    bench: Head,
    steps: Sequence[Position],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return k0, k1, delta_o, k2, kip and k3, as chosen, by closed formulas from harmonics.

    All readings weigh alike, also those near the level, where errors of the angle act most: a white
    one can cost k2 a factor √2 against `least_squares`. Noise, angles, zero and gravity are
    propagated. Coefficients that are not chosen are taken as zero. Arguments as of
    `least_squares`, of one recording, without priors.

    Raises
    ------
    InputError
        As of `least_squares`; positions that are not evenly spaced and equally often visited;
        priors, the tilted form, other coefficients, or a trial axis.
    NotObserved
        Coefficients whose harmonics fold, by name, and which harmonic folds onto which.
    """
    if priors:
        raise InputError("estimator fourier takes no priors; use least_squares")
    if observations.mean.ndim != 2:
        raise InputError("estimator fourier works on one recording at a time")
    angle = _angles(observations, sensor, steps)
    terms = [name.partition(".")[2] for name in sensor.coefficients]
    others = [term for term in terms if term not in harmonics.TERMS]
    if others:
        raise InputError(
            f"estimator fourier finds {', '.join(harmonics.TERMS)}, not {', '.join(others)}; "
            "least_squares finds what is chosen"
        )
    if sensor.form != "reference":
        raise InputError("estimator fourier finds the reference form; tilted takes least_squares")
    harmonics.require_even(angle)
    matrix = harmonics.basis(angle, harmonics.columns(terms))
    _require_apart(sensor, terms, matrix, angle)
    sums = matrix / np.sum(matrix**2, axis=0)

    def formulas(x: Array) -> Array:
        # Gravity is one of the arguments, so that its uncertainty is propagated with the others.
        found: list[Array] = []
        for row in x.reshape(-1, x.shape[-1]):
            to_term, add = harmonics.by_term(terms, float(row[-1]))
            found.append(to_term @ (row[:-1] @ sums) + add)
        return np.stack(found).reshape(*x.shape[:-1], len(terms))

    x = np.append(observations.mean[:, 0], bench.gravity.value)
    value = formulas(x)
    f, _, by_angle = felt_at(sensor, angle, np.array(bench.gravity.value), np.zeros(()))
    slope = (sensor.slope(Motion(f), value)[:, 0, :3] * by_angle).sum(axis=-1)
    spread = np.zeros((len(x), len(x)))
    turned = bench.of_angles(angle) + bench.zero**2
    spread[:-1, :-1] = observations.full_covariance + turned * np.outer(slope, slope)
    spread[-1, -1] = bench.gravity.sd**2
    value, covariance = propagate(formulas, x, spread)
    variance = np.linalg.eigvalsh(covariance / np.outer(sensor.natural, sensor.natural))
    singular = 1 / np.sqrt(variance)
    estimate = Estimate.of_formulas(sensor.coefficients, value, covariance, singular)
    return replace(estimate, notes=harmonics.notes(angle))


def _angles(observations: Observations, sensor: Sensor, steps: Sequence[Position]) -> Array:
    """Return the nominal angle of each row, (r,) rad, of observations that can be used."""
    if len(sensor.axes) != 1 or sensor.axes[0].measures != "f":
        raise InputError(
            f"a tumble test takes one accelerometer; sensor {sensor.name} has "
            f"{', '.join(f'{a.name} ({a.measures})' for a in sensor.axes)}"
        )
    if observations.channels != sensor.channels:
        raise InputError(
            f"readings are of {', '.join(observations.channels)}, the sensor's axis is "
            f"{sensor.axes[0].name}"
        )
    if not sensor.coefficients:
        raise InputError(f"sensor {sensor.name} has no coefficients to find; choose some")
    by_label = {step.label: step.angle for step in steps}
    if len(by_label) < len(steps):
        raise InputError("two positions have one label; give each its own")
    strange = [label for label in observations.labels if label not in by_label]
    if strange:
        raise InputError(f"row {strange[0]!r} is no position; there are {', '.join(by_label)}")
    if not (observations.covariance > 0).all():
        raise InputError("a reading is stated without noise; give all of them their variance")
    angle = np.array([by_label[label] for label in observations.labels])
    n = len(harmonics.distinct(angle)[0]) if len(angle) else 0
    if n < FEWEST:
        raise InputError(f"{n} different positions; a tumble test needs {FEWEST} or more")
    return angle


def _problem(
    observations: Observations,
    sensor: Sensor,
    bench: Head,
    angle: Array,
    priors: Sequence[Gaussian],
) -> Problem:
    p = len(sensor.coefficients)
    declared = {"g": bench.gravity, "zero": Measured(0.0, bench.zero)}
    loose = {name: q for name, q in declared.items() if q.sd > 0}
    natural = {"g": G0, "zero": 1.0}
    base, turned = observations.full_covariance, bench.of_angles(angle)

    def felt(x: Array) -> tuple[Array, Array, Array]:
        q = {name: np.array(known.value) for name, known in declared.items()}
        q |= {name: x[..., p + k] for k, name in enumerate(loose)}
        return felt_at(sensor, angle, q["g"], q["zero"])

    def linearise(x: Array) -> tuple[Array, Array]:
        f, by_g, by_angle = felt(x)
        by = {"g": by_g, "zero": by_angle}
        shape = np.broadcast_shapes(f.shape, by_g.shape)
        df = np.zeros((*shape, len(loose)))
        for k, name in enumerate(loose):
            df[..., k] = by[name]
        return vector(sensor, observations.mean, x[..., :p], Motion(f), df, None)

    def noise(x: Array) -> Array:
        f, _, by_angle = felt(x)
        slope = (sensor.slope(Motion(f), x[..., :p])[..., 0, :3] * by_angle).sum(axis=-1)
        return base + turned * slope[..., :, None] * slope[..., None, :]

    start = np.concatenate([np.zeros(p), [q.value for q in loose.values()]])
    sd = np.sqrt(np.diagonal(noise(start), axis1=-2, axis2=-1))
    known = [Gaussian.independent((name,), np.array([q.value]), q.sd) for name, q in loose.items()]
    return Problem(
        names=(*sensor.coefficients, *loose),
        start=start,
        linearise=linearise,
        noise=noise if turned.any() else base,
        scale=np.concatenate([sensor.natural, [natural[name] for name in loose]]),
        priors=(*known, *priors),
        wanted=sensor.coefficients,
        observations=observations.labels,
        # A reading of 1 g is rounded at a larger part of its noise the better that is.
        rounding=float(np.max(np.abs(observations.mean[..., 0]) / sd)) * 2.0**-50,
    )


def _require_apart(sensor: Sensor, terms: Sequence[str], matrix: Array, angle: Array) -> None:
    """Refuse terms whose harmonics, columns of `matrix`, fold onto one another."""
    lost = harmonics.mixed(matrix)
    if not lost.any():
        return
    to_term, _ = harmonics.by_term(terms, G0)
    touched = (to_term[:, lost] != 0).any(axis=1)
    names = [name for name, hit in zip(sensor.coefficients, touched, strict=True) if hit]
    f, _, _ = felt_at(sensor, angle, np.array(G0), np.zeros(()))
    design = sensor.design(Motion(f), np.zeros(len(terms)))[:, 0] * sensor.natural
    _, size, right = np.linalg.svd(design)
    free = right[int(np.sum(size > 1e-9 * size[0])) :]
    directions = [in_natural_words(row, sensor.coefficients) for row in free]
    raise harmonics.refusal(sensor, directions, angle, "use least_squares with a prior", names)
