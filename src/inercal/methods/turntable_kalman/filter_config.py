"""Configure the two filters for each estimator: their states, P₀, R and epoch.

Q is not part of it, because it follows from the sensor's noise.
"""

from collections.abc import Mapping, Sequence
from math import degrees
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.methods import Priors
from inercal.methods.turntable import model
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable_kalman.accelerometers import (
    HOLD_ALIGNMENT_SD,
    REST_VELOCITY_SD,
    AccelerometerFilter,
)
from inercal.methods.turntable_kalman.gyros import ALIGNMENT_SD, GyroFilter
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Track

FilterKind = Literal["w", "f"]
FILTER_KINDS: tuple[FilterKind, ...] = ("w", "f")  # gyros, accelerometers
TableStates = Literal["whole", "lean", "exact"]
_SOURCE_VELOCITY_SD = 1e-3  # m/s
# Coefficient terms that a name in `FilterConfig.initial` stands for, by filter
INITIAL_TERMS: Mapping[str, tuple[FilterKind, tuple[str, ...]]] = {
    "gyro_bias": ("w", ("bias",)),
    "gyro_scale": ("w", ("scale",)),
    "gyro_misalignment": ("w", ("delta_o", "delta_p")),
    "accelerometer_bias": ("f", ("k0",)),
    "accelerometer_scale": ("f", ("k1",)),
    "accelerometer_misalignment": ("f", ("delta_o", "delta_p")),
}
ATTITUDE = "attitude"  # φ, in both filters
_ALIGNMENT_SD: Mapping[FilterKind, float] = {"w": ALIGNMENT_SD, "f": HOLD_ALIGNMENT_SD}
_MAX_EPOCH_REMAINDER = 0.05  # of a sample; sampling rates are not known better
_DISTURBED_STEP = 1.5  # median steps; in a longer step, samples were lost


class FilterConfig(NamedTuple):
    """The states of the filters, their standard deviations before the data, R and the epoch.

    Parameters
    ----------
    bias_drift : bool
        Whether biases drift.
    table_states : "whole", "lean" or "exact"
        Which errors of the table are states: all, some or none. "lean" means latency, clock and
        azimuth for the gyros, and the base's lean and an error of each hold's angles for the
        accelerometers.
    attitude_sd : tuple of 2 float or None
        Standard deviation of the attitude from the readback in each filter, gyros first, rad; None
        means that of the bench.
    velocity_sd : float
        Standard deviation of the velocity at rest, m/s.
    source_values : frozenset of str
        Which of "readback_sd" and "velocity_sd" are from the source and differ from the noise.
    epoch : float
        Time between epochs, s.
    initial : mapping of str to float
        Standard deviations before the data, SI, by `INITIAL_TERMS` and `ATTITUDE`. Missing values
        are those of `model.EXPECTED_SIZES` and of the filters.
    """

    bias_drift: bool
    table_states: TableStates
    attitude_sd: tuple[float, float] | None
    velocity_sd: float
    source_values: frozenset[str] = frozenset()
    epoch: float = model.EPOCH_PERIOD
    initial: Mapping[str, float] = MappingProxyType({})

    def readback_sd(self, bench: Turntable) -> tuple[float, float | None]:
        """Return the readback's standard deviation in the two filters, gyros first, rad."""
        return self.attitude_sd or (max(bench.white, model.READBACK_NOISE_FLOOR), None)

    def expected_sizes(self, kind: FilterKind) -> Mapping[str, float]:
        """Return the standard deviations of a filter's coefficients before the data, by term."""
        own = {
            term: self.initial[name]
            for name, (of, terms) in INITIAL_TERMS.items()
            if of == kind and name in self.initial
            for term in terms
        }
        return {**model.EXPECTED_SIZES, **own}

    def filter(
        self,
        kind: FilterKind,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Priors = (),
        run_duration: float | None = None,
    ) -> GyroFilter | AccelerometerFilter:
        """Return the gyro filter ("w") or the accelerometer filter ("f").

        The arguments and errors are as for `GyroFilter.from_track` and
        `AccelerometerFilter.from_track`.
        """
        gyros, accelerometers = self.readback_sd(bench)
        sizes = self.expected_sizes(kind)
        alignment = self.initial.get(ATTITUDE, _ALIGNMENT_SD[kind])
        if kind == "w":
            return GyroFilter.from_track(
                sensor, bench, track, priors,
                bias_drift=self.bias_drift, table=self.table_states, readback_sd=gyros,
                run_duration=run_duration, epoch=self.epoch, expected_sizes=sizes,
                alignment_sd=alignment,
            )  # fmt: skip
        return AccelerometerFilter.from_track(
            sensor, bench, track, priors,
            bias_drift=self.bias_drift, table=self.table_states, readback_sd=accelerometers,
            velocity_sd=self.velocity_sd, run_duration=run_duration, epoch=self.epoch,
            expected_sizes=sizes, alignment_sd=alignment,
        )  # fmt: skip

    def untested_reason(self, kind: FilterKind) -> str:
        """Return why the innovations do not test noise and table; empty if they do test them."""
        if "readback_sd" in self.source_values and self.attitude_sd is not None:
            sd = self.attitude_sd[FILTER_KINDS.index(kind)] / ARCSEC
            return f"the source's R, {sd:.3g}″, is not the noise of the readback"
        if kind == "f" and "velocity_sd" in self.source_values:
            sd = 1e3 * self.velocity_sd
            return f"the source's R, {sd:.3g} mm/s, is not the noise of the velocity at rest"
        return ""

    def describe(self) -> dict[str, str]:
        """Return the actual value of each key in [method.filter], as text with units."""
        sd = None if self.attitude_sd is None else [f"{x / ARCSEC:.6g}" for x in self.attitude_sd]
        sizes = {kind: self.expected_sizes(kind) for kind in FILTER_KINDS}
        start = {name: sizes[kind][terms[0]] for name, (kind, terms) in INITIAL_TERMS.items()}
        attitude = [
            self.initial.get(ATTITUDE, _ALIGNMENT_SD[kind]) / ARCSEC for kind in FILTER_KINDS
        ]
        return {
            "readback_sd": "[bench] noise" if sd is None else f"{_both(sd)} ″",
            "velocity_sd": f"{1e3 * self.velocity_sd:.6g} mm/s",
            "epoch": f"{self.epoch:.4g} s",
            "bias_drift": str(self.bias_drift).lower(),
            "table_states": self.table_states,
            "initial.gyro_bias": f"{3600 * degrees(start['gyro_bias']):.6g} °/h",
            "initial.gyro_scale": f"{1e6 * start['gyro_scale']:.6g} ppm",
            "initial.gyro_misalignment": f"{degrees(start['gyro_misalignment']) * 60:.6g} ′",
            "initial.accelerometer_bias": f"{1e3 * start['accelerometer_bias'] / G0:.6g} mg",
            "initial.accelerometer_scale": f"{1e6 * start['accelerometer_scale']:.6g} ppm",
            "initial.accelerometer_misalignment": (
                f"{degrees(start['accelerometer_misalignment']) * 60:.6g} ′"
            ),
            "initial.attitude": f"{_both([f'{x:.4g}' for x in attitude])} ″",
        }

    def describe_changes(self, estimator: str) -> str:
        """Describe the values that differ from the estimator's defaults; empty if none does."""
        own = FILTER_CONFIGS[estimator].describe()
        return "; ".join(
            f"{key} {text} (default {own[key]})"
            for key, text in self.describe().items()
            if text != own[key]
        )


