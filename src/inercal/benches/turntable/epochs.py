"""How methods on a turntable take a recording: rests to begin with, and gaps."""

from inercal.benches.turntable.bench import Turntable

GAP = 0.5  # s without a sample, beyond which the attitude is taken from the table anew
COARSE = 20.0  # s at rest that the biases' first values come from
# A table told to rest for 20 s is seen at rest for less: it settles, and its readback is late.
LEAST_REST = 0.95 * COARSE
_SETTLING = 0.25  # s beside what the readback may be late by


def settling(bench: Turntable) -> float:
    """Return how long the table is taken to settle, s; the readback may be late besides."""
    return _SETTLING + abs(bench.latency.value) + 2 * bench.latency.sd
