"""Calibration methods by name."""

from inercal.errors import InputError
from inercal.methods import ferraris, multi_position, six_position
from inercal.methods._base import Method

METHODS = {m.name: m for m in (six_position.METHOD, ferraris.METHOD, multi_position.METHOD)}


def method(name: str) -> Method:
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
