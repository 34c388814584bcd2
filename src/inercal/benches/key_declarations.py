"""Declare keys of the section [bench], each in one line as the default of a bench's field.

In the frozen dataclass of a bench::

    seat: float = deviation("m", "0.5 mm", "radius of a mounting", scope="mounting")

declares a field that is 0 unless Python code states a value. From this line `add_bench_keys`
creates the key of the section, with the text as its default. `build_bench` reads the key's value in
SI, and `declared_parameters` returns the field's parameters. Other keys are written by hand: the
key in the section, the value in the call of `build_bench`, the parameter in the bench.
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
    """A key of [bench], as a field of a bench declares it.

    Parameters
    ----------
    like : str
        Any unit with the dimension of the key.
    text, example : str
        Default of the key, and an example in case the default is not informative, with their units.
    read : callable
        Returns the value of the field, SI, given the section, the key and `like`.
    parameters : str or mapping of str to str
        Meaning of the only parameter, which has the field's name, or a mapping from each
        parameter's name to its meaning.
    key : str
        Name of the key; if empty, it is the field's name.
    scope, attitude
        The same as in `Parameter`.
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
        """Yield the parameters that belong to a field with this name and value, in SI."""
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
    """Declare a field for a standard deviation that a key of [bench] states.

    Parameters
    ----------
    like : str
        Any unit with the dimension of the key, such as "m", "°" or "1".
    text : str
        Default of the key, with its unit, such as "0.5 mm".
    parameters : str or mapping of str to str
        Parameters with this standard deviation: the meaning of the only parameter, which has the
        field's name, or a mapping from each parameter's name to its meaning. It may be empty.
    scope, attitude
        Scope and attitude of the parameters, as in `Parameter`.
    key : str
        Name of the key, if it differs from the field's name.
    example : str
        Example of the key, in case the default is not informative.
    limit : Limit, optional
        Largest possible value.
    default : float
        Value of the field if Python code states none, SI.
    """
    read = partial(section_deviation, limit=limit)
    result = KeyDeclaration(like, text, example, read, parameters, key, scope, attitude)
    return field(default=default, metadata={_METADATA: result})


small_angle = partial(deviation, "°", limit=SMALL_ANGLE)
"""Declare a field for the standard deviation of a tilt or another small angle."""


def constant(like: str, text: str, meaning: str, *, example: str = "") -> Measured:
    """Declare a field for a measured constant, which is exactly 0 unless a value is stated.

    Parameters
    ----------
    like, text, example
        The same as for `deviation`.
    meaning : str
        Meaning of its parameter.
    """
    result = KeyDeclaration(like, text, example, section_constant, meaning)
    return field(default=_EXACT, metadata={_METADATA: result})


@cache
def declarations(bench: Any) -> Mapping[str, KeyDeclaration]:
    """Return the key declarations of a class of bench, by field name."""
    return {own.name: own.metadata[_METADATA] for own in fields(bench) if _METADATA in own.metadata}


def declared_parameters(bench: Any, *names: str) -> list[Parameter]:
    """Return the parameters that the named fields declare, in this order; by default all."""
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
        Class of the bench, a dataclass.
    after : mapping of str to str, optional
        Order of the keys in messages, as a mapping from a key written in the section to a declared
        key. Keys written in the section come first by default. A key named here, and the keys
        written below it, come after the declared key instead.
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
    """Build a bench, in SI, from its section of the run file.

    Parameters
    ----------
    bench : type
        Class of the bench, a dataclass with the field `gravity`.
    section : BenchSection
        Section whose keys `add_bench_keys` added.
    **by_hand
        Values of the fields that declare no key.

    Raises
    ------
    InputError
        A quantity has the wrong dimension or an impossible value. The error names the key.
    """
    declared = {
        name: one.read(section, one.key or name, one.like)
        for name, one in declarations(bench).items()
    }
    return bench(gravity=section_gravity(section), **declared, **by_hand)
