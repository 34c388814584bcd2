"""The units of a sensor at rest, judged as a calibration judges them.

Three accelerometers read gravity together. Fewer may lie across it, and more have directions of
their own: they can only read too much.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.noise.channel_noise import Quantity, quantity_of
from inercal.recordings import Recording
from inercal.recordings.io.rest_norm import (
    LARGEST_BIAS,
    norm_at_rest,
    norm_finding,
    rate_finding,
    rest_norm_text,
)

_TRIAD = 3


def check_rest_units(recording: Recording, gravity: float | None) -> tuple[str, ...]:
    """Return remarks on readings at rest that are not those of a sensor in these units.

    Parameters
    ----------
    recording : Recording
        Units of rate or acceleration, (n, m); its samples may be block means.
    gravity : float or None
        Local gravity, m/s²; None where readings hold no gravity, or the sensor is carried round.

    Raises
    ------
    InputError
        The accelerometers' readings cannot be gravity.
    """
    if gravity is None:
        return ()
    columns: dict[Quantity, list[int]] = {"accelerometer": [], "gyro": []}
    for k, unit in enumerate(recording.units):
        columns[quantity_of(unit, recording.channels[k])].append(k)
    found = columns["accelerometer"]
    together = [found] if len(found) <= _TRIAD else [[k] for k in found]
    remarks: list[str] = []
    for group in filter(None, together):
        norm = norm_at_rest(lambda rows, group=group: _in_si(recording, rows, group), recording)
        if len(group) < _TRIAD and norm <= gravity:
            continue
        finding = norm_finding(norm, gravity, rest_norm_text(norm, gravity))
        if finding is None:
            continue
        if finding.severity == "refused":
            raise InputError(
                f"{recording.source or 'recording'}: {finding.message}; of a log by "
                "--set sensor.accelerometer.unit=…",
                file=recording.source or None,
                key="[sensor.accelerometer] unit",
            )
        remarks.append(finding.message)
    rates = [
        (recording.channels[k], float(np.median(recording.data[:, k])) * si_factor(unit))
        for k, unit in enumerate(recording.units)
        if k in columns["gyro"]
    ]
    large = rate_finding([one for one in rates if abs(one[1]) > LARGEST_BIAS], "")
    return (*remarks, *(() if large is None else (large.message,)))


def _in_si(recording: Recording, rows: slice, columns: list[int]) -> Array:
    sizes = np.array([si_factor(recording.units[k]) for k in columns])
    return recording.data[rows][:, columns] * sizes
