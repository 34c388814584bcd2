"""The noise of a gyro at rest: simulated here, in practice read from a log."""

import numpy as np

import inercal
from inercal.physics.sensors.axis import Noise
from inercal.recordings import Recording

RATE = 10.0  # Hz
GYRO = Noise(white=4.4e-5, bias_instability=2.4e-5)  # rad/s/√Hz (0.15 °/√h), rad/s (5 °/h)

rng = np.random.default_rng(1)
rate = GYRO.draw(rng, (3, 36_000), RATE).T  # an hour of three axes
time = np.arange(len(rate)) / RATE
recording = Recording(time, rate, ("gx", "gy", "gz"), ("rad/s",) * 3)

analysis = inercal.analyse_noise(recording)
for channel in analysis.channels:
    print(channel.channel, channel.goodness.verdict)
    for one in channel.coefficients:
        print(f"  {one.name}: {one.value / one.size:.3g} {one.unit}, u = {one.u / one.size:.2g}")
    for found in channel.disturbances:
        print(f"  {found.kind} at {found.time:.1f} s")
