"""The Kalman form of systematic calibration: a recording is followed in passes.

A pass starts with the coefficients of the pass before; its last estimate is the smoothed one, as
the coefficients have no dynamics. The batch uses more of what is known of a rest, its mean rate in
all axes.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.benches.turntable.still_table import StillTable
from inercal.estimation import Estimate, Gaussian, ModelTest
from inercal.estimation.innovations import group_innovations, mean_and_whiteness_tests
from inercal.methods.systematic.alignment import attitudes_at
from inercal.methods.systematic.coefficient_rules import require_turns
from inercal.methods.systematic.filter_inputs import FilterModel, FilterStart, filter_start
from inercal.methods.systematic.generalised_least_squares import LAG
from inercal.methods.systematic.navigation_filter import ConstantEstimate, NavigationFilter
from inercal.methods.systematic.segments import (
    FILTER_NOISE,
    Indices,
    Segments,
    segments_of_track,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import Track

_CHUNK = 100  # epochs that a recording is followed in
_MOST_PASSES = 8
_SMALL_STEP = 0.05  # standard deviations
_LARGEST_SHARE = 0.25  # of the variance before the data, of a direction that is determined
_NOTED_SHARE = 0.02
_NAMED_PART = 0.3  # of a direction, of a coefficient that is named


def solve_by_filter(
    track: Track,
    labels: tuple[str, ...],
    sensor: Sensor,
    known: StillTable,
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate of one recording by the filter.

    Parameters
    ----------
    track : Track
        With numbered rests.
    labels : tuple of m str
        Of the rests.
    sensor : Sensor
        Three accelerometers, then three gyros, with noise and the chosen coefficients.
    known : StillTable
    priors : sequence of Gaussian
        On coefficients.

    Raises
    ------
    InputError
        As of `segments_of_track` and `attitudes_at`.
    NotObserved
        Coefficients that these rests and turns do not determine.
    """
    segments = segments_of_track(track, labels, sensor, FILTER_NOISE)
    model = FilterModel(
        sensor, known, priors, segments.run[1] - segments.run[0], segments.dt, segments.means
    )
    start, p = filter_start(model, segments), len(sensor.coefficients)
    require_turns(_attitudes(model, segments, start.value), sensor, priors)
    made, converged, passes = _follow(model, start, segments, track), False, 1
    found = made.estimate()
    while not converged and passes < _MOST_PASSES:
        before, passes = found, passes + 1
        start = replace(start, value=before.value[:p], lag=float(before.value[p]))
        made = _follow(model, start, segments, track)
        found = made.estimate()
        step = (found.value - before.value)[: p + 1] / np.sqrt(
            np.diagonal(found.covariance)[: p + 1]
        )
        converged = bool(np.abs(step).max() < _SMALL_STEP)
    return _estimate(made, model, start, converged, passes)


def _attitudes(model: FilterModel, segments: Segments, c: Array) -> Array:
    return attitudes_at(segments, model.imu, c, model.known.latitude.value)


def _follow(
    model: FilterModel, start: FilterStart, segments: Segments, track: Track
) -> NavigationFilter:
    """Return the filter after the recording, counted from the attitudes of all rests."""
    attitudes = _attitudes(model, segments, start.value)
    start = replace(start, attitude=attitudes[0], rest_attitudes=attitudes)
    made = NavigationFilter(model, start, _CHUNK, keeps_history=True)
    made.feed(track.reading, track.hold)
    made.finish()
    return made


def _estimate(
    made: NavigationFilter, model: FilterModel, start: FilterStart, converged: bool, passes: int
) -> Estimate:
    sensor, found = model.sensor, made.estimate()
    p = len(sensor.coefficients)
    exact = {"g": model.known.gravity.sd == 0, "latitude": model.known.latitude.sd == 0}
    names = (*sensor.coefficients, LAG, *(name for name, known in exact.items() if not known))
    every = (*sensor.coefficients, LAG, *exact)
    at = [every.index(name) for name in names]
    share = _require_determined(found, start, sensor)
    notes = (
        (
            f"the sizes that errors were taken to have before the data give up to "
            f"{100 * share:.2g} % of the information on a direction of the coefficients",
        )
        if share > _NOTED_SHARE
        else ()
    )
    scaled = found.covariance[:p, :p] / np.outer(sensor.unit_scale, sensor.unit_scale)
    return Estimate(
        names=names,
        value=found.value[at],
        covariance=found.covariance[np.ix_(at, at)],
        chi2=np.asarray(made.nis),
        dof=made.components,
        wanted=sensor.coefficients,
        rank=p,
        singular_values=1 / np.sqrt(np.linalg.eigvalsh(scaled)),
        converged=np.asarray(converged),
        iterations=np.asarray(passes, dtype=np.intp),
        notes=notes,
        courses=(made.history(),),
        tests=_innovation_tests(*made.standardised_innovations()),
    )


def _innovation_tests(standard: Array, rest: Indices) -> tuple[ModelTest, ...]:
    """Return the tests of innovations by rest, and of those that judge the turns.

    The first innovation of a rest holds what is wrong with the turn before it; in the sum over all
    innovations it is lost.
    """
    first = np.append(False, rest[1:] != rest[:-1])
    turns = ModelTest(
        "first innovations after each turn",
        float(np.sum(standard[first] ** 2)),
        standard[first].size,
    )
    return (
        turns,
        *mean_and_whiteness_tests(
            group_innovations(standard, rest),
            "mean innovations of each rest",
            "correlation of the innovations between rests",
        ),
    )


def _require_determined(found: ConstantEstimate, start: FilterStart, sensor: Sensor) -> float:
    """Refuse directions that are as unsure as before the data; return the largest share left."""
    p = len(sensor.coefficients)
    share, directions = np.linalg.eigh(found.covariance[:p, :p] / np.outer(start.sd, start.sd))
    open_ = share > _LARGEST_SHARE
    if open_.any():
        part = np.abs(directions[:, open_]).max(axis=1) > _NAMED_PART
        names = tuple(n for n, named in zip(sensor.coefficients, part, strict=True) if named)
        raise NotObserved(
            f"not observed: the run determines {p - int(open_.sum())} of {p} directions of the "
            f"coefficients; open with {', '.join(names)}: add quarter turns about level axes and "
            "rests, leave coefficients out, or state priors",
            names,
            names=names,
        )
    return float(share.max())