def _both(texts: Sequence[str]) -> str:
    """Return the numbers for both filters as text, gyros first, or one number if they are equal."""
    return " and ".join(dict.fromkeys(texts))


_SOURCE_VALUES = frozenset({"readback_sd", "velocity_sd"})
FILTER_CONFIGS: Mapping[str, FilterConfig] = {
    "full": FilterConfig(True, "whole", None, REST_VELOCITY_SD),
    "drift": FilterConfig(True, "lean", (4 * ARCSEC, ARCSEC), _SOURCE_VELOCITY_SD, _SOURCE_VALUES),
    "paper": FilterConfig(
        False, "exact", (10 * ARCSEC, 10 * ARCSEC), _SOURCE_VELOCITY_SD, _SOURCE_VALUES
    ),
}


def filter_conditions(config: FilterConfig, estimator: str) -> dict[str, str]:
    """Return the actual values, and those that differ from the defaults, as conditions."""
    found = {"filter": "; ".join(f"{key} {text}" for key, text in config.describe().items())}
    changed = config.describe_changes(estimator)
    return found | ({"filter keys changed": changed} if changed else {})


def require_whole_epoch(epoch: float, step: float) -> None:
    """Raise InputError if an epoch other than the default is not a whole number of samples.

    Parameters
    ----------
    epoch, step : float
        Duration of an epoch, and time between samples, s.

    Raises
    ------
    InputError
    """
    samples = epoch / step
    whole = max(round(samples), 1)
    if epoch != model.EPOCH_PERIOD and abs(samples - whole) > _MAX_EPOCH_REMAINDER:
        raise InputError(
            f"[method.filter] epoch: {epoch:.4g} s is {samples:.4g} samples at {1 / step:.5g} Hz; "
            f"give a whole number of samples, such as {whole * step:.4g} s",
            key="[method.filter] epoch",
        )


def sampling_step(track: Track) -> float:
    """Return the mean time between samples over steps in which no sample was lost, s."""
    steps = np.diff(track.time)
    return float(np.mean(steps[steps < _DISTURBED_STEP * np.median(steps)]))
