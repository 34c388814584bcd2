"""Checks of the recorded temperature: jumps that no chamber makes, and K declared as °C."""

import numpy as np

from inercal.arrays import Array
from inercal.recording import Finding, Recording
from inercal.recording.temperature_readout import seems_kelvin
from inercal.units import ZERO_CELSIUS

_FASTEST = 1.0  # K/s; chambers for thermal shock reach a third of it
_SMALLEST = 3.0  # K; a smaller step is noise or rounding of a thermometer
_TYPICAL = 6.0  # typical changes from one reading to the next


def temperature_findings(recording: Recording) -> list[Finding]:
    """Return warnings of a temperature that jumps, and of one that seems to be in K."""
    kelvin = recording.temperature
    if kelvin is None or kelvin.size < 2:
        return []
    findings: list[Finding] = []
    celsius = kelvin - ZERO_CELSIUS
    if seems_kelvin(celsius):
        text = (
            f"the temperature is {celsius.min():.1f} to {celsius.max():.1f} °C: if these are "
            'numbers in K, state temperature_unit = "K"'
        )
        findings.append(Finding("warning", "temperature unit", text))
    return [*findings, *_jumps(recording, celsius)]


def _jumps(recording: Recording, celsius: Array) -> list[Finding]:
    step, seconds = np.abs(np.diff(celsius)), np.diff(recording.time)
    changed = step[step > 0]
    if not changed.size:
        return []
    allowed = max(_SMALLEST, _TYPICAL * float(np.median(changed)))
    jumps = step > allowed + _FASTEST * seconds
    if recording.labels is not None:  # sections may be recorded on different days
        jumps &= recording.labels[1:] == recording.labels[:-1]
    places = np.flatnonzero(jumps)
    if not places.size:
        return []
    k = int(places[np.argmax(step[places])])
    count = f"{places.size} times" if places.size > 1 else "once"
    text = (
        f"the temperature jumps {count}, which no chamber makes: from {celsius[k]:.2f} to "
        f"{celsius[k + 1]:.2f} °C within {seconds[k]:.3g} s at {recording.time[k]:.6g} s; correct "
        "the readings of the thermometer, or remove these samples"
    )
    return [Finding("warning", "temperature jump", text, None, k, k + 2)]
