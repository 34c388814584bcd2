"""Recordings of `systematic_table` as observations of the method, and their estimates."""

from typing import Any

import numpy as np
from tests.methods import systematic_table as made

from inercal.basics.units import Measured
from inercal.benches.turntable.bench import StillTable
from inercal.benches.turntable.reading.still_table_observation import find_rests
from inercal.estimation import Estimate
from inercal.methods import method
from inercal.physics.sensors import Noise, Readout, Sensor, imu
from inercal.recordings import Observations, Track

METHOD = method("systematic")


def sensor_of(
    grade: made.Grade, drift: str = "markov", also: Any = (), coefficients: Any = ()
) -> Sensor:
    """Return an IMU with the noise of a grade and the coefficients of the method."""
    correlation = 300.0 if drift == "markov" else 0.0
    size = 0.0 if drift == "none" else 1.0
    force, rate = (
        Noise(
            white=white,
            bias_instability=size * sd,
            correlation=size * correlation,
        )
        for white, sd in (
            (grade.force_white, grade.force_drift),
            (grade.gyro_white, grade.gyro_drift),
        )
    )
    return METHOD.prepare(imu("imu", (Readout(), force), (Readout(), rate)), coefficients, also)


def observations_of(recorded: made.Recorded, sensor: Sensor, means: bool = True) -> Observations:
    """Return one row for each rest, found in the gyros, with the track."""
    time, reading = recorded.time, recorded.reading
    rests = find_rests(time, reading, sensor)
    hold = np.full(time.size, -1, dtype=np.int64)
    for k, (start, stop) in enumerate(rests.tolist()):
        hold[start:stop] = k
    seconds = np.asarray((rests[:, 1] - rests[:, 0]) * float(time[1] - time[0]), np.float64)
    white = np.diag([axis.noise.white**2 for axis in sensor.axes])
    return Observations(
        labels=tuple(f"p{k + 1}" for k in range(len(rests))),
        mean=np.stack([reading[a:b].mean(axis=0) for a, b in rests.tolist()]),
        covariance=white / seconds[:, None, None],
        duration=seconds,
        samples=rests[:, 1] - rests[:, 0],
        time=time[rests - [0, 1]].mean(axis=1),
        channels=sensor.channels,
        track=Track(time, reading, np.zeros((time.size, 0)), hold, samples_are_means=means),
    )


def table_of(table: made.Table, **changed: float) -> StillTable:
    """Return what is known of a table, exact; `gravity` or `latitude` may be wrong."""
    return StillTable(
        Measured(changed.get("gravity", table.gravity), 0.0),
        Measured(changed.get("latitude", table.latitude), 0.0),
    )


def solved(
    recorded: Any,
    sensor: Any,
    bench: Any,
    means: bool = True,
    priors: Any = (),
    estimator: str = "",
) -> Estimate:
    """Return the estimate by the method's default or by another estimator."""
    return METHOD.estimator(estimator)(
        observations_of(recorded, sensor, means), sensor, bench, (), priors
    )


def errors_of(estimate: Estimate, recorded: made.Recorded, sensor: Sensor):
    """Return errors of coefficients and lag, and their covariance."""
    names = sensor.coefficients
    truth = [recorded.truth.get(n, 0.0) + recorded.drift_means.get(n, 0.0) for n in names]
    p = len(names) + 1
    return estimate.value[:p] - np.array([*truth, recorded.lag]), estimate.covariance[:p, :p]


def group_of(name: str) -> str:
    """Return the group of a coefficient: "gyro delta", "accelerometer arm", "lag"."""
    if name == "lag":
        return name
    kind = "gyro" if name.startswith("g") else "accelerometer"
    word = next(w for w in sorted(made.UNITS, key=len, reverse=True) if f".{w}" in name)
    return f"{kind} {word}"


def unit_of(name: str) -> float:
    """Return the unit of a coefficient, SI, as the tables print it."""
    return made.UNITS[group_of(name).split()[-1]]
