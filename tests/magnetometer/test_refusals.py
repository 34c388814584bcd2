"""Data that do not determine a magnetometer, and arrays that do not fit together, are refused."""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false

from dataclasses import replace

import numpy as np
import pytest
from tests.magnetometer import generator as sim
from tests.magnetometer.cases import fit, linear_model, records

from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import Measured
from inercal.methods.magnetic_field.fitting import fit_field
from inercal.methods.magnetic_field.records import Directions, FieldConditions, LinearModel


def rests(rng, attitude):
    return sim.rests(rng, attitude, sim.device(rng))


def test_level_turns_leave_five_directions():
    rng = np.random.default_rng(1)
    with pytest.raises(NotObserved) as refused:
        fit(rests(rng, sim.scattered(rng, 24, 1e-3)))
    assert len(refused.value.directions) == 5
    assert {"mz.bias", "mz.scale"} <= set(refused.value.names)


def test_no_upward_direction_and_no_gyro_leave_three_rotations():
    rng = np.random.default_rng(1)
    with pytest.raises(NotObserved) as refused:
        fit(sim.without_directions(rests(rng, sim.scattered(rng, 24))))
    assert refused.value.directions == (
        "mx.delta_o + my.delta_p (in units of their typical size)",
        "mx.delta_p + mz.delta_o (in units of their typical size)",
        "my.delta_o + mz.delta_p (in units of their typical size)",
    )


def test_one_azimuth_of_each_face_is_not_enough():
    """Six attitudes give 12 rows for 13 unknowns."""
    rng = np.random.default_rng(1)
    faces = sim.six_faces(rng, 1)
    with pytest.raises(NotObserved) as refused:
        fit(rests(rng, np.concatenate([faces, faces])))
    assert len(refused.value.directions) == 1


@pytest.mark.parametrize("n", [1, 2, 6, 8])
def test_too_few_rests_are_refused(n):
    rng = np.random.default_rng(1)
    with pytest.raises(NotObserved, match="attitudes do not determine"):
        fit(rests(rng, sim.scattered(rng, n)))


def test_constant_readings_are_refused():
    rng = np.random.default_rng(1)
    data = rests(rng, sim.scattered(rng, 24))
    data.reading[:, 1] = data.reading[0, 1]
    with pytest.raises(InputError, match="axis my"):
        fit(data)


@pytest.mark.parametrize("factor", [1e-3, 0.1, 10.0, 1e6])
def test_a_wrong_unit_is_refused(factor):
    rng = np.random.default_rng(1)
    data = rests(rng, sim.scattered(rng, 24))
    data.reading, data.sigma_m = factor * data.reading, factor * data.sigma_m
    with pytest.raises(InputError, match="times as large as the stated field"):
        fit(data)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"strength": Measured(-1.0, 0.0)}, "must be positive"),
        ({"strength": Measured(5e-5, 6e-5)}, "must be positive"),
        ({"strength": Measured(np.nan, 0.0)}, "must be positive"),
        ({"dip": Measured(2.0, 0.1)}, "between"),
        ({"dip": Measured(1.0, 0.0)}, "positive uncertainty"),
        ({"dip": Measured(-1.0, 0.01), "hemisphere": "north"}, "contradicts the northern"),
    ],
)
def test_impossible_conditions_are_refused(changed, words):
    with pytest.raises(InputError, match=words):
        FieldConditions(**changed)


def test_a_dip_of_the_wrong_sign_is_refused_like_a_wrong_hemisphere():
    rng = np.random.default_rng(1)
    data = rests(rng, sim.scattered(rng, 24))
    for hemisphere, dip in ((None, Measured(-1.0, 0.01)), ("south", None)):
        with pytest.raises(InputError, match="northern") as refused:
            fit(data, hemisphere=hemisphere, dip=dip)
        assert refused.value.key == "[bench] latitude"


def test_a_stated_noise_that_hides_the_field_is_named_before_the_attitudes():
    rng = np.random.default_rng(1)
    data = rests(rng, sim.scattered(rng, 24))
    data.sigma_m = 1e3 * data.sigma_m
    with pytest.raises(InputError) as refused:
        fit(data)
    assert refused.value.key == "[sensor.magnetometer] white"


def test_stated_axes_in_a_plane_are_refused():
    model = linear_model()
    flat = np.zeros((3, 4))
    flat[:2, :2] = np.eye(2)
    with pytest.raises(InputError, match="plane"):
        LinearModel(model.names, flat, model.directions)


def test_a_model_without_scales_is_refused():
    model = linear_model()
    with pytest.raises(InputError, match="scale"):
        LinearModel(model.names[::4], model.nominal, model.directions[::4])


def fit_spoiled(records_, name, value, at):
    nodes, directions, links, known = records_
    for index, one in enumerate((nodes, directions, links)):
        if hasattr(one, name):
            changed = np.array(getattr(one, name))
            changed[at] = value
            both = [nodes, directions, links]
            both[index] = replace(one, **{name: changed})
            return fit_field(both[0], linear_model(), both[1], both[2], None, known)
    raise AssertionError(name)


@pytest.mark.parametrize(
    ("name", "value", "at"),
    [
        ("reading", np.nan, (3, 1)),
        ("time", np.inf, 2),
        ("up", 3.0, (2, 0)),
        ("node", 99, -1),
        ("before", 50, -1),
        ("rotation", np.nan, (0, 0, 0)),
        ("covariance", -1.0, (0, 0, 0)),
        ("node", 0, 5),
    ],
)
def test_invalid_values_are_refused(name, value, at):
    rng = np.random.default_rng(1)
    attitude = sim.scattered(rng, 24)
    data = sim.add_turns(rng, rests(rng, attitude), sim.turns_between(attitude), about_up=True)
    with pytest.raises(InputError):
        fit_spoiled(records(data), name, value, at)


def test_shapes_that_do_not_fit_are_refused():
    rng = np.random.default_rng(1)
    nodes, directions, _, known = records(rests(rng, sim.scattered(rng, 24)))
    with pytest.raises(InputError, match="shape"):
        replace(nodes, reading=nodes.reading[:5])
    with pytest.raises(InputError, match="shape"):
        fit_field(nodes, linear_model(), directions, known=np.eye(2))
    short = Directions(directions.node, directions.up[:3], directions.covariance, known)
    with pytest.raises(InputError, match="shape"):
        fit_field(nodes, linear_model(), short)


def test_turns_about_the_vertical_need_upward_directions():
    rng = np.random.default_rng(1)
    attitude = sim.scattered(rng, 24)
    data = sim.add_turns(rng, rests(rng, attitude), sim.turns_between(attitude), about_up=True)
    with pytest.raises(InputError, match="needs an upward direction"):
        fit(sim.without_directions(data, range(20)))
