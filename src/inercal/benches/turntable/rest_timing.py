"""Limit the durations of rests and gaps for the methods on a turntable."""

from inercal.benches.turntable.bench import Turntable

MAX_GAP_SECONDS = 0.5  # s without a sample; after a longer gap the attitude restarts from readback
COARSE_REST_SECONDS = 20.0  # s at rest that give the first values of the biases
# A rest commanded for 20 s is shorter in the data: the table settles, and its readback is delayed.
MIN_REST_SECONDS = 0.95 * COARSE_REST_SECONDS
_SETTLING_SECONDS = 0.25  # s, without the latency of the readback


def settling_time(bench: Turntable) -> float:
    """Return the settling time of the table, s, with the possible latency of its readback."""
    return _SETTLING_SECONDS + abs(bench.latency.value) + 2 * bench.latency.sd
