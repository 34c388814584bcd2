"""Calibrate an IMU on a turntable by two Kalman filters over one recording.

* `full`: the filters for gyros and accelerometers, whose states include the drift of the biases,
  the delay of the readback and the table's other declared errors. R is the stated noise of the
  readback, so the innovations test the stated noise and table.
* `drift`: like `full`, but without right angles and harmonics, and with the source's R. The filters
  have 19 and 25 states for 24 parameters, and one more state each if the azimuth or the readback
  clock is not exact.
* `paper`: the filters from the source with 15 and 18 states. Their uncertainties are too small if
  the table has errors.

Both filters run over the whole recording, independently of each other; the accelerometer filter
uses only the holds. If both filters estimate a table parameter, the result with the smaller
uncertainty is reported. The 24 coefficients refer to the frame of the table's innermost axis.
`Calibration.in_frame` converts them exactly into the 21 coefficients for a frame that is tied to
the accelerometers.

Both filters can also follow a run live. The estimate equals that of the recording bit for bit,
however the samples are divided into pieces, because the same filters take the same steps. The final
estimate may have larger uncertainties because it includes the excess scatter of all innovations.

Source: Liu, Cui, Zhang and Xu (North University of China), fast calibration of a MIMU on a
turntable with LabVIEW. The equations are missing in the available copy, so they are derived from
its text. Drift, delay and the table's errors as states are our additions.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

from inercal.benches.turntable.bench import COARSE_REST_SECONDS, Turntable
from inercal.benches.turntable.paths import path_by_name as named_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.methods import Fit, Method, PartialEstimate, Priors, Remarks, turntable
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman.combined_estimate import estimate_by_filters, split_priors
from inercal.methods.turntable_kalman.filter import RunningFilter
from inercal.methods.turntable_kalman.filter_config import (
    FILTER_CONFIGS,
    FILTER_KINDS,
    FilterConfig,
    filter_conditions,
)
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import Track, join_tracks

_AnyRunningFilter = (
    RunningFilter[_readback.AttitudeState] | RunningFilter[_accelerometers.VelocityState]
)


def sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: TableSteps,
    priors: Priors,
    rate_hz: float,
    *,
    config: FilterConfig | None = None,
) -> "FilterPair":
    """Return both filters of an estimator before the first sample.

    Parameters
    ----------
    estimator : str
        "full", "drift" or "paper".
    sensor : Sensor
    bench : Turntable
    steps : sequence of Position or Rotation
        The planned steps, which determine the duration of the run, without pauses.
    priors : sequence of Gaussian
    rate_hz : float
        Unused, because samples have their own times.
    config : FilterConfig, optional
        Configuration that replaces the estimator's own.

    Raises
    ------
    InputError
        A prior combines gyros and accelerometers, or the table cannot carry out the steps.
    """
    duration, chosen = turntable_path_duration(bench, steps), config or FILTER_CONFIGS[estimator]
    return FilterPair(sensor, bench, chosen, split_priors(sensor, priors), duration)


class FilterPair:
    """The filters for the gyros and the accelerometers, "w" and "f"; see `Sequential`.

    Parameters
    ----------
    sensor : Sensor
    bench : Turntable
    config : FilterConfig
    priors : sequence of Gaussian
        Priors, each of which is only on gyros or only on accelerometers.
    run_duration : float
        Planned duration of the run, s.
    """

    def __init__(
        self,
        sensor: Sensor,
        bench: Turntable,
        config: FilterConfig,
        priors: Priors,
        run_duration: float,
    ):
        self._sensor, self._bench, self._config = sensor, bench, config
        self._priors, self._run_duration = priors, run_duration
        self._pending_tracks: list[Track] = []
        self._rest_start = inf  # time at which the first rest began
        self._filters: dict[str, _AnyRunningFilter] = {}

    def feed(self, track: Track) -> None:
        """Process the next samples.

        Raises
        ------
        InputError
            The first rest was too short, or the filters do not support the sensor or the bench.
        """
        if self._filters:
            for one in self._filters.values():
                one.step(track)
            return
        self._pending_tracks.append(track)
        if self._rest_start == inf and (track.hold >= 0).any():
            self._rest_start = float(track.time[track.hold >= 0][0])
        if track.time[-1] > self._rest_start + COARSE_REST_SECONDS:
            self._begin(join_tracks(self._pending_tracks))
            self._pending_tracks = []

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimate of each filter; empty until the first rest has lasted 20 s."""
        return {kind: _partial_estimate(one) for kind, one in self._filters.items()}

    def _begin(self, track: Track) -> None:
        given = self._sensor, self._bench, track, self._priors, self._run_duration
        kinds = {axis.measures for axis in self._sensor.axes}
        filters = {
            kind: self._config.filter(kind, *given).begin(track)
            for kind in FILTER_KINDS
            if kind in kinds
        }
        for one in filters.values():
            one.step(track)
        self._filters = filters


def _partial_estimate(one: _AnyRunningFilter) -> PartialEstimate:
    """Return the estimate of the coefficients, which come first in the estimate of a filter."""
    names, found = one.filter.triad.sensor.coefficients, one.estimate
    p = len(names)
    return PartialEstimate(
        names, found.value[:p], found.covariance[:p, :p], float(one.state.nis), one.dof
    )


def _remarks(fit: Fit[Any, Any], configs: Mapping[str, FilterConfig] = FILTER_CONFIGS) -> Remarks:
    """Return the turntable's remarks, with the filters' actual settings as conditions."""
    found = turntable.remarks_on_samples(fit)
    conditions = filter_conditions(configs[fit.estimator], fit.estimator)
    return found._replace(conditions={**found.conditions, **conditions})


METHOD = Method(
    name="turntable_kalman",
    bench=Turntable,
    default_coefficients=turntable.DEFAULT_COEFFICIENTS,
    also=turntable.FURTHER_COEFFICIENTS,
    needs=("f", "w"),
    plan=named_path,
    estimators={
        name: partial(estimate_by_filters, config=config) for name, config in FILTER_CONFIGS.items()
    },
    remarks=_remarks,
    source="Liu, Cui, Zhang and Xu, North University of China (MIMU on a turntable)",
    sequential=sequential,
    triads_because="its filters follow whole vectors of the rate and of the specific force",
)


def method_with(config: FilterConfig, estimator: str) -> Method[Any, Any]:
    """Return the method with a different configuration for one estimator, also for live runs."""
    return replace(
        METHOD,
        estimators={**METHOD.estimators, estimator: partial(estimate_by_filters, config=config)},
        remarks=partial(_remarks, configs={**FILTER_CONFIGS, estimator: config}),
        sequential=partial(sequential, config=config),
    )
