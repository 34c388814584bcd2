"""The filters' parameters that an operator changes on the page, judged as the run file's are."""

from collections.abc import Mapping
from typing import Any

from inercal.basics.errors import InputError
from inercal.host.web.json_objects import JsonObject, as_object
from inercal.host.web.plans import Plan
from inercal.runfile.filter_fields import FILTER_KEY, filter_errors

_MAX_CHANGES, _MAX_TEXT = 32, 40


def filter_changes(requested: object) -> Mapping[str, str] | None:
    """Return the requested changes by key; None where there are none.

    Raises
    ------
    InputError
        No object of short texts.
    """
    if requested is None:
        return None
    given: Mapping[str, Any] | None = as_object(requested)
    if given is None or len(given) > _MAX_CHANGES:
        raise InputError("filter: give an object of parameters and their values", key="filter")
    for key, text in given.items():
        if not (isinstance(text, str) and text.isprintable() and len(text) <= _MAX_TEXT):
            raise InputError(
                f"filter: {key[:_MAX_TEXT]}: give a text of at most {_MAX_TEXT} characters",
                key="filter",
            )
    return {key: text.strip() for key, text in given.items()} or None


def require_filter_changes(plan: Plan, changes: Mapping[str, str] | None) -> None:
    """Refuse changes that the run file could not state.

    Raises
    ------
    InputError
        With the first key and what is wrong with it.
    """
    for key, words in filter_errors(plan.path, changes).items() if changes else ():
        raise InputError(f"{FILTER_KEY} {key}: {words}".replace(" : ", ": "), key=key)


def check_filter_changes(plan: Plan | None, requested: JsonObject) -> dict[str, str]:
    """Return what is wrong with the requested changes, in words by key.

    Raises
    ------
    InputError
        No plan, or no object of short texts.
    """
    if plan is None or plan.summary["trouble"]:
        raise InputError("choose a plan that can be run", key="plan")
    changes = filter_changes(requested.get("filter"))
    return filter_errors(plan.path, changes) if changes else {}
