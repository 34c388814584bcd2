"""What every kind of bench promises: held to all that are registered, those to come included."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.basics.keys import ErrorName
from inercal.basics.units import Measured, parse_quantity
from inercal.benches import MeanBench
from inercal.benches.key_declarations import declarations, declared_parameters
from inercal.benches.kind_definition import KINDS, Kind, kind_for_bench
from inercal.methods import METHODS, Method
from inercal.physics.sensors import Sensor, imu, triad

Array = NDArray[np.float64]
GRAVITY = Measured(9.81, 1e-4)
# What a bench cannot do without, beside gravity.
NEEDED: Mapping[str, Mapping[str, Any]] = {
    "centrifuge": {"radius": Measured(1.0, 1e-5), "indexing": 1e-4},
    "dividing_head": {"harmonics": (1e-5,), "division": 1e-5, "creep": 1e-6, "lean": 1e-4},
    "rate_table": {"radius": Measured(0.25, 1e-4)},
    "rate_platform": {
        "latitude": Measured(0.8, 1e-3),
        "rate_scale": 5e-4,
        "rate_asymmetry": 1e-4,
        "rate_stability": 1e-4,
        "angle_reading": 2e-5,
        "setting": 9e-4,
        "arm": 5e-3,
        "turn_on": 3e-4,
        "attitude": 9e-4,
        "mounting": 2e-3,
    },
    "turntable": {"latitude": 0.8, "harmonics": (1e-5, 1e-5)},
}


def bench_of(kind: Kind[Any, Any]) -> Any:
    return kind.bench(gravity=GRAVITY, **NEEDED.get(kind.name, {}))


def plans() -> list[tuple[str, str]]:
    """Return each kind with each of its methods that has a plan of known attitudes."""
    return [
        (kind, name)
        for kind in KINDS
        for name, one in METHODS.items()
        if one.bench is KINDS[kind].bench and not one.unknown_attitudes
    ]


def steps_of(chosen: Method[Any, Any], kind: Kind[Any, Any]) -> Sequence[Any]:
    return [step for step in chosen.plan() if isinstance(step, kind.steps)]


def planned(kind: str, method: str) -> tuple[Any, Sequence[Any], Sensor]:
    return bench_of(KINDS[kind]), steps_of(METHODS[method], KINDS[kind]), imu()


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_found_by_its_name_and_by_its_bench(kind: str) -> None:
    found = KINDS[kind]
    assert found.name == kind
    assert kind_for_bench(bench_of(found)) is found


@pytest.mark.parametrize("kind", KINDS)
def test_declared_parameters_are_distinct_and_finite(kind: str) -> None:
    declared = bench_of(KINDS[kind]).parameters
    names = [one.name for one in declared]
    assert len(set(names)) == len(names)
    assert all(np.isfinite([one.sd, one.value]).all() and one.sd >= 0 for one in declared)
    assert all(one.meaning and one.unit for one in declared)


@pytest.mark.parametrize("kind", KINDS)
def test_each_declared_deviation_is_a_key_and_is_read_in_si(kind: str) -> None:
    chosen = KINDS[kind]
    keys = chosen.section.model_fields
    needed = {key: "0.25 m" for key, one in keys.items() if one.is_required() and key != "kind"}
    section = chosen.section.model_validate({"kind": kind, "latitude": "38 °"} | needed)
    bench = chosen.build(section, Path())
    for name, one in declarations(chosen.bench).items():
        stated = parse_quantity(keys[one.key or name].default, one.like)
        found = getattr(bench, name)
        assert found == stated if isinstance(found, Measured) else found == stated.value


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_that_fields_declare_are_the_benchs(kind: str) -> None:
    bench = bench_of(KINDS[kind])
    assert set(declared_parameters(bench)) <= set(bench.parameters)


@pytest.mark.parametrize(("kind", "method"), plans())
@pytest.mark.parametrize("sensor", [imu(), triad("t", "f", "a")], ids=["imu", "triad"])
def test_nuisances_are_declared_parameters_at_places(
    kind: str, method: str, sensor: Sensor
) -> None:
    bench, steps, _ = planned(kind, method)
    declared = {one.name: one for one in bench.parameters}
    for full, one in bench.nuisances(steps, sensor).items():
        name = ErrorName(full)
        # A drift is named for its channel too, a harmonic for its axis.
        own = declared.get(full) or declared.get(name.name) or declared["drift"]
        assert replace(one, sd=own.sd) == own
        assert bool(name.place) == (one.scope != "run" or (full in declared and "[" in full))


def means() -> list[tuple[str, str]]:
    return [(kind, name) for kind, name in plans() if hasattr(KINDS[kind].bench, "mean_motion")]


@pytest.mark.parametrize(("kind", "method"), means())
def test_derivatives_are_those_of_the_mean_motion(kind: str, method: str, seed: int) -> None:
    bench, steps, sensor = planned(kind, method)
    assert isinstance(bench, MeanBench)
    rng = np.random.default_rng(seed)
    declared = bench.nuisances(steps, sensor)
    at = {name: np.array(p.value + p.sd * rng.standard_normal()) for name, p in declared.items()}
    made = bench.mean_motion(steps, at)
    scale = np.abs(made.motion.f).max()
    for name, p in declared.items():
        step = max(p.sd, 1e-5 * max(abs(p.value), 1.0)) * 0.1
        low, high = (bench.mean_motion(steps, at | {name: at[name] + k * step}) for k in (-1, 1))
        for part, by in (("f", made.df), ("w", made.dw)):
            change: Array = getattr(high.motion, part) - getattr(low.motion, part)
            told = by.get(name, np.zeros(())) * 2 * step
            # Differences of two numbers of this size, and their third order.
            assert np.abs(change - told).max() < 1e-12 * scale + 1e-3 * np.abs(told).max()


@pytest.mark.parametrize(("kind", "method"), means())
def test_trials_share_nothing(kind: str, method: str) -> None:
    bench, steps, sensor = planned(kind, method)
    assert isinstance(bench, MeanBench)
    rng = np.random.default_rng(1)
    declared = bench.nuisances(steps, sensor)
    drawn = {name: p.value + p.sd * rng.standard_normal(3) for name, p in declared.items()}
    together = bench.mean_motion(steps, drawn).motion
    for k in range(3):
        alone = bench.mean_motion(steps, {name: v[k] for name, v in drawn.items()}).motion
        np.testing.assert_allclose(together.f[k], alone.f, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("kind", "method"), plans())
def test_a_simulation_lasts_no_longer_than_the_kind_says(kind: str, method: str) -> None:
    bench, steps, sensor = planned(kind, method)
    if kind == "dividing_head":
        sensor = replace(sensor, axes=sensor.axes[:1])
    rate = 20.0
    made = KINDS[kind].simulate(bench, steps, rate, np.random.default_rng(1), 2, sensor, False)
    done = made.simulated_motion
    assert done.motion.f.shape == (2, done.time.size, 3)
    assert all(later > earlier for earlier, later in pairwise(done.time.tolist()))
    labels = dict.fromkeys(done.labels.tolist())
    assert labels
    assert done.time[-1] <= 2 * KINDS[kind].seconds(bench, steps) + 60.0
    assert set(done.bench_errors) >= set(bench.nuisances(steps, sensor)) - {"lean_1", "lean_2"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_plan_of_another_kind_has_no_budget_there(kind: str) -> None:
    from inercal.basics.errors import InputError
    from inercal.pipeline.budget.virtual_experiment import require_budget_plan

    bench = bench_of(KINDS[kind])
    for other, name in plans():
        steps = steps_of(METHODS[name], KINDS[other])
        if KINDS[other].steps != KINDS[kind].steps:
            with pytest.raises(InputError):
                require_budget_plan(bench, steps)
