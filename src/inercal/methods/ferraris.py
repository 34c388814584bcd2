"""Six positions and three turns: accelerometers, gyros and the gyros' sensitivity to gravity.

Gyros alone take the positions as stated; the mean force in a turn, which nothing reads, is gravity
along the axis.

Source: F. Ferraris, U. Grimaldi, M. Parvis, Sensors and Materials 7(5), 1995, 311–330.
"""

from inercal.benches import Hand
from inercal.methods._base import Method
from inercal.methods.ferraris_formulas import classical
from inercal.methods.hand_likelihood import ml
from inercal.methods.order_effects import order_remarks
from inercal.physics.plan import ferraris_plan

METHOD = Method(
    name="ferraris",
    bench=Hand,
    default_coefficients={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "scale", "misalignment", "g"),
    },
    also={"f": ("temperature", "temperature_order"), "w": ("temperature", "temperature_order")},
    needs=("w",),
    plan=ferraris_plan,
    estimators={"ml": ml, "classical": classical},
    weighs_common_errors=True,
    remarks=order_remarks,
    source="Ferraris, Grimaldi, Parvis, Sensors and Materials 7(5), 1995",
)
