"""Calibration methods by name."""

from typing import Any

from inercal.errors import InputError
from inercal.methods import centrifuge_norm, ferraris, multi_position, six_position
from inercal.methods._base import Method

_ALL: tuple[Method[Any, Any], ...] = (
    six_position.METHOD,
    ferraris.METHOD,
    multi_position.METHOD,
    centrifuge_norm.METHOD,
)
METHODS = {method.name: method for method in _ALL}


def method(name: str) -> Method[Any, Any]:
    """Return a method by name.

    Raises
    ------
    InputError
        No such method; the message lists those there are.
    """
    if name not in METHODS:
        raise InputError(f"no method {name!r}; there are {', '.join(METHODS)}")
    return METHODS[name]


__all__ = ["METHODS", "Method", "method"]
