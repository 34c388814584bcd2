"""The two filters as the estimators have them."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Gaussian
from inercal.methods.turntable import model
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable_kalman.accelerometers import STILL, Accelerometers
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.recording import Track
from inercal.sensors import Sensor

Kind = Literal["w", "f"]
KINDS: tuple[Kind, ...] = ("w", "f")  # gyros, accelerometers
_SOURCES_STILL = 1e-3  # m/s


class FilterConfig(NamedTuple):
    """Which states the filters have, and how far attitude and velocity at rest are trusted."""

    drifting: bool
    table: bool  # right angles and harmonics in the gyros' filter
    holding_table: Literal["whole", "lean", "exact"]  # in the accelerometers'
    source: tuple[float, float] | None  # rad, of the attitude in each filter; None is the bench's
    still: float  # m/s

    def readback(self, bench: Turntable) -> tuple[float, float | None]:
        """Return what the gyros' and the accelerometers' filter take of the readback, rad."""
        return self.source or (max(bench.white, model.FLOOR), None)

    def filter(
        self,
        kind: Kind,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Sequence[Gaussian] = (),
        lasting: float | None = None,
    ) -> Gyros | Accelerometers:
        """Return the filter of the gyros ("w") or of the accelerometers ("f").

        Arguments as of `Gyros.of`, which say what is refused, and `Accelerometers.of`.
        """
        gyros, accelerometers = self.readback(bench)
        if kind == "w":
            return Gyros.of(
                sensor, bench, track, priors,
                drifting=self.drifting, table=self.table, readback=gyros, lasting=lasting,
            )  # fmt: skip
        return Accelerometers.of(
            sensor, bench, track, priors,
            drifting=self.drifting, table=self.holding_table, readback=accelerometers,
            still=self.still, lasting=lasting,
        )  # fmt: skip


WAYS: Mapping[str, FilterConfig] = {
    "full": FilterConfig(True, True, "whole", None, STILL),
    "drift": FilterConfig(True, False, "lean", (4 * ARCSEC, ARCSEC), _SOURCES_STILL),
    "paper": FilterConfig(False, False, "exact", (10 * ARCSEC, 10 * ARCSEC), _SOURCES_STILL),
}
