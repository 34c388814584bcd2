"""The charts as a file, `*.control.json`; `inercal.calibration.check_standard` reads it."""

from typing import Any

import numpy as np

from inercal.basics.documents import origin, record_object
from inercal.calibration.check_standard import SCHEMA
from inercal.estimation.uncertainty.control_charts import EWMA_WEIGHT, MEWMA_WEIGHT
from inercal.laboratory.check_standard.charts import ControlCharts
from inercal.physics.sensors import SI_UNITS


def control_charts_object(found: ControlCharts) -> dict[str, Any]:
    """Return the charts as the JSON object of their file: values in SI, statistics without unit."""
    matched, limits, values = found.matched, found.limits, found.values
    scatter = np.sqrt(np.diagonal(found.days.point[-1])) * found.fit.unit
    kind = limits.lasting_kind.lower()
    single = zip(np.sqrt(limits.shewhart), np.sqrt(limits.lasting), strict=True)
    return {
        "schema": SCHEMA,
        "sensor": {"name": matched.sensor.name},
        "frame": matched.frame,
        "form": matched.sensor.form,
        "in_control": found.in_control,
        "run_length": {
            "all": limits.run_length,
            "joint": limits.joint_run_length,
            "single": limits.single_run_length,
        },
        "weights": {"EWMA": EWMA_WEIGHT, "MEWMA": MEWMA_WEIGHT},
        "lasting": limits.lasting_kind,
        "reference": {"days": found.reference_days, "until": found.reference_end},
        "coefficients": [
            {
                "name": name,
                "unit": SI_UNITS[matched.sensor.coefficient(name).unit],
                "reference": float(found.fit.mean[k] * found.fit.unit[k]),
                "sd": float(scatter[k]),
                "dof": float(found.dof[k]),
                "shewhart_limit": float(shewhart),
                f"{kind}_limit": float(lasting),
            }
            for k, (name, (shewhart, lasting)) in enumerate(zip(found.names, single, strict=True))
        ],
        "limits": {"T²": limits.t2, "MEWMA": limits.mewma, "dof": found.joint_dof},
        "points": [
            {
                "first": point.first,
                "last": point.last,
                "sessions": list(point.labels),
                "in_control": point.in_control,
                "signals": {kind: list(names) for kind, names in point.signals.items()},
                "T²": float(values.t2[t]),
                "MEWMA": float(values.mewma[t]),
                "shewhart": values.shewhart[t].tolist(),
                kind: values.lasting[t].tolist(),
            }
            for t, point in enumerate(found.points)
        ],
        "episodes": record_object(found.episodes),
    } | origin()
