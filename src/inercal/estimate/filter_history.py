"""What a sequential estimator found on its way, epoch after epoch."""

from dataclasses import dataclass

from inercal.arrays import Array


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """States that vary, at each epoch of a course, as all its epochs together say.

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
    """The course of one filter.

    Parameters
    ----------
    name : str
        Of the filter.
    names : tuple of n str
        Of what it estimates.
    time : (e,) array
        s, of each epoch.
    value, std : (e, n) arrays
        Estimates and standard deviations after the epoch.
    innovation : (e, q) array
        What was observed beyond what was expected.
    nis : (e,) array
        Normalised innovation squared of q components: q on the average, where all is as stated.
    smoothed : SmoothedStates or None
        None where it was not asked for.
    """

    name: str
    names: tuple[str, ...]
    time: Array
    value: Array
    std: Array
    innovation: Array
    nis: Array
    smoothed: SmoothedStates | None = None
