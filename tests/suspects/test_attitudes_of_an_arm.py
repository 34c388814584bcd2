"""One attitude on a centrifuge that was indexed wrongly is named, at all rates together."""

from dataclasses import replace

import numpy as np
from tests.accuracy.centrifuge import RATES, full_circle, sensed_motion
from tests.methods.test_centrifuge_attitudes import attitudes, in_attitudes, turn
from tests.methods.test_centrifuge_norm import BENCH, NOISE, TRUTH, table

from inercal.benches.centrifuge.arm_motion import attitude_names
from inercal.calibration.grade import assess
from inercal.methods.centrifuge_norm import ml

STATED, WRONG = 1e-4, 3e-3  # rad


def test_the_index_of_one_attitude_is_named():
    angles = full_circle()[::2]
    bench = replace(BENCH, indexing=STATED, mounting=1e-3)
    for seed in range(3):
        rng = np.random.default_rng([seed, 62])
        f, rates = sensed_motion(angles, RATES)
        force = f.reshape(len(RATES), len(angles), 3)
        for k in range(len(angles)):
            error = STATED * rng.standard_normal(3)
            error[2] += WRONG * (k == 2)
            force[:, k] = force[:, k] @ turn(error).T
        output = TRUTH.output(force.reshape(-1, 3)) + NOISE * rng.standard_normal(f.shape)
        seen, made, spins = table(output, rates)
        steps = in_attitudes(spins, attitudes(angles))
        suspect = assess(ml(seen, made, bench, steps), 9).suspect
        assert suspect is not None
        name = list(dict.fromkeys(attitude_names(steps).values()))[2]
        assert suspect.name == f"index[{name}]"
