"""How methods on a turntable take a recording: rests to begin with, and gaps."""

from inercal.benches.turntable.bench import Turntable

MAX_GAP_SECONDS = 0.5  # s without a sample, beyond which the attitude is taken from the table anew
COARSE_REST_SECONDS = 20.0  # s at rest that the biases' first values come from
# A table told to rest for 20 s is seen at rest for less: it settles, and its readback is late.
MIN_REST_SECONDS = 0.95 * COARSE_REST_SECONDS
_SETTLING_SECONDS = 0.25  # s beside what the readback may be late by


def settling_time(bench: Turntable) -> float:
    """Return how long the table is taken to settle, s; the readback may be late besides."""
    return _SETTLING_SECONDS + abs(bench.latency.value) + 2 * bench.latency.sd
