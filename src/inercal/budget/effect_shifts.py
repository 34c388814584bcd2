"""Known effects, if they are left uncorrected: shifts, not deviations.

Two kinds. The bench corrects for an effect, earth's rate say: the readings have it, and the
estimator is told of a bench without. Or the sensor has a coefficient that is not estimated, a
lever arm or a misalignment: the readings have it, and the estimator knows nothing of it.
A shift is what this changes in the estimate.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.benches import MeanBench
from inercal.benches.kind_definition import Effect
from inercal.benches.kinds import kind_for_bench
from inercal.budget.virtual_experiment import Experiment
from inercal.units import Measured


@dataclass(frozen=True, eq=False)
class Shift:
    """What a known effect shifts if it is left uncorrected.

    Parameters
    ----------
    name : str
    value : str
        Size of the effect as printed.
    shift : (p,) array
        Of the estimates, SI.
    """

    name: str
    value: str
    shift: Array


def effect_shifts(experiment: Experiment) -> tuple[Shift, ...]:
    """Return the shifts by each known effect, then by all together where there are several."""
    bench, own, z = experiment.bench, experiment.sensor.coefficients, experiment.expansion_point
    # Noise and its mirror image: what an effect changes in the weights moves both alike.
    readings, priors = experiment.simulated_readings(np.stack([z, -z]))
    q = {name: np.array(parameter.value) for name, parameter in experiment.bench_parameters.items()}
    quiet = experiment.readings(q, own)
    as_it_is = experiment.estimates(readings, priors)

    def moved(told: MeanBench, more: tuple[str, ...] = ()) -> Array:
        there = readings + experiment.readings(q, (*own, *more)) - quiet
        return np.mean(experiment.estimates(there, priors, told) - as_it_is, axis=0)

    found: list[Shift] = []
    absent: dict[str, Measured | float] = {}
    for effect in kind_for_bench(bench).effects:
        value = _effect_value(getattr(bench, effect.field))
        if value and _effect_reaches_sensor(experiment, effect):
            absent[effect.field] = effect.absent
            shift = moved(replace(bench, **{effect.field: effect.absent}))
            found.append(Shift(effect.name, f"{value * effect.per:.4g} {effect.unit}", shift))
    more = tuple(name for name, c in experiment.truth.items() if name not in own and c)
    whole = replace(experiment.sensor, coefficients=(*own, *more))
    for name in more:
        line = whole.coefficient(name)
        text = f"{experiment.truth[name] / line.si:.4g} {line.unit}"
        found.append(Shift(name, text, moved(bench, (name,))))
    if len(found) > 1:
        found.append(Shift("all of these", "", moved(replace(bench, **absent), more)))
    return tuple(found)


def _effect_value(stated: Measured | float | None) -> float:
    """Return the value of a field; an unknown one is not a known effect."""
    if stated is None:
        return 0.0
    return stated.value if isinstance(stated, Measured) else stated


def _effect_reaches_sensor(experiment: Experiment, effect: Effect) -> bool:
    """Whether the effect reaches the sensor: a hand's earth rate is sensed by gyros alone."""
    gyros = any(axis.measures == "w" for axis in experiment.sensor.axes)
    return gyros or not effect.affects_rates
