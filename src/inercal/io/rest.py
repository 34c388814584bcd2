"""Whether a recording at rest reads gravity: the units of its columns, judged from the data."""

from dataclasses import replace

import numpy as np

from inercal.io.table import BLOCK, blocks
from inercal.recording import Array, Finding, Recording
from inercal.sensors import G0, Sensor

_WINDOW_S = 0.5
_QUIETEST = 0.1  # of all windows
_POSSIBLE = (0.5, 2.0)  # of gravity; beyond it, no sensor's error but a unit
_USUAL = (0.9, 1.1)

# Norm at rest over gravity, and the confusion that gives it.
_CONFUSIONS = {
    1 / G0: "the columns look like g declared as m/s²",
    G0: "the columns look like m/s² declared as g",
    1000.0: "the columns look like mg declared as g",
    1 / 1000: "the columns look like g declared as mg",
    1000 / G0: "the columns look like mg declared as m/s²",
    G0 / 1000: "the columns look like m/s² declared as mg",
}
_NEAR = 1.25  # ratio within which a confusion is recognised; far less than they are apart


def audit_rest_norm(recording: Recording, sensor: Sensor, gravity: float) -> Recording:
    """Return the recording with a finding where it does not read gravity at rest.

    Parameters
    ----------
    recording : Recording
        A recording that rests somewhere, in any attitude.
    sensor : Sensor
        Its accelerometers, all of them channels of the recording, with their nominal readout.
    gravity : float
        Local gravity, m/s².
    """
    at_rest = _norm_at_rest(recording, sensor.only("f"))
    ratio = at_rest / gravity
    if _USUAL[0] <= ratio <= _USUAL[1]:
        return recording
    text = f"specific force at rest is {at_rest:.4g} m/s² where gravity is {gravity:.5g} m/s²"
    if _POSSIBLE[0] <= ratio <= _POSSIBLE[1]:
        finding = Finding("warning", "units", f"{text}: is the nominal scale right?")
    else:
        near = (words for r, words in _CONFUSIONS.items() if 1 / _NEAR < ratio / r < _NEAR)
        words = next(near, "check the units and the nominal scale of the columns")
        finding = Finding("refused", "units", f"{text}: {words}")
    return replace(recording, findings=(*recording.findings, finding))


def _norm_at_rest(recording: Recording, accelerometers: Sensor) -> float:
    """Return the median of the mean norms, m/s², of the windows in which the norm varies least."""
    columns = [recording.channels.index(name) for name in accelerometers.channels]
    n = recording.time.size
    window = max(2, min(round(_WINDOW_S * recording.rate_hz), n))
    scatter: list[Array] = []
    mean: list[Array] = []
    for rows in blocks(n // window * window, -(-BLOCK // window) * window):
        felt = accelerometers.to_si(recording.data[rows][:, columns])
        windows = np.linalg.norm(felt, axis=-1).reshape(-1, window)
        scatter.append(windows.std(axis=1))
        mean.append(windows.mean(axis=1))
    spread = np.concatenate(scatter)
    quiet = np.argsort(spread)[: max(1, round(_QUIETEST * spread.size))]
    return float(np.median(np.concatenate(mean)[quiet]))
