"""Find the kinds of benches by name."""

from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.benches.contract import Bench
from inercal.benches.kind_definition import Kind

_OWN = ("hand", "centrifuge", "dividing_head", "rate_table", "rate_platform", "turntable")
KINDS: Registry[Kind[Any, Any]] = Registry(
    "inercal.benches", "kind of bench", {name: f"inercal.benches.{name}.kind:KIND" for name in _OWN}
)


def kind_for_class(bench: type[Any]) -> Kind[Any, Any]:
    """Return the kind whose benches are of this class.

    Raises
    ------
    InputError
        The class belongs to no kind of bench.
    """
    for kind in KINDS.values():
        if issubclass(bench, kind.bench):
            return kind
    raise InputError(
        f"class {bench.__name__} belongs to no kind of bench; the kinds are {', '.join(KINDS)}"
    )


def kind_name_for_class(bench: type[Any]) -> str:
    """Return the name of the kind that has this class, or the class's own name if none has it."""
    return next((name for name, kind in KINDS.items() if kind.bench is bench), bench.__name__)


def kind_for_bench(bench: Bench) -> Kind[Any, Any]:
    """Return the kind of a bench.

    Raises
    ------
    InputError
        The class of the bench belongs to no kind.
    """
    return kind_for_class(type(bench))
