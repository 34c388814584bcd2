"""Compute the motion of a sensor on the arm of a centrifuge that turns steadily.

A sensor on the arm senses the arm's centripetal acceleration and gravity. They are at right angles
except for a tilt τ of gravity relative to the arm. The unit vector `out` points outwards from the
spindle and `up` along it, both in the body frame::

    a = R (1 + s a₀) (ω (1 + ρ) + Ω sin φ)²,   a₀ = R ω² nominal
    f = −(a + g τ) out + g √(1 − τ²) up         sensor locked to the arm, which has ω along up
    n² = a² + 2 a g τ + g²                      in any attitude

Here R is the static radius, s the arm's stretch, ω the stated rate relative to the ground (positive
counter-clockwise seen from above), ρ its relative error, and Ω sin φ the earth's rate along the
spindle.

The spindle leans by λ₁ at the arm's azimuth α = 0 and by λ₂ at α = 90°, which adds
λ₁ cos α + λ₂ sin α to τ. The horizontal earth rate e causes a Coriolis acceleration that adds
2 e ω R to gravity once per turn, like a tilt of 2 (e₁ cos α + e₂ sin α)/ω. Both average to zero
over whole turns. On a platform that turns against the arm, the sensor keeps its attitude relative
to the ground while the direction of the arm rotates. One row of observations then belongs to one
azimuth, and both effects act.

The body is rotated from its nominal attitude by mounting angles m, common to the run, and then by
the indexing errors e of each attitude: v_body = exp(m) exp(e) v_nominal. They do not affect norms.

Rate and tilt also vary from dwell to dwell, by `dwell_rate` and `dwell_tilt`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.contract import MeanMotion
from inercal.physics.earth import EARTH_RATE
from inercal.physics.frames import exp_so3, left_jacobian, skew, stack_components, transform
from inercal.physics.motion import Motion
from inercal.physics.plan import Attitude, Spin

if TYPE_CHECKING:
    from inercal.benches.centrifuge.bench import Centrifuge


@dataclass(frozen=True, eq=False)
class SpecificForceNorm:
    """Norm of the specific force during each dwell, and its dependence on the bench.

    Parameters
    ----------
    norm : (..., r) array
        Norm n of the specific force, m/s².
    derivatives : mapping of str to (..., r) array
        Derivatives of n with respect to the bench's parameters that affect it, including those of
        dwells.
    dwell : (..., r) array
        Standard deviation of n due to the parameters that vary from dwell to dwell, m/s².
    """

    norm: Array
    derivatives: Mapping[str, Array]
    dwell: Array


@dataclass(frozen=True, eq=False)
class _ArmMotion:
    """Centripetal acceleration, tilt and rate during each dwell, (..., r), with derivatives."""

    a: Array
    tilt: Array
    total_rate: Array
    total_rate_derivatives: Mapping[str, Array]
    a_derivatives: Mapping[str, Array]
    tilt_derivatives: Mapping[str, Array]


def _arm_motion(bench: "Centrifuge", steps: Sequence[Spin], q: Mapping[str, Array]) -> _ArmMotion:
    w = bench.sense * np.array([step.rate for step in steps])
    zero = np.zeros(())
    labels = [step.label for step in steps]
    own = {name: _parameter_by_label(q, name, labels) for name in ("dwell_rate", "dwell_tilt")}
    radius, stretch, rate, tilt = (
        q[name][..., None] for name in ("radius", "stretch", "rate", "tilt")
    )
    if bench.latitude is None:
        earth, up, by_place = "earth_up", q["earth_up"][..., None], np.ones(1)
    else:
        place = q["latitude"][..., None]
        earth, up, by_place = "latitude", EARTH_RATE * np.sin(place), EARTH_RATE * np.cos(place)
    nominal = bench.radius.value * w**2
    grown = 1 + stretch * nominal
    turned = w * (1 + rate + own["dwell_rate"]) + up
    by_turned = 2 * radius * grown * turned
    cosine, sine = np.array([_mean_azimuth_components(step, bench.sense) for step in steps]).T
    lean, level = (
        [q.get(f"{name}{k}", zero)[..., None] for k in (1, 2)] for name in ("lean", "level")
    )
    coriolis = 2 / np.where(w == 0, np.inf, w)
    return _ArmMotion(
        a=radius * grown * turned**2,
        tilt=tilt
        + own["dwell_tilt"]
        + (lean[0] + coriolis * level[0]) * cosine
        + (lean[1] + coriolis * level[1]) * sine,
        total_rate=turned,
        total_rate_derivatives={"rate": w, "dwell_rate": w, earth: by_place},
        a_derivatives={
            "radius": grown * turned**2,
            "stretch": radius * nominal * turned**2,
            "rate": by_turned * w,
            "dwell_rate": by_turned * w,
            earth: by_turned * by_place,
        },
        tilt_derivatives={
            "tilt": np.ones(1),
            "dwell_tilt": np.ones(1),
            "lean1": cosine,
            "lean2": sine,
            "level1": coriolis * cosine,
            "level2": coriolis * sine,
        },
    )


def _mean_azimuth_components(step: Spin, sense: int) -> tuple[float, float]:
    """Return the mean cosine and sine of the arm's azimuth during a dwell."""
    if step.azimuth is not None:
        return cos(step.azimuth), sin(step.azimuth)
    swept = sense * step.rate * step.seconds
    if swept == 0:
        return 0.0, 0.0
    return sin(swept) / swept, (1 - cos(swept)) / swept


