"""Expected uncertainties of a path for a method that uses no angle of the table.

A sensor without errors but for its white noise records the path on an ideal table; the method finds
the rests in its gyros.
"""

from dataclasses import replace

import numpy as np

from inercal.benches.turntable import Turntable
from inercal.benches.turntable.attitude import reference_attitude
from inercal.benches.turntable.reading.still_table_observation import find_rests
from inercal.design.expected_uncertainty import ExpectedUncertainty, estimated_uncertainties
from inercal.errors import InputError
from inercal.methods.systematic.vertical_turns import vertical_turn_messages
from inercal.recording import Observations, Track
from inercal.runfile import Run


def still_table_uncertainties(
    run: Run, bench: Turntable, track: Track
) -> tuple[tuple[ExpectedUncertainty, ...], tuple[str, ...]]:
    """Return the expected uncertainties, and warnings of turns about the vertical.

    Parameters
    ----------
    run : Run
    bench : Turntable
        Ideal.
    track : Track
        Of the whole path.

    Raises
    ------
    InputError
        A path without rests.
    NotObserved
        Coefficients that the path leaves open.
    """
    noises = [axis.noise.white for axis in run.sensor.axes]
    # Readings without noise stay at one value in a rest, as those of coarse steps do.
    drawn = np.random.default_rng(0).standard_normal(track.reading.shape)
    root_rate = (track.time.size / max(float(np.ptp(track.time)), 1e-9)) ** 0.5
    track = replace(track, reading=track.reading + root_rate * np.array(noises) * drawn)
    rests = find_rests(track.time, track.reading, run.sensor)
    if not len(rests):
        raise InputError("the path has no rest of 5 s; add positions", key="[method] path")
    spans = [slice(start, stop) for start, stop in rests.tolist()]
    hold = np.full(track.time.size, -1, dtype=np.int64)
    for k, span in enumerate(spans):
        hold[span] = k
    labels = tuple(f"rest {k}" for k in range(1, len(spans) + 1))
    white = np.diag(np.array(noises) ** 2)
    seconds = np.array([float(np.ptp(track.time[span])) for span in spans])
    observations = Observations(
        labels=labels,
        mean=np.stack([track.reading[span].mean(axis=0) for span in spans]),
        covariance=white / seconds[:, None, None],
        duration=seconds,
        samples=np.diff(rests, axis=1)[:, 0],
        time=np.array([float(track.time[span].mean()) for span in spans]),
        channels=run.sensor.channels,
        track=Track(track.time, track.reading, track.angles, hold),
    )
    estimate = run.solver()(observations, run.sensor, bench, (), run.priors)
    attitudes = np.stack(
        [reference_attitude(bench, track.angles[(s.start + s.stop) // 2][None])[0] for s in spans]
    )
    return estimated_uncertainties(estimate, run.sensor), vertical_turn_messages(attitudes, labels)
