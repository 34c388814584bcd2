"""Six positions and three turns: accelerometers, gyros and the gyros' sensitivity to gravity.

Source: F. Ferraris, U. Grimaldi, M. Parvis, Sensors and Materials 7(5), 1995, 311–330.
"""

from inercal.benches import Hand
from inercal.methods._base import Method
from inercal.methods.classical import classical
from inercal.methods.means import ml
from inercal.plan import ferraris

METHOD = Method(
    name="ferraris",
    bench=Hand,
    finds={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "scale", "misalignment", "g"),
    },
    also={"f": ("temperature",), "w": ("temperature",)},
    needs=("f", "w"),
    plan=ferraris,
    estimators={"ml": ml, "classical": classical},
    source="Ferraris, Grimaldi, Parvis, Sensors and Materials 7(5), 1995",
)
