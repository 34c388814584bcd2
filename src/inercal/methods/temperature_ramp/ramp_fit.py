"""Generalised least squares of a ramp: coefficients, constants, and the lag where it is free."""

from collections.abc import Callable, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import ErrorName
from inercal.estimation import Candidate, Estimate, Gaussian, Problem, least_squares
from inercal.estimation.problem import Linearise
from inercal.methods.temperature_ramp.ramp_candidates import ramp_candidates
from inercal.methods.temperature_ramp.ramp_model import LAG, RampModel
from inercal.physics.earth import EARTH_RATE
from inercal.physics.sensors import G0, Sensor
from inercal.recordings.environment import Environment

WIDEST_LAG = 300.0  # s, standard deviation of a lag that is not stated
_NATURAL = {"f": G0, "w": 1.0}


def fit_ramp(model: RampModel, priors: Sequence[Gaussian], environment: Environment) -> Estimate:
    """Return the estimate of a ramp.

    Parameters
    ----------
    model : RampModel
    priors : sequence of Gaussian
        On coefficients.
    environment : Environment
        States the lag, or leaves it unknown.
    """
    rows = model.blocks.time.size * len(model.sensor.axes)
    lag = 0.0 if environment.lag is None else environment.lag.value
    tests = ramp_candidates(model)
    return solve_ramp(model, priors, environment, model.linearise, rows, lag, candidates=tests)


def solve_ramp(
    model: RampModel,
    priors: Sequence[Gaussian],
    environment: Environment,
    linearise: Linearise,
    rows: int,
    lag: float,
    candidates: Callable[[Array], Sequence[Candidate]] | None = None,
) -> Estimate:
    """Return the estimate by whitened rows that `linearise` gives, started at a lag, s."""
    names, sensor = model.names, model.sensor
    scale = np.array([*sensor.unit_scale, *(_size(name, sensor) for name in model.nuisances)])
    # At zero coefficients the lag has no effect: the search starts from the fit at the given lag.
    start = np.zeros(len(names))
    if LAG in model.nuisances:
        start[-1] = lag
    residual, jacobian = model.linearise(start)
    free = [k for k, name in enumerate(names) if name != LAG]
    by = np.linalg.lstsq(jacobian[:, free] * scale[free], residual, rcond=1e-12)[0]
    start[free] += by * scale[free]
    return least_squares(
        Problem(
            names,
            start,
            linearise,
            np.ones(rows),
            scale,
            priors=(*priors, *_nuisance_priors(model, environment)),
            wanted=sensor.coefficients,
            candidates=candidates,
        )
    )


def _size(name: str, sensor: Sensor) -> float:
    """Return the natural size of a nuisance, SI."""
    if name == LAG:
        return 100.0
    axis = ErrorName(name).place
    return _NATURAL[next(a.measures for a in sensor.axes if a.name == axis)]


def _nuisance_priors(model: RampModel, environment: Environment) -> list[Gaussian]:
    """Return what is known of the constants and of the lag.

    The attitude is unknown: a component of the earth's rate is 0 ± Ω/√3 and one of gravity 0 ± g.
    The bias of an accelerometer is part of the constant and of nothing else.
    """
    result: list[Gaussian] = []
    for axis in model.sensor.axes:
        sd = EARTH_RATE / np.sqrt(3) if axis.measures == "w" else G0
        result.append(Gaussian.independent((f"constant[{axis.name}]",), [0.0], [sd]))
    if LAG in model.nuisances:
        stated = environment.lag
        value, sd = (0.0, WIDEST_LAG) if stated is None else (stated.value, stated.sd)
        result.append(Gaussian.independent((LAG,), [value], [sd]))
    return result
