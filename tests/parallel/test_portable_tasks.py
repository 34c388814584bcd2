"""The tasks of budgets, plans and studies can be sent to another process, with equal results."""

import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal
from tests.base_seeds import evidence

from inercal.basics.parallel import SerialExecutor
from inercal.pipeline.budget import budget
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.pipeline.design import default_run_file, rehearse_plan
from inercal.runfile import read
from inercal.studies import STUDIES, reproduce

EXAMPLES = Path(__file__).parents[2] / "examples"


class PicklingExecutor(SerialExecutor):
    """Runs a copy of each task, as another process would; counts them."""

    count = 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task."""
        self.count += 1
        function, arguments = pickle.loads(pickle.dumps((function, arguments)))
        return super().submit(function, *arguments)


class Asked(Exception):
    """A result was asked for."""


class FirstTasks(PicklingExecutor):
    """Accepts tasks and runs none."""

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Refuse."""
        raise Asked


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "six_position/run",
        evidence("centrifuge/arm_run"),
        "dividing_head/tumble",
        evidence("rate_table/ship_bench"),
    ],
)
def test_a_budget_of_copies_is_the_budget(name: str):
    experiment = experiment_from_run(read(EXAMPLES / f"{name}.toml"))
    copies = PicklingExecutor()
    here, there = budget(experiment, 3), budget(experiment, 3, executor=copies)
    assert copies.count == len(experiment.imperfections) + 4
    assert_array_equal(here.total.monte_carlo, there.total.monte_carlo)
    assert_array_equal(here.total.first_order, there.total.first_order)
    assert_array_equal(here.stated, there.stated)
    for one, deviations in here.contributions.items():
        assert_array_equal(deviations.monte_carlo, there.contributions[one].monte_carlo)


@pytest.mark.slow
def test_a_rehearsal_of_copies_is_the_rehearsal():
    run = read(default_run_file(), {"name": "multi_position", "positions": 12, "seconds": "2 s"})
    copies = PicklingExecutor()
    here, there = (rehearse_plan(run, 2, executor) for executor in (None, copies))
    assert copies.count == 2
    assert_array_equal(here.std, there.std)


@pytest.mark.parametrize("name", sorted(STUDIES.keys() - {"centrifuge"}))
def test_the_tasks_of_a_study_can_be_copied(name: str):
    executor = FirstTasks()
    with pytest.raises(Asked):
        reproduce(name, 100, 0, executor=executor)
    assert executor.count >= 6
