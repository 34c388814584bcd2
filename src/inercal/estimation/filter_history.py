"""The estimates and innovations of a sequential estimator, epoch by epoch."""

from dataclasses import dataclass

from inercal.basics.arrays import Array, Indices
from inercal.estimation.lazy_value import LazyValue


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """States that vary with time: their smoothed estimates from all epochs.

    Parameters
    ----------
    names : tuple of r str
    value, std : (k, r) arrays
        At the epochs of `FilterHistory.shown`.
    """

    names: tuple[str, ...]
    value: Array
    std: Array


@dataclass(frozen=True, eq=False)
class FilterHistory:
    """The estimates of one filter over a run.

    Parameters
    ----------
    name : str
        Of the filter.
    names : tuple of n str
        Of the estimated states.
    time : (e,) array
        s, of each epoch.
    value, std : (k, n) arrays
        Estimates and standard deviations after the epochs `shown`.
    innovation : (e, q) array
        Observation minus prediction.
    nis : (e,) array
        Normalised innovation squared of q components; its mean is q where the model holds.
    smoothing : LazyValue of SmoothedStates or None
        None if no state is smoothed.
    shown : (k,) array of int or None
        Epochs that estimates are kept of, evenly spaced and the last; None is each of them.
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
        """Times of the epochs that estimates are kept of, (k,) s."""
        return self.time if self.shown is None else self.time[self.shown]
