"""The stages of a study: groups of calls that do not depend on one another."""

from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from typing import Any

from inercal.basics.parallel import Executor, in_order
from inercal.studies.study_content import MessageCallback

Call = Callable[[], Any]


def compute_stages(
    stages: Mapping[str, Sequence[Call]], say: MessageCallback, executor: Executor
) -> list[list[Any]]:
    """Return the results of the calls of each stage, in order.

    All are submitted at once, so that no worker waits for the end of a stage.

    Parameters
    ----------
    stages : mapping of str to sequence of callable
        By what is said when the stage begins.
    say : callable
    executor : Executor
    """
    indices = [executor.submit(call) for calls in stages.values() for call in calls]
    results = in_order(executor, indices[0])
    found: list[list[Any]] = []
    for words, calls in stages.items():
        say(words)
        found.append(list(islice(results, len(calls))))
    return found
