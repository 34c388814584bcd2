"""Store the estimates and innovations of a sequential estimator at each epoch."""

from dataclasses import dataclass

from inercal.basics.arrays import Array, Indices
from inercal.estimation.lazy_value import LazyValue


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """Smoothed estimates, from all epochs, of states that vary with time.

    Parameters
    ----------
    names : tuple of r str
    value, std : (k, r) arrays
        Estimates and standard deviations at the epochs `FilterHistory.shown`.
    """

    names: tuple[str, ...]
    value: Array
    std: Array


@dataclass(frozen=True, eq=False)
class FilterHistory:
    """The estimates and innovations of one filter over a run.

    Parameters
    ----------
    name : str
        Name of the filter.
    names : tuple of n str
        Names of the estimated states.
    time : (e,) array
        Time of each epoch, s.
    value, std : (k, n) arrays
        Estimates and standard deviations after the epochs `shown`.
    innovation : (e, q) array
        Observation minus prediction.
    nis : (e,) array
        Normalised innovation squared over q components; its mean is q if the model is right.
    smoothing : LazyValue of SmoothedStates or None
        None if no state is smoothed.
    shown : (k,) array of int or None
        Epochs whose estimates are kept: evenly spaced ones and the last; None means all epochs.
    """

    name: str
    names: tuple[str, ...]
    time: Array
    value: Array
    std: Array
    innovation: Array
    nis: Array
    smoothing: LazyValue[SmoothedStates] | None = None
    shown: Indices | None = None

    @property
    def smoothed(self) -> SmoothedStates | None:
        """The smoothed states; None if no state is smoothed."""
        return self.smoothing and self.smoothing()

    @property
    def shown_time(self) -> Array:
        """Times of the epochs whose estimates are kept, (k,) s."""
        return self.time if self.shown is None else self.time[self.shown]
