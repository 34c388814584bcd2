"""Candidates of the score tests of a ramp: terms of temperature, a drift, and a warm-up.

A warm-up exp(−t/τ) has an unknown time constant. The one that explains most is searched for, and
its derivative to ln τ is a component of the candidate too: the test pays for the search by these
directions.
"""

from collections.abc import Callable, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.run_file_advice import Change
from inercal.estimation import Candidate
from inercal.methods.candidates import extended_sensor
from inercal.methods.temperature_ramp.ramp_model import LAG, RampModel
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import SI_UNITS

_LONGEST = 0.5  # of the recording: a slower warm-up is a drift
_COARSE, _FINE = 16, 9  # time constants that are tried


def ramp_candidates(model: RampModel) -> Callable[[Array], Sequence[Candidate]]:
    """Return what `Problem.candidates` takes."""

    def candidates(x: Array) -> list[Candidate]:
        return [
            *_coefficient_candidates(model, x),
            *_drift_candidates(model),
            *_warm_up_candidates(model, x),
        ]

    return candidates


def _column(model: RampModel, k: int, values: Array) -> Array:
    """Return what values of axis k at the blocks, (b,), add to the whitened rows, (b m,)."""
    parts = [np.zeros(len(values)) for _ in model.sensor.axes]
    parts[k] = model.whitening[k] @ values
    return np.concatenate(parts)


def _coefficient_candidates(model: RampModel, x: Array) -> list[Candidate]:
    sensor, seen = model.sensor, {"dT": model.temperature_offset(x), "dTdt": model.blocks.rate}
    larger = extended_sensor(sensor, temperature_varies=True)
    members: dict[str, list[tuple[str, Array]]] = {}
    for full in larger.coefficients:
        line = larger.coefficient(full)
        axis, term = CoefficientName(full).parts
        inputs = {c for product in line.basis.products for c in product.components}
        # With the lag, a term of dT/dt is one thing where the bias is a line.
        if full in sensor.coefficients or not inputs or not inputs <= set(seen):
            continue
        if "dTdt" in inputs and LAG in model.nuisances:
            continue
        k = [one.name for one in sensor.axes].index(axis)
        column = _column(model, k, np.asarray(line.basis.value(seen)))
        members.setdefault(term, []).append((full, column))
    return [
        Candidate(
            name,
            "coefficient",
            tuple(full for full, _ in chosen),
            tuple(SI_UNITS[larger.coefficient(full).unit] for full, _ in chosen),
            np.stack([column for _, column in chosen], axis=-1),
            largest=np.array([larger.coefficient(full).largest for full, _ in chosen]),
        )
        for term, own in members.items()
        for name, chosen in (*([(term, own)] if len(own) > 1 else []), *((n[0], [n]) for n in own))
    ]


def _drift_candidates(model: RampModel) -> list[Candidate]:
    """Return a drift of each axis, linear in time from the first block to the last."""
    time = model.blocks.time
    shape = (time - time.mean()) / max(float(np.ptp(time)), 1e-300)
    return [
        Candidate(
            f"drift of {axis.name}",
            "time",
            (f"drift of {axis.name}",),
            (QUANTITIES[axis.measures].unit,),
            _column(model, k, shape)[:, None],
        )
        for k, axis in enumerate(model.sensor.axes)
    ]


def _warm_up_candidates(model: RampModel, x: Array) -> list[Candidate]:
    """Return a warm-up of all axes, with the key that lets the method estimate it."""
    if model.warm_up or model.blocks.is_monotonic:
        return []
    residual, jacobian = model.linearise(x)
    length = np.linalg.norm(jacobian, axis=0)
    q, _ = np.linalg.qr(jacobian / np.where(length > 0, length, 1.0))
    time, axes = model.blocks.time, range(len(model.sensor.axes))

    def columns(tau: float) -> Array:
        return np.stack([_column(model, k, np.exp(-time / tau)) for k in axes], axis=-1)

    def explained(tau: float) -> float:
        left = columns(tau)
        left = left - q @ (q.T @ left)
        u, _ = np.linalg.qr(left)
        return float(np.sum((u.T @ residual) ** 2))

    shortest, longest = model.blocks.seconds, _LONGEST * float(time[-1])
    best, ratio, count = float(np.sqrt(shortest * longest)), np.sqrt(longest / shortest), _COARSE
    for _ in range(3):
        tried: Array = np.geomspace(best / ratio, best * ratio, count)
        best = max(tried.tolist(), key=explained)
        ratio, count = float(tried[1] / tried[0]), _FINE
    wave = np.stack([_column(model, k, time / best * np.exp(-time / best)) for k in axes], axis=-1)
    names = [axis.name for axis in model.sensor.axes]
    units = tuple(QUANTITIES[axis.measures].unit for axis in model.sensor.axes)
    return [
        Candidate(
            "warm_up",
            "time",
            (
                *(f"warm_up[{name}]" for name in names),
                *(f"change of warm_up[{name}] by ln τ" for name in names),
            ),
            (*units, *units),
            np.concatenate([columns(best), wave], axis=1),
            changes=(
                Change("environment", "kind", "ramp"),
                Change("environment", "warm_up", f"{best:.3g} s"),
            ),
        )
    ]
