"""Six-position test, in which each input axis points up and then down in local gravity.

Gyros, if there are any, are read at the same rests. The bias of a gyro is its mean reading minus
the earth's rate, whose level part has an unknown azimuth. Its sensitivity to gravity is half the
difference between the readings up and down.

Source: IEEE Std 1293, static multipoint test reduced to six points; closed formulas from Ferraris
et al. 1995.
"""

from typing import Any

from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import Fit, Method, Remarks
from inercal.methods.ferraris import classical
from inercal.methods.hand_likelihood import ml
from inercal.methods.order_effects import order_remarks
from inercal.physics.plan import six_positions
from inercal.physics.sensors import Sensor


def _add_magnetometers(fit: Fit[Hand, Any], field: Sensor) -> tuple[Estimate, Remarks]:
    from inercal.methods.magnetic_field.stage import add_magnetometers  # loads scipy.optimize

    return add_magnetometers(fit, field)


METHOD = Method(
    name="six_position",
    bench=Hand,
    default_coefficients={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "g"),
        "m": ("bias", "scale", "misalignment"),
    },
    also={
        "f": ("temperature", "temperature_order"),
        "w": ("bias_dT", "bias_dT2", "bias_dT3"),
        "m": ("temperature",),
    },
    needs=("f",),
    plan=six_positions,
    estimators={"ml": ml, "classical": classical},
    closed_formulas=("classical",),
    weighs_common_errors=True,
    remarks=order_remarks,
    add_magnetometers=_add_magnetometers,
    source="IEEE Std 1293, static multipoint test; Ferraris et al. 1995",
)
