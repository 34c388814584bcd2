"""Exchanged and reversed axes are found or refused with the right reason."""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false

from itertools import permutations, product

import numpy as np
import pytest
from tests.base_seeds import sampled
from tests.magnetometer import generator as sim
from tests.magnetometer.cases import fit, linear_model, normalised_error

from inercal.basics.errors import InputError

AXES = [
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
]
LEFT_HANDED = "gravity instead of specific force"


def names(axes):
    words = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in axes]
    return "axis = [" + ", ".join(f'"{word}"' for word in words) + "]"


def draw(k, seed):
    """Return data with one of the 48 axes, the hemisphere, and whether f has the wrong sign."""
    rng = np.random.default_rng([seed, k])
    south, reversed_force = rng.random() < 0.5, rng.random() < 0.2
    dip = np.radians(rng.uniform(10, 80)) * (-1 if south else 1)
    n = int(rng.integers(9, 40))
    tilt = np.pi if n < 15 else rng.choice([np.pi, np.pi / 2, np.pi / 4])
    own = sim.device(rng, AXES[(k // 2) % 48], dip=dip)
    data = sim.rests(rng, sim.scattered(rng, n, tilt), own)
    if reversed_force:
        data.up = -data.up
    return data, "south" if south else "north", reversed_force


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), sampled(96, 500))
def test_cases_of_all_axes_are_found_or_refused_with_the_right_reason(seed, count):
    for k in range(count):
        data, hemisphere, reversed_force = draw(k, seed)
        true = AXES[(k // 2) % 48]
        stated = true if k % 2 else np.eye(3)
        # D relative to the stated axes, as the data show it for this hemisphere.
        seen = true @ np.linalg.inv(stated) * (-1 if reversed_force else 1)
        model = linear_model(stated)
        if np.array_equal(seen, np.eye(3)):
            if reversed_force:
                continue  # all axes and the force are reversed: no data can show it
            found = fit(data, model, hemisphere=hemisphere)
            assert normalised_error(found, data.device, model) < 5
            continue
        with pytest.raises(InputError) as refused:
            fit(data, model, hemisphere=hemisphere)
        assert names(seen @ stated) in str(refused.value)
        assert (LEFT_HANDED in str(refused.value)) == (np.linalg.det(seen) < 0)


@pytest.mark.parametrize("dip", [60.0, -60.0])
def test_without_a_hemisphere_the_axes_decide_the_sign_of_the_dip(dip):
    rng = np.random.default_rng(1)
    own = sim.device(rng, dip=np.radians(dip))
    found = fit(sim.rests(rng, sim.scattered(rng, 24), own), hemisphere=None)
    assert normalised_error(found, own) < 4
    assert len(found.notes) == 1


def test_a_horizontal_field_leaves_the_sign_to_the_axes():
    for k in range(10):
        rng = np.random.default_rng(k)
        own = sim.device(rng, dip=0.0)
        found = fit(sim.rests(rng, sim.scattered(rng, 24), own))
        assert normalised_error(found, own) < 4


def test_motion_without_accelerometers_finds_the_axes(seed):
    for k in range(6):
        rng = np.random.default_rng([seed, k])
        axes = AXES[int(rng.integers(48))]
        own = sim.device(rng, axes)
        attitude, turns = sim.tumbling(rng, 120)
        data = sim.rests(rng, attitude, own, sigma_m=0.5e-6)
        data = sim.without_directions(sim.add_turns(rng, data, turns, step=0.2))
        model = linear_model(axes)
        assert normalised_error(fit(data, model), own, model) < 4
