"""Keys of [bench], declared in one line each: as defaults of the fields of a bench.

In the frozen dataclass of a bench::

    seat: float = deviation("m", "0.5 mm", "radius of a mounting", scope="mounting")

is a field, 0 where Python states nothing. `add_bench_keys` derives the key of the section from it,
with the text as its default, `build_bench` reads its value in SI, and `declared_parameters` returns
its parameters. Other keys are written by hand: the key in the section, the value in the call of
`build_bench`, the parameter in the bench.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, partial
from typing import Any, TypeVar

from pydantic import Field, create_model

from inercal.basics.parameters import Parameter, Scope
from inercal.basics.units import Measured
from inercal.physics.section_settings import (
    SMALL_ANGLE,
    BenchSection,
    Limit,
    section_constant,
    section_deviation,
    section_gravity,
)

B = TypeVar("B")
S = TypeVar("S", bound=BenchSection)
_EXACT = Measured(0.0, 0.0)
_SI = {
    "°": "rad",
    "°/s": "rad/s",
    "1/(m/s²)": "(m/s²)⁻¹",
}  # units of parameters; other units are unchanged
_METADATA = "key of [bench]"


@dataclass(frozen=True)
class KeyDeclaration:
    """The declaration of a key of [bench] by a field of a bench.

    Parameters
    ----------
    like : str
        A unit of its dimension.
    text, example : str
        Default of the key, and an example where the default shows nothing, with their units.
    read : callable
        From the section, the key and `like` to the value of the field, SI.
    parameters : str or mapping of str to str
        Meaning of the one parameter, which has the field's name, or name and meaning of each.
    key : str
        Of [bench]; empty is the field's name.
    scope, attitude
        As of `Parameter`.
    """

    like: str
    text: str
    example: str
    read: Callable[[BenchSection, str, str], float | Measured]
    parameters: str | Mapping[str, str]
    key: str = ""
    scope: Scope = "run"
    attitude: bool = False

    def iterate_parameters(self, field: str, value: float | Measured) -> Iterator[Parameter]:
        """Yield the parameters from the field's name and value, SI."""
        named = {field: self.parameters} if isinstance(self.parameters, str) else self.parameters
        unit = _SI.get(self.like, self.like)
        for name, meaning in named.items():
            if isinstance(value, Measured):
                yield Parameter.from_measured(name, unit, value, meaning)
            else:
                yield Parameter(name, unit, value, self.scope, 0.0, meaning, "", self.attitude)


def deviation(
    like: str,
    text: str,
    parameters: str | Mapping[str, str],
    *,
    scope: Scope = "run",
    key: str = "",
    example: str = "",
    limit: Limit | None = None,
    attitude: bool = False,
    default: float = 0.0,
) -> float:
    """Declare a field of a bench: a standard deviation, which a key of [bench] states.

    Parameters
    ----------
    like : str
        A unit of its dimension: "m", "°", "1".
    text : str
        Default of the key, with its unit: "0.5 mm".
    parameters : str or mapping of str to str
        The parameters with this deviation: the meaning of one parameter, which has the field's
        name, or name and meaning of each; there may be none.
    scope, attitude
        Of the parameters, as of `Parameter`.
    key : str
        Its name where it is not the field's.
    example : str
        Of the key, where the default shows nothing.
    limit : Limit, optional
        Its largest possible value.
    default : float
        Of the field where Python states nothing, SI.
    """
    read = partial(section_deviation, limit=limit)
    result = KeyDeclaration(like, text, example, read, parameters, key, scope, attitude)
    return field(default=default, metadata={_METADATA: result})


small_angle = partial(deviation, "°", limit=SMALL_ANGLE)
"""Declare a field of a bench: the standard deviation of a tilt or another small angle."""


def constant(like: str, text: str, meaning: str, *, example: str = "") -> Measured:
    """Declare a field of a bench: a measured constant; exactly 0 where Python states nothing.

    Parameters
    ----------
    like, text, example
        As of `deviation`.
    meaning : str
        Of its parameter.
    """
    result = KeyDeclaration(like, text, example, section_constant, meaning)
    return field(default=_EXACT, metadata={_METADATA: result})


@cache
def declarations(bench: Any) -> Mapping[str, KeyDeclaration]:
    """Return the declarations of the fields of a bench, given by its class, by field."""
    return {own.name: own.metadata[_METADATA] for own in fields(bench) if _METADATA in own.metadata}


def declared_parameters(bench: Any, *names: str) -> list[Parameter]:
    """Return the parameters that these fields declare, in this order; without names, of all."""
    declared = declarations(bench.__class__)
    return [
        parameter
        for name in names or declared
        for parameter in declared[name].iterate_parameters(name, getattr(bench, name))
    ]


def add_bench_keys(
    bench: type, after: Mapping[str, str] | None = None
) -> Callable[[type[S]], type[S]]:
    """Return a decorator that adds the keys that a bench declares to its section.

    Parameters
    ----------
    bench : type
        A dataclass.
    after : mapping of str to str, optional
        The order of keys in messages: those written in the section come first. A key named here,
        and those written below it, come after the declared key.
    """

    def complete(section: type[S]) -> type[S]:
        written: dict[str, dict[str, Any]] = {"": {}}
        place = ""
        for key, info in section.model_fields.items():
            if key not in BenchSection.model_fields:
                place = (after or {}).get(key, place)
                written.setdefault(place, {})[key] = (info.annotation, info)
        keys = written[""]
        for name, one in declarations(bench).items():
            key, shown = one.key or name, [one.example] if one.example else None
            keys |= {key: (str, Field(one.text, examples=shown))} | written.get(key, {})
        # The last base sets the order of the fields, the first base their definitions.
        ordered = create_model(section.__name__, __base__=BenchSection, **keys)
        result: Any = create_model(
            section.__name__,
            __base__=(section, ordered),
            __doc__=section.__doc__,
            __module__=section.__module__,
        )
        return result

    return complete


def build_bench(bench: Callable[..., B], section: BenchSection, **by_hand: Any) -> B:
    """Return a bench as its section states it, in SI.

    Parameters
    ----------
    bench : type
        A dataclass with the field `gravity`.
    section : BenchSection
        That `add_bench_keys` made.
    **by_hand
        Fields that declare no key.

    Raises
    ------
    InputError
        A quantity of another dimension, or not possible; it names the key.
    """
    declared = {
        name: one.read(section, one.key or name, one.like)
        for name, one in declarations(bench).items()
    }
    return bench(gravity=section_gravity(section), **declared, **by_hand)
