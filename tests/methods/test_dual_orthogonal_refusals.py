"""What `dual_orthogonal` refuses: what is not seen, and what does not fit."""

from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.dividing_head import LARGE, Bench
from tests.methods.dual_orthogonal_cases import SENSOR, case, known, nominal, observed
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import DividingHead, mounted_sensor
from inercal.estimation import Gaussian
from inercal.methods.dual_orthogonal import dual, joint, patent
from inercal.physics.sensors import G0, Sensor, pair


def test_dual_names_what_it_does_not_see():
    y, steps = nominal()
    seen, bench = observed(y / G0, steps), DividingHead(Measured(G0, 0.0))
    with pytest.raises(NotObserved) as refusal:
        dual(seen, SENSOR, bench, steps)
    assert len(refusal.value.directions) == 3
    assert refusal.value.directions[0].startswith("harmonic 1 of A: a.k0 − a.k2 + b.kip")
    assert refusal.value.directions[1].startswith("harmonic 1 of B: a.kip − b.k0 + b.k2")
    assert refusal.value.directions[2].startswith("k1 against K3: a.k1 − a.k3 − b.k1 + b.k3")


def test_readings_with_errors_are_judged_as_the_nominal_sensor():
    given = case(1, 5, Bench(collimated="none", sizes=LARGE))
    kip, k3 = known(given, "kip", 20), known(given, "k3", 5)
    with pytest.raises(NotObserved) as refusal:
        dual(given.seen, SENSOR, given.bench, given.steps, [k3])
    assert len(refusal.value.directions) == 2
    for estimator, named in ((dual, "k1 against K3"), (patent, "a.k3 − b.k3")):
        with pytest.raises(NotObserved) as refusal:
            estimator(given.seen, SENSOR, given.bench, given.steps, [kip])
        (direction,) = refusal.value.directions
        assert named in direction


def test_patent_needs_twelve_positions():
    for n, lacking in ((8, ()), (9, ("90°", "180°", "270°")), (6, ("90°", "270°"))):
        given = case(1, 2, Bench(), n)
        priors = [known(given, "kip", 20), known(given, "k3", 0.5)]
        with refused(NotObserved, key="steps", directions=lacking):
            patent(given.seen, SENSOR, given.bench, given.steps, priors)
        if n > 6:
            assert np.all(joint(given.seen, SENSOR, given.bench, given.steps, priors).converged)


def test_what_does_not_fit_is_refused():
    given = case(1, 1, Bench())
    other: Sensor = pair().with_coefficients("k0", "k1")
    with refused(key="[sensor]", names=other.channels):
        joint(given.seen, other, given.bench, given.steps)
    flat = replace(SENSOR, form="reference")
    with refused(key="[sensor] form", names=("a.delta_o", "b.delta_o")):
        dual(given.seen, flat, given.bench, given.steps)
    bias = Gaussian.independent(("a.k0",), 0.0, 1e-3)
    with refused(key="priors", names=("a.k0",)):
        patent(given.seen, SENSOR, given.bench, given.steps, [bias])
    fewer = mounted_sensor().with_coefficients("k0", "k2")
    with refused(key="[method]", names=("a.k1", "b.k1")):
        patent(given.seen, fewer, given.bench, given.steps)
