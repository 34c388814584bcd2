"""An IMU on a turntable, followed by two Kalman filters over one recording.

* `full`: the filters of gyros and accelerometers with the drift of the biases, the delay of the
  readback and the table's other declared errors as states. R is the stated noise of the readback,
  so that the innovations test the stated noise and table.
* `drift`: without right angles and harmonics, with the source's R: 19 and 25 states for 24
  parameters, and one state each for an azimuth and a readback clock that are not exact.
* `paper`: the filters of the source, 15 and 18 states; the uncertainties are too small where the
  table has errors.

Both filters run over the whole recording, that of the accelerometers in the holds, independently of
each other; a parameter of the table that both estimate is reported with the smaller uncertainty.
Their coefficients refer to the table's innermost axis frame: 24 in all. `Calibration.in_frame`
turns them exactly into the 21 of a frame that is tied to the accelerometers.

Source: Liu, Cui, Zhang and Xu (North University of China), fast calibration of a MIMU on a
turntable with LabVIEW. The available copy lacks the equations; they are derived from its text.
Drift, delay and the table's errors as states are additions.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import path_by_name as named_path
from inercal.methods._base import Fit, Method, Remarks
from inercal.methods.turntable import DEFAULT_COEFFICIENTS, FURTHER_COEFFICIENTS, fit_remarks
from inercal.methods.turntable_kalman.combined_estimate import FILTER_CONFIGS, estimate_by_filters
from inercal.methods.turntable_kalman.filter_config import FilterConfig, filter_conditions
from inercal.methods.turntable_kalman.sequential import sequential


def _remarks(fit: Fit[Any, Any], configs: Mapping[str, FilterConfig] = FILTER_CONFIGS) -> Remarks:
    """Return the turntable's remarks, and the values in force in the filters as conditions."""
    found = fit_remarks.remarks(fit)
    conditions = filter_conditions(configs[fit.estimator], fit.estimator)
    return found._replace(conditions={**found.conditions, **conditions})


METHOD = Method(
    name="turntable_kalman",
    bench=Turntable,
    default_coefficients=DEFAULT_COEFFICIENTS,
    also=FURTHER_COEFFICIENTS,
    needs=("f", "w"),
    plan=named_path,
    estimators={
        name: partial(estimate_by_filters, config=config) for name, config in FILTER_CONFIGS.items()
    },
    remarks=_remarks,
    source="Liu, Cui, Zhang and Xu, North University of China (MIMU on a turntable)",
    sequential=sequential,
)


def method_with(config: FilterConfig, estimator: str) -> Method[Any, Any]:
    """Return the method with another configuration of one estimator, live estimation included."""
    return replace(
        METHOD,
        estimators={**METHOD.estimators, estimator: partial(estimate_by_filters, config=config)},
        remarks=partial(_remarks, configs={**FILTER_CONFIGS, estimator: config}),
        sequential=partial(sequential, config=config),
    )
