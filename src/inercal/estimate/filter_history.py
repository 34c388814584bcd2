"""The estimates and innovations of a sequential estimator, epoch by epoch."""

from dataclasses import dataclass

from inercal.arrays import Array


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """States that vary with time: their smoothed estimates at each epoch, from all epochs.

    Parameters
    ----------
    names : tuple of r str
    value, std : (e, r) arrays
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
    value, std : (e, n) arrays
        Estimates and standard deviations after the epoch.
    innovation : (e, q) array
        Observation minus prediction.
    nis : (e,) array
        Normalised innovation squared of q components; its mean is q where the model holds.
    smoothed : SmoothedStates or None
        None where no state was smoothed.
    """

    name: str
    names: tuple[str, ...]
    time: Array
    value: Array
    std: Array
    innovation: Array
    nis: Array
    smoothed: SmoothedStates | None = None
