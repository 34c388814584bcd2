"""How methods on a turntable take a recording: rests to begin with, and gaps."""

GAP = 0.5  # s without a sample, beyond which the attitude is taken from the table anew
COARSE = 20.0  # s at rest that the biases' first values come from
# A table told to rest for 20 s is seen at rest for less: it settles, and its readback is late.
LEAST_REST = 0.95 * COARSE
