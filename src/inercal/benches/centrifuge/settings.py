"""Define [bench] and [data] for a precision centrifuge, and build the bench in SI."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.section_settings import (
    PLANNING,
    BenchSection,
    BenchUsage,
    key_error,
    section_constant,
    section_deviation,
    section_length,
    si_value,
)
from inercal.recordings.data import DataSection, ReadbackColumn, unit_size


@add_bench_keys(Centrifuge, after={"platform": "dwell_tilt"})
class CentrifugeSection(BenchSection):
    """Section [bench] for a precision centrifuge."""

    kind: Literal["centrifuge"]
    radius: str = Field(examples=["1 m ± 10 µm"])
    platform: Literal["locked", "counter-rotating"] = "locked"
    sense: Literal["counter-clockwise", "clockwise"] = "counter-clockwise"
    indexing: str | None = Field(
        None, description="angles of each attitude, if attitudes are known", examples=["0.02 °"]
    )
    max_acceleration: str = Field(
        "3 rad/s²",
        description="angular acceleration of the arm between its rates",
        json_schema_extra=PLANNING,
    )

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        found: dict[str, str] = {}
        if self.platform == "locked":
            found["lean"] = (
                "on a locked platform the spindle's tilt averages to zero over whole turns"
            )
        if self.indexing is None:
            found["mounting"] = (
                "without indexing only norms are used, and mounting does not affect them"
            )
        if self.latitude is None and self.platform == "locked" and self.indexing is None:
            found["sense"] = "without latitude the sense of the earth's rate is not used"
        return found


class CentrifugeData(DataSection):
    """Section [data] for a precision centrifuge, in which each row is a dwell of the arm."""

    arm_rate: str | int = Field(description="column of the arm's rate", examples=["rate"])
    arm_rate_unit: str = Field(
        "rpm", description="unit of the rate, or its size such as '0.5 rev/s'"
    )
    attitude: tuple[str | int, str | int] | None = Field(
        None, description="for means: columns of ψ and θ", examples=[["psi", "theta"]]
    )
    attitude_unit: str = "°"

    def readback(self, bench: Centrifuge) -> tuple[ReadbackColumn, ...]:
        """Return the columns with the rate of the arm and the attitudes."""
        rate = unit_size(self.arm_rate_unit, "rad/s", "arm_rate_unit")
        found = (ReadbackColumn("arm_rate", str(self.arm_rate), rate),)
        if self.attitude is None:
            return found
        angle = unit_size(self.attitude_unit, "°", "attitude_unit")
        psi, theta = map(str, self.attitude)
        return (*found, ReadbackColumn("psi", psi, angle), ReadbackColumn("theta", theta, angle))


def build(section: CentrifugeSection, folder: Path) -> Centrifuge:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    latitude = None
    if section.latitude is not None:
        latitude = section_constant(section, "latitude", "°")
        earth_rate_up_north(latitude.value)  # refuses an impossible latitude
    acceleration = si_value(section.max_acceleration, "rad/s²", "[bench] max_acceleration")
    if acceleration <= 0:
        raise key_error(
            "[bench] max_acceleration", f"{section.max_acceleration!r} must be positive"
        )
    return build_bench(
        Centrifuge,
        section,
        radius=section_length(section, "radius"),
        latitude=latitude,
        platform=section.platform,
        indexing=None if section.indexing is None else section_deviation(section, "indexing", "°"),
        sense=1 if section.sense == "counter-clockwise" else -1,
        acceleration=acceleration,
    )
