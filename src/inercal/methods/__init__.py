"""Calibration methods by name, and the residuals that they share."""

from typing import Any

from inercal.basics.registry import Registry
from inercal.methods._base import (
    Fit,
    Method,
    PartialEstimate,
    Remarks,
    Sequential,
    SequentialEstimator,
)

METHODS: Registry[Method[Any, Any]] = Registry(
    "inercal.methods",
    "method",
    {
        name: f"inercal.methods.{name}:METHOD"
        for name in (
            "six_position",
            "ferraris",
            "multi_position",
            "centrifuge_norm",
            "dual_orthogonal",
            "tumble",
            "ship_planar",
            "ship_multi_angle",
            "rates_and_poses",
            "turntable_kalman",
            "turntable_discrete",
            "turntable_trajectory",
            "systematic",
            "temperature_ramp",
        )
    },
)


def method(name: str) -> Method[Any, Any]:
    """Return a method by name, with hyphens or underscores.

    Raises
    ------
    InputError
        No method has this name; the message lists the methods.
    """
    return METHODS.find(name.replace("-", "_"))


__all__ = [
    "METHODS",
    "Fit",
    "Method",
    "PartialEstimate",
    "Remarks",
    "Sequential",
    "SequentialEstimator",
    "method",
]