def _parameter_by_label(q: Mapping[str, Array], name: str, labels: Sequence[str]) -> Array:
    """Return a parameter for the steps or attitudes with these labels, (..., r); 0 if missing."""
    values = [q.get(f"{name}[{label}]", np.zeros(())) for label in labels]
    return stack_components(*values)


def specific_force_norm(
    bench: "Centrifuge", steps: Sequence[Spin], q: Mapping[str, Array]
) -> SpecificForceNorm:
    """Return the norm of the specific force during each dwell.

    Parameters
    ----------
    bench : Centrifuge
    steps : sequence of r Spin
    q : mapping of str to (...) array
        The bench's parameters, SI, by full name, as `nuisances` lists them. Parameters of attitudes
        have no effect. Missing parameters of lean and dwells are zero.
    """
    arm, g = _arm_motion(bench, steps, q), q["g"][..., None]
    n = np.sqrt(arm.a**2 + 2 * arm.a * g * arm.tilt + g**2)
    by_a, by_tilt = (arm.a + g * arm.tilt) / n, arm.a * g / n
    by = {"g": (arm.a * arm.tilt + g) / n}
    by |= {name: by_a * slope for name, slope in arm.a_derivatives.items()}
    by |= {name: by_tilt * slope for name, slope in arm.tilt_derivatives.items()}
    dwell = np.hypot(by["dwell_rate"] * bench.dwell_rate, by["dwell_tilt"] * bench.dwell_tilt)
    return SpecificForceNorm(n, by, dwell)


def sensed_motion(bench: "Centrifuge", steps: Sequence[Spin], q: Mapping[str, Array]) -> MeanMotion:
    """Return the mean motion during each dwell in its attitude, with derivatives.

    In each row, the derivative for "dwell_rate" or "dwell_tilt" refers to the value in that row.

    Parameters
    ----------
    bench, steps, q
        The same as for `specific_force_norm`. Missing mounting and indexing angles are zero.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    arm, g = _arm_motion(bench, steps, q), q["g"][..., None]
    out, up = outward_and_up_directions(steps)
    tilt = arm.tilt[..., None]
    root, pull = np.sqrt(1 - tilt**2), g[..., None]
    nominal = -(arm.a[..., None] + pull * tilt) * out + pull * root * up
    zero = np.zeros(())
    named = attitude_names(steps)
    names = [named[step.attitude] for step in steps]

    index = stack_components(*(_parameter_by_label(q, f"index_{a}", names) for a in "xyz"))
    mount = stack_components(*(q.get(f"mount_{a}", zero) for a in "xyz"))
    outer = exp_so3(mount)[..., None, :, :]
    whole = outer @ exp_so3(index)
    f = transform(whole, nominal)
    turns = bench.platform == "locked"
    along = transform(whole, np.broadcast_to(up, f.shape)) if turns else np.zeros_like(f)
    rate = arm.total_rate[..., None]

    def by_attitude(turned: Array, inner: Array) -> dict[str, Array]:
        """Return a vector's derivatives with respect to the mounting and indexing angles."""
        by_mount = -skew(turned) @ left_jacobian(mount)[..., None, :, :]
        by_index = -outer @ skew(inner) @ left_jacobian(index)
        found: dict[str, Array] = {}
        for k, a in enumerate("xyz"):
            found[f"mount_{a}"] = by_mount[..., k]
            for name in named.values():
                own = np.array([n == name for n in names])
                found[f"index_{a}[{name}]"] = np.where(own[:, None], by_index[..., k], 0.0)
        return found

    def derivatives() -> tuple[dict[str, Array], dict[str, Array]]:
        inner = exp_so3(index)
        df = {"g": transform(whole, root * up - tilt * out)}
        df |= {
            name: transform(whole, -slope[..., None] * out)
            for name, slope in arm.a_derivatives.items()
        }
        by_tilt = transform(whole, -pull * (out + tilt / root * up))
        df |= {name: slope[..., None] * by_tilt for name, slope in arm.tilt_derivatives.items()}
        df |= by_attitude(f, transform(inner, nominal))
        if not turns:
            return df, {}
        dw = {name: slope[..., None] * along for name, slope in arm.total_rate_derivatives.items()}
        dw |= by_attitude(rate * along, rate * transform(inner, np.broadcast_to(up, f.shape)))
        return df, dw

    return MeanMotion.with_lazy_derivatives(Motion(f, rate * along), derivatives)


def attitude_names(steps: Sequence[Spin]) -> dict[Attitude | None, str]:
    """Return the name of each attitude, which is the label of the first step that has it."""
    named: dict[Attitude | None, str] = {}
    for step in steps:
        named.setdefault(step.attitude, step.label)
    return named
