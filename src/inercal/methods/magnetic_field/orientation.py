"""The sign of the field and the axes of the magnetometer.

(D, δ) and (−D, −δ) fit every recording equally well: the field is reversed, and with it all axes.
The sign of the dip (the hemisphere) decides, or else the assumption that the magnetometer is
right-handed relative to its stated axes. The other fact is then a test. A wrong sign of the
accelerometers has the same effect as a reversed field.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.methods.magnetic_field.records import FieldConditions, LinearModel
from inercal.methods.magnetic_field.rows import FieldState
from inercal.physics.soft_iron import axis_names, nearest_axes

_SURE = 3.0  # standard deviations of the dip, below which its sign is unknown
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def oriented(
    model: LinearModel, state: FieldState, conditions: FieldConditions, dip_sd: float
) -> tuple[FieldState, tuple[str, ...]]:
    """Return the state with the right sign of the field, and remarks.

    Parameters
    ----------
    model, state, conditions
    dip_sd : float
        Standard uncertainty of the dip, rad; infinite if the dip is not an unknown.

    Raises
    ------
    InputError
        The axes are not the stated ones, or the accelerometers have the wrong sign.
    """
    state = _principal(state)
    seen = abs(state.dip) > _SURE * dip_sd
    by_dip = seen and conditions.sign != 0
    right = state.dip * conditions.sign > 0 if by_dip else _determinant(model, state) > 0
    if not right:
        state = _mirrored(model, state)
    hemisphere = "northern" if state.dip > 0 else "southern"
    turn = _relative_axes(model, state)
    axes = nearest_axes(turn / np.linalg.norm(turn, axis=1, keepdims=True))
    if _determinant(model, state) < 0:
        raise InputError(
            f"in the {hemisphere} hemisphere, these data need a magnetometer that is left-handed"
            " relative to its stated axes: an axis is reversed, two axes are exchanged, or the"
            " accelerometers have the wrong sign (gravity instead of specific force)"
            f"{_axes_that_fit(model, axes)}",
            key="axis",
        )
    if not np.array_equal(axes, np.eye(3)):
        other = "" if by_dip else ", or the reverse of all three in the other hemisphere"
        raise InputError(
            f"the magnetometer's axes are not the stated ones{_axes_that_fit(model, axes)}{other}",
            key="axis",
        )
    if by_dip:
        return state, ()
    assumed = "The sign of the field follows from the magnetometer's axes, taken as stated"
    if not np.isfinite(dip_sd):
        return state, (f"{assumed}.",)
    if not seen:
        return state, (f"{assumed}, because the field is too nearly horizontal to show it.",)
    return state, (f"{assumed}; they place the recording in the {hemisphere} hemisphere.",)


def _principal(state: FieldState) -> FieldState:
    """Return the same state with a dip between −90° and 90°."""
    dip = float(np.arctan2(np.sin(state.dip), np.cos(state.dip)))
    if abs(dip) <= np.pi / 2:
        return state._replace(dip=dip)
    dip = float(np.copysign(np.pi, dip) - dip)
    return state._replace(dip=dip, attitude=_HALF_TURN @ state.attitude)


def _mirrored(model: LinearModel, state: FieldState) -> FieldState:
    """Return the state with the reversed field."""
    e = model.scale_direction
    coefficients = np.where(model.acts_on_field, -state.coefficients - 2 * e, state.coefficients)
    # −h has the same height with the opposite sign, and its azimuth is turned by 180°.
    return state._replace(
        coefficients=coefficients, dip=-state.dip, attitude=_HALF_TURN @ state.attitude
    )


def _relative_axes(model: LinearModel, state: FieldState) -> Array:
    matrix = model.matrices(state.coefficients, np.zeros(1))[0, :, :3]
    return matrix @ np.linalg.inv(model.nominal[:, :3])


def _determinant(model: LinearModel, state: FieldState) -> float:
    return float(np.linalg.det(_relative_axes(model, state)))


def _axes_that_fit(model: LinearModel, axes: Array) -> str:
    """Return words for the axes that fit, if the stated axes are those of the body."""
    stated = model.nominal[:, :3] / np.linalg.norm(model.nominal[:, :3], axis=1, keepdims=True)
    rows: Array = np.asarray(np.round(axes @ stated, 6), dtype=np.float64)
    if not np.all(np.isin(rows, (-1.0, 0.0, 1.0))):
        return ""
    names = ", ".join(f'"{name}"' for name in axis_names(rows))
    return f"; axis = [{names}] fits"
