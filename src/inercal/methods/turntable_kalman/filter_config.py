"""The configuration of the two filters for each estimator."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Gaussian
from inercal.methods.turntable import model
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable_kalman.accelerometers import REST_VELOCITY_SD, AccelerometerFilter
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recording import Track
from inercal.sensors import Sensor

FilterKind = Literal["w", "f"]
FILTER_KINDS: tuple[FilterKind, ...] = ("w", "f")  # gyros, accelerometers
_SOURCE_VELOCITY_SD = 1e-3  # m/s


class FilterConfig(NamedTuple):
    """The states of the filters, and the standard deviations of attitude and velocity at rest."""

    bias_drift: bool
    table: bool  # right angles and harmonics in the gyros' filter
    accelerometer_table: Literal["whole", "lean", "exact"]  # of the accelerometers' filter
    # rad, of the attitude in each filter; None is that of the bench
    source_readback_sd: tuple[float, float] | None
    velocity_sd: float  # m/s

    def readback_sd(self, bench: Turntable) -> tuple[float, float | None]:
        """Return the readback's standard deviation in the two filters, rad; gyros first."""
        return self.source_readback_sd or (max(bench.white, model.READBACK_NOISE_FLOOR), None)

    def filter(
        self,
        kind: FilterKind,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Sequence[Gaussian] = (),
        run_duration: float | None = None,
    ) -> GyroFilter | AccelerometerFilter:
        """Return the filter of the gyros ("w") or of the accelerometers ("f").

        Arguments and errors as of `GyroFilter.from_track` and `AccelerometerFilter.from_track`.
        """
        gyros, accelerometers = self.readback_sd(bench)
        if kind == "w":
            return GyroFilter.from_track(
                sensor, bench, track, priors,
                bias_drift=self.bias_drift, table=self.table, readback_sd=gyros,
                run_duration=run_duration,
            )  # fmt: skip
        return AccelerometerFilter.from_track(
            sensor, bench, track, priors,
            bias_drift=self.bias_drift, table=self.accelerometer_table, readback_sd=accelerometers,
            velocity_sd=self.velocity_sd, run_duration=run_duration,
        )  # fmt: skip


FILTER_CONFIGS: Mapping[str, FilterConfig] = {
    "full": FilterConfig(True, True, "whole", None, REST_VELOCITY_SD),
    "drift": FilterConfig(True, False, "lean", (4 * ARCSEC, ARCSEC), _SOURCE_VELOCITY_SD),
    "paper": FilterConfig(False, False, "exact", (10 * ARCSEC, 10 * ARCSEC), _SOURCE_VELOCITY_SD),
}
