"""Live estimation: the sequential estimator of the method processes the samples of a run."""

from collections.abc import Mapping
from functools import partial
from math import nan

import numpy as np

from inercal.basics.errors import InputError
from inercal.host.assembly import SampleBlock
from inercal.methods import METHODS, PartialEstimate
from inercal.runfile import Run


class LiveEstimator:
    """The estimate of an active run.

    Parameters
    ----------
    run : Run
        By a method that has a sequential estimator.

    Attributes
    ----------
    names : tuple of p str
        The coefficients, in the sensor's order.
    time : float
        s of the recording, of the last sample; NaN before the first.
    partial_estimates : mapping of str to PartialEstimate
        By part of the sensor, "f" and "w" or "all"; empty before the estimator begins.
    values, std : (p,) arrays
        The coefficients and their standard deviations, SI; NaN where nothing is estimated yet.

    Raises
    ------
    InputError
        A method without a sequential estimator, no sampling rate, or what the estimator refuses.
    """

    def __init__(self, run: Run):
        begin, rate_hz = run.method.sequential, run.rate_hz
        if begin is None:
            able = [name for name, one in METHODS.items() if one.sequential is not None]
            raise InputError(
                f"{run.path}: [method] name: {run.method.name} cannot estimate during a run; "
                f"possible: {', '.join(able)}",
                file=run.path,
                key="[method] name",
                names=(run.method.name,),
            )
        if rate_hz is None:
            raise InputError(
                f'{run.path}: [data] rate is missing; add it, such as rate = "200 Hz"',
                file=run.path,
                key="[data] rate",
            )
        self.names, self.time = run.sensor.coefficients, nan
        self._indices: dict[tuple[str, ...], list[int]] = {}  # of names of parts
        self._start_estimator = partial(
            begin, run.estimator, run.sensor, run.bench, run.steps, run.priors, rate_hz
        )
        self._sequential = self._start_estimator()
        self._store_estimates({})

    @property
    def has_estimate(self) -> bool:
        """Whether there is an estimate."""
        return bool(self.partial_estimates)

    @property
    def innovations(self) -> dict[str, tuple[float, int]]:
        """Of each part the sum of innovations squared over what was stated, of how many."""
        return {part: (one.nis, one.components) for part, one in self.partial_estimates.items()}

    def feed(self, block: SampleBlock) -> None:
        """Take in the samples that follow.

        Raises
        ------
        InputError
            Samples that the estimator cannot follow.
        """
        if block.starts_recording:
            self._sequential = self._start_estimator()
        self.time = float(block.time[-1])
        self._sequential.feed(block.estimator_track)
        self._store_estimates(self._sequential.estimate())

    def _store_estimates(self, found: Mapping[str, PartialEstimate]) -> None:
        self.partial_estimates = dict(found)
        self.values, self.std = np.full((2, len(self.names)), nan)
        for one in self.partial_estimates.values():
            if one.names not in self._indices:
                self._indices[one.names] = [self.names.index(name) for name in one.names]
            at = self._indices[one.names]
            self.values[at] = one.value
            self.std[at] = np.sqrt(np.diagonal(one.covariance))
