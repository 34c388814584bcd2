"""Run both filters over one track and combine their estimates."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import chain

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.estimation import Estimate, Gaussian
from inercal.estimation.kernel_options import compile_beside
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.nullspace import first_combinations
from inercal.estimation.scores import NO_SCORE_TESTS
from inercal.methods import Priors, temperature
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman import filter_config, filter_tests
from inercal.methods.turntable_kalman._filter_steps import INNOVATION_GATE
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track

# Limit of rejections per component: five times the rate expected by chance, which is one epoch in
# 900 for three components.
_CHANCE_REJECTIONS = 2e-3


def run_filter(
    kind: filter_config.FilterKind,
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    config: filter_config.FilterConfig,
    priors: Priors = (),
    *,
    smooth: bool = False,
) -> filter_tests.FilterResult:
    """Run the gyro filter ("w") or the accelerometer filter ("f") over one trial's track.

    With `smooth`, smooth the states that vary with time and keep the data for the tests.
    """
    result = config.filter(kind, sensor, bench, track, priors)
    run = result.begin(track)
    filtered = run.follow(track)
    course, found, checked = filtered.history, run.estimate, None
    # The assumed sizes are so large that each coefficient uses up one degree of freedom.
    own = set(result.triad.sensor.coefficients)
    learned = len(own) - sum(len(one.names) for one in priors if own.issuperset(one.names))
    if smooth:
        checked = filter_tests.innovation_test_data(result, filtered, found, priors)
        # Only a report shows the smoothed states, and computing them needs another pass over the
        # track.
        smoothing = LazyValue(lambda: filtered.smoothed(result.time_varying_states))
        course = replace(course, smoothing=smoothing)
    return filter_tests.FilterResult(
        result.triad, course.names, found.value, found.covariance, course,
        run.state.nis, max(run.dof - learned, 0), result.unit,
        config.untested_reason(kind),
        result.shared_covariance, checked, run.rejections,
    )  # fmt: skip


def estimate_by_filters(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    steps: TableSteps,
    priors: Priors = (),
    *,
    config: filter_config.FilterConfig,
) -> Estimate:
    """Return the estimate from both filters, one trial after the other.

    Parameters
    ----------
    observations : Observations
        Observations with the track that the filters process.
    sensor : Sensor
        Triads of gyros and of accelerometers, or only one of them.
    bench : Turntable
    steps : sequence of Position or Rotation
        Unused, because the motion comes from the readback.
    priors : sequence of Gaussian
        Priors on coefficients.
    config : FilterConfig

    Raises
    ------
    InputError
        There is no track or no rest at its start, the filters do not support the sensor, a prior
        combines gyros and accelerometers, or an epoch is not a whole number of samples.
    NotObserved
        The run does not determine some directions.
    """
    if observations.track is None:
        raise InputError(
            "the data are means of positions, but the filters need samples; give a recording",
            key="track",
        )
    track = temperature.with_steady_temperature(observations.track)
    kinds = {axis.measures for axis in sensor.axes}
    priors = split_priors(sensor, priors)
    lead = track.reading.shape[:-2]
    filter_config.require_whole_epoch(config.epoch, filter_config.sampling_step(track))
    indices = list(np.ndindex(*lead))

    def run(kind: filter_config.FilterKind) -> list[filter_tests.FilterResult]:
        # With several trials only the first has a smoothed time course and tests.
        return [
            run_filter(kind, sensor, bench, track.trial(*k), config, priors, smooth=not any(k))
            for k in indices
        ]

    chosen: list[filter_config.FilterKind] = [k for k in filter_config.FILTER_KINDS if k in kinds]
    with compile_beside(lambda: run(chosen[1])) if len(chosen) > 1 else nullcontext():
        first = run(chosen[0])
    trials = list(zip(first, *map(run, chosen[1:]), strict=True))
    for one in chain.from_iterable(trials):
        p = len(one.triad.sensor.coefficients)
        model.require_decided(one.triad, one.covariance[:p, :p], one.course.name)
    owners = _owners(trials[0])
    names = (*sensor.coefficients, *owners)
    own = [
        [*one.triad.sensor.coefficients, *(n for n, owner in owners.items() if owner is one)]
        for one in trials[0]
    ]
    result = [_combine_filters(names, trial, own) for trial in trials]
    # If R is larger than the noise, tests of means are less powerful but not wrong.
    checked = [one.test_data for one in trials[0] if one.test_data]
    q, p = len(names), len(sensor.coefficients)
    value = np.array([one[0] for one in result]).reshape(*lead, q)
    covariance = np.array([one[1] for one in result]).reshape(*lead, q, q)
    chi2 = np.array([one[2] for one in result]).reshape(lead)
    scaled = result[0][1][:p, :p]
    moved = [_table_sensitivities(names, trial, bench) for trial in trials]
    known = np.linalg.eigvalsh(scaled / np.outer(sensor.unit_scale, sensor.unit_scale))
    return Estimate(
        names=names,
        value=value,
        covariance=covariance,
        chi2=chi2,
        dof=sum(one.dof for one in trials[0]),
        wanted=sensor.coefficients,
        rank=p,
        singular_values=1 / np.sqrt(known),
        converged=np.ones(lead, dtype=bool),
        iterations=np.ones(lead, dtype=np.intp),
        groups=tuple(filter_tests.residual_group(one, observations) for one in trials[0]),
        notes=_notes(trials[0], config, bench),
        courses=tuple(one.course for one in trials[0]),
        tests=tuple(
            test for one in checked for test in filter_tests.innovation_tests(one, observations)
        ),
        scoring=LazyValue(lambda: filter_tests.score_omissions(checked, bench, names, own))
        if checked and not lead
        else NO_SCORE_TESTS,
        sensitivities={
            name: np.array([one[name] for one in moved]).reshape(*lead, q) for name in moved[0]
        },
        joint_priors=frozenset(owners),
    )


def _table_sensitivities(
    names: tuple[str, ...], parts: Sequence[filter_tests.FilterResult], bench: Turntable
) -> dict[str, Array]:
    """Return the coefficients' sensitivity to the table's stated values, (q,) by parameter.

    Each filter estimates the table separately and therefore gives its own part of every column.
    Gravity is not a state; it is a factor on the accelerometers' readings.
    """
    declared, moved = bench.acting_parameters(), dict[str, Array]()
    for one in parts:
        own = one.triad.sensor.coefficients
        at, p = [names.index(name) for name in own], len(own)
        table = _table_states(one)
        prior = bench.qualified.joint_covariance([declared[name] for name in table])
        cross = one.covariance[:p, [one.names.index(name) for name in table]]
        columns = dict(zip(table, np.linalg.solve(prior, cross.T), strict=True))
        if np.any(one.shared_covariance):
            columns["g"] = -model.gravity_sensitivity(one.triad) / bench.gravity.value
        for name, column in columns.items():
            moved.setdefault(name, np.zeros(len(names)))[at] = column
    return moved


def split_priors(sensor: Sensor, priors: Priors) -> list[Gaussian]:
    """Return the priors of each triad separately, because each filter has its own.

    Raises
    ------
    InputError
        A prior correlates both triads.
    """
    own = [sensor.select_axes(kind).coefficients for kind in ("f", "w")]
    result: list[Gaussian] = []
    for prior in priors:
        first, second = (np.flatnonzero(np.isin(prior.names, names)) for names in own)
        if np.any(prior.covariance[np.ix_(first, second)]):
            raise InputError(
                f"prior on {', '.join(prior.names)}: the filters estimate gyros and "
                "accelerometers separately; give an uncorrelated prior for each, or use "
                "turntable_trajectory",
                names=prior.names,
            )
        result += [part for names in own if (part := prior.marginal(names)) is not None]
    return result


def _notes(
    parts: Sequence[filter_tests.FilterResult], config: filter_config.FilterConfig, bench: Turntable
) -> tuple[str, ...]:
    """Return notes on the innovations and on errors that the uncertainties do not include."""
    result = [filter_tests.describe_innovations(one) for one in parts]
    result += [
        f"{one.course.name}: the filter rejected the table's angles at {one.rejections} epochs, "
        f"because their innovations exceeded {INNOVATION_GATE:g} standard deviations."
        for one in parts
        if one.rejections > _CHANCE_REJECTIONS * one.dof
    ]
    result += [words for one in parts if (words := _prior_share_note(one))]
    whole = config.table_states == "whole"
    if not whole and (bench.square > 0 or any(bench.harmonics)):
        which = "gyros" if config.table_states == "lean" else "gyros and accelerometers"
        result.append(
            f"The uncertainties of the {which} are too small, because the filters have no states "
            "for the stated right angles and harmonics of the table. Estimator full has them."
        )
    if len(parts) > 1 and whole and set(_table_states(parts[0])) & set(_table_states(parts[1])):
        result.append(
            "Gyros and accelerometers are treated as independent, although errors of the table's "
            "right angles and harmonics affect both."
        )
    return tuple(result)


def _prior_share_note(one: filter_tests.FilterResult) -> str:
    """Return a note on directions that the assumed sizes of coefficients partly determine."""
    p = len(one.triad.sensor.coefficients)
    share, found = model.prior_dominated_directions(one.triad, one.covariance[:p, :p])
    if not found:
        return ""
    return (
        f"{one.course.name}: up to {100 * share:.2g} % of the information on these directions "
        "comes from the assumed sizes of coefficients and not from the run (in units of g and "
        f"rad/s): {first_combinations([direction.words for direction in found])}"
    )


def _owners(parts: Sequence[filter_tests.FilterResult]) -> dict[str, filter_tests.FilterResult]:
    """Return the filter with the smaller variance for each parameter of the table.

    Each filter has its own correlations. The value of one filter with the correlations of the other
    would not give a valid covariance.
    """
    found: dict[str, tuple[float, filter_tests.FilterResult]] = {}
    for one in parts:
        for name in _table_states(one):
            k = one.names.index(name)
            variance = float(one.covariance[k, k])
            if name not in found or variance < found[name][0]:
                found[name] = variance, one
    return {name: one for name, (_, one) in found.items()}


def _table_states(one: filter_tests.FilterResult) -> list[str]:
    """Return the states that are constant table parameters for the whole run."""
    return [
        name for name in one.names if "." not in name and not name.startswith(("drift[", "hold_"))
    ]


def _combine_filters(
    names: tuple[str, ...], parts: Sequence[filter_tests.FilterResult], own: Sequence[Sequence[str]]
) -> tuple[Array, Array, float]:
    """Return value and covariance in the order of `names`, and the sum of NIS.

    The filters are treated as independent; `own` contains the names that each of them estimates.
    """
    value, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for one, taken in zip(parts, own, strict=True):
        at = [names.index(name) for name in taken]
        k = [one.names.index(name) for name in taken]
        value[at] = one.value[k]
        ratio, first = filter_tests.variance_inflation(one), at[: len(one.shared_covariance)]
        covariance[np.ix_(at, at)] = ratio * one.covariance[np.ix_(k, k)]
        # Innovations do not test gravity, because they do not contain its error.
        covariance[np.ix_(first, first)] -= (ratio - 1) * one.shared_covariance
    return value, covariance, sum(one.nis for one in parts)
