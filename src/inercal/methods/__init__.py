"""Calibration methods by name."""

from collections.abc import Mapping
from typing import Any

from inercal.errors import InputError
from inercal.methods import (
    centrifuge_norm,
    dual_orthogonal,
    ferraris,
    multi_position,
    ship_multi_angle,
    ship_planar,
    six_position,
    tumble,
    turntable_discrete,
    turntable_kalman,
    turntable_trajectory,
)
from inercal.methods._base import Method

METHODS: Mapping[str, Method[Any, Any]] = {
    module.METHOD.name: module.METHOD
    for module in (
        six_position,
        ferraris,
        multi_position,
        centrifuge_norm,
        dual_orthogonal,
        tumble,
        ship_planar,
        ship_multi_angle,
        turntable_kalman,
        turntable_discrete,
        turntable_trajectory,
    )
}


def method(name: str) -> Method[Any, Any]:
    """Return a method by name, hyphens being as good as underscores.

    Raises
    ------
    InputError
        No such method; the message lists those there are.
    """
    name = name.replace("-", "_")
    if name not in METHODS:
        raise InputError(f"no method {name!r}; there are {', '.join(METHODS)}")
    return METHODS[name]


__all__ = ["METHODS", "Method", "method"]
