"""Combine several calibrations of a sensor into a mean and the uncertainty of its next use.

The U of one session includes the noise and the errors of the bench. The results of a sensor also
scatter from day to day, from mounting to mounting and from power cycle to power cycle. Only
repeated sessions can show this scatter. The result is written to a file `*.repeatability.json`,
which `calibration.next_use` reads.
"""

from dataclasses import replace
from typing import Any

from inercal.basics.documents import attributes, origin
from inercal.basics.units import format_count
from inercal.calibration import Calibration
from inercal.calibration.specification import SCHEMA
from inercal.laboratory.repeatability.repeated_sessions import (
    Repeatability,
    StatedUncertainty,
    repeat,
)
from inercal.laboratory.repeatability.sessions import Owner, RepeatedSession, Scope
from inercal.physics.sensors import SI_UNITS

__all__ = ["Owner", "Repeatability", "RepeatedSession", "Scope", "StatedUncertainty", "repeat"]


def repeatability_object(found: Repeatability) -> dict[str, Any]:
    """Return the result as the JSON object of its file, in SI units."""
    matched = found.matched
    return {
        "schema": SCHEMA,
        "sensor": {"name": matched.sensor.name},
        "frame": matched.frame,
        "form": matched.sensor.form,
        "next": found.scope,
        "mount": found.mount_owner,
        "coefficients": [
            {
                "name": name,
                "unit": SI_UNITS[matched.sensor.coefficient(name).unit],
                "value": float(found.values[k]),
                "dof": float(found.next_use.dof[k]),
                "mean": _statement(found.mean, k),
                "next_use": _statement(found.next_use, k),
            }
            for k, name in enumerate(found.names)
        ],
        "scatter": found.scatter.tolist(),
        "run_to_run": found.run_to_run.tolist(),
        "covariance": {
            "mean": found.mean.covariance.tolist(),
            "next_use": found.next_use.covariance.tolist(),
        },
        "components": [
            {
                **attributes(one.effect, "name level owner"),
                "coefficients": [found.names[k] for k in one.effect.places],
                **attributes(one, "sd low high dof"),
            }
            for one in found.components
        ],
        "sessions": [
            {
                **attributes(one, "label day mount turn_on"),
                "recording_sha256": one.calibration.provenance.get("recording sha256", ""),
            }
            for one in matched.sessions
        ],
        "findings": list(found.findings),
    } | origin()


def _statement(one: StatedUncertainty, k: int) -> dict[str, float]:
    return {
        "scatter_std": float(one.scatter_std[k]),
        "shared_std": float(one.shared_std[k]),
        "U": float(one.expanded[k]),
    }


def next_use_calibration(found: Repeatability) -> Calibration:
    """Return the mean as a calibration, with U/2 of the next use as standard uncertainties.

    This calibration can correct readings and be exported like any other. Coefficients that not all
    sessions measured are omitted.
    """
    last = found.matched.sessions[-1].calibration
    sessions = [one.label for one in found.matched.sessions]
    return Calibration(
        replace(last.sensor, coefficients=found.names),
        found.values,
        found.next_use.covariance,
        method="repeat",
        conditions=last.conditions,
        provenance=origin() | {"sessions": ", ".join(sessions)},
        notes=(
            f"mean of {format_count(len(sessions), 'session')}; U is for the next use on another "
            f"{found.scope} and includes the errors that the sessions share",
            *found.findings,
        ),
        frame=last.frame,
        mount=last.mount,
        shared=None,
    )
