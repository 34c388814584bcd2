"""A method of another package: one accelerometer on a centrifuge, at known angles on the arm."""

from dataclasses import replace
from math import pi
from typing import Literal

from inercal.benches import Centrifuge
from inercal.benches.centrifuge.kind import KIND as CENTRIFUGE
from inercal.benches.centrifuge.kind import CentrifugeSection
from inercal.benches.stated_axes import any_axes
from inercal.methods import Method
from inercal.methods.mean_problem import joint
from inercal.physics.plan import Spin, arm_attitude


def plan(rates: tuple[float, ...] = (4 * pi, 8 * pi), seconds: float = 60.0) -> tuple[Spin, ...]:
    """Return dwells with the axis outward, inward and up, at each rate, rad/s."""
    places = {"outward": (0.0, 0.0), "inward": (pi, 0.0), "up": (0.0, pi / 2)}
    return tuple(
        Spin(f"{name} {30 * rate / pi:.0f}", rate, seconds, arm_attitude(*angles))
        for name, angles in places.items()
        for rate in rates
    )


class OneAxisSection(CentrifugeSection):
    """[bench], with the keys of a centrifuge."""

    kind: Literal["one_axis_arm"]  # pyright: ignore[reportIncompatibleVariableOverride]


KIND = replace(CENTRIFUGE, name="one_axis_arm", section=OneAxisSection, sensor=any_axes)
METHOD = Method(
    name="centrifuge_axis",
    bench=Centrifuge,
    default_coefficients={"f": ("bias", "scale", "k2")},
    also={"f": ("k3",)},
    needs=("f",),
    plan=plan,
    estimators={"joint": joint},
    source="means of one accelerometer at known angles on the arm",
)
