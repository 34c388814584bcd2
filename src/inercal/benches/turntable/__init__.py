"""Describe a turntable with one to three axes as a bench."""

from typing import Any, TypeGuard

from inercal.benches.turntable.bench import Turntable
from inercal.physics.section_settings import key_error
from inercal.recordings.data import RunBase


def require_turntable(run: RunBase[Any]) -> Turntable:
    """Return the bench of a run, which must be a turntable.

    Raises
    ------
    InputError
        The bench is not a turntable.
    """
    if not isinstance(run.bench, Turntable):
        raise key_error("[bench] kind", 'must be "turntable" here', run.path)
    return run.bench


def is_turntable(bench: object) -> TypeGuard[Turntable]:
    """Return whether a bench is a turntable, whose axes can be drawn."""
    return isinstance(bench, Turntable)


__all__ = ["Turntable", "is_turntable", "require_turntable"]
