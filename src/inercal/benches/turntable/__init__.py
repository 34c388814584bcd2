"""The bench of a turntable of one to three axes."""

from pathlib import Path
from typing import Any, Protocol, TypeGuard

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.settings import TurntableData
from inercal.errors import InputError


class _Run(Protocol):
    @property
    def path(self) -> Path: ...
    @property
    def bench(self) -> Any: ...
    @property
    def data(self) -> Any: ...


def turntable_of(run: _Run) -> Turntable:
    """Return the bench of a run that must be a turntable.

    Raises
    ------
    InputError
        It is another.
    """
    if not isinstance(run.bench, Turntable):
        raise InputError(f'{run.path}: [bench] kind must be "turntable" here')
    return run.bench


def is_turntable(bench: object) -> TypeGuard[Turntable]:
    """Return whether a bench is a turntable, for what is drawn of its axes."""
    return isinstance(bench, Turntable)


def data_of(run: _Run) -> TurntableData:
    """Return [data] of a run that must be on a turntable.

    Raises
    ------
    InputError
        It is on another bench.
    """
    turntable_of(run)
    return run.data


__all__ = ["Turntable", "TurntableData", "data_of", "is_turntable", "turntable_of"]
