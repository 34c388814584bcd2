"""The states of both filters, as their kernels change them in place."""

from typing import TypeVar

from inercal.basics.arrays import Array
from inercal.methods.turntable_kalman import _accelerometers, _readback

_SCALAR_FIELDS = ("nis", "dof")  # of a state; all else is an array
S = TypeVar("S", _accelerometers.VelocityState, _readback.AttitudeState)


def copy_state(state: S) -> S:
    """Return a state of its own, which a kernel may change in place."""
    arrays: dict[str, Array] = {k: v for k, v in state._asdict().items() if k not in _SCALAR_FIELDS}
    return state._replace(**{name: array.copy() for name, array in arrays.items()})
