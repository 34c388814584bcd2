"""Replace typed keys of the section [bench] by qualifications.

Each parameter of a bench has a key of [bench] that states it: `radius` states "radius", and
`harmonics` states "sin1". A qualification replaces the key. For a measured constant it gives the
value ± u, and for a standard deviation it gives u. Values of errors whose expected value is zero
are applied in the bench itself (`QualifiedParameters`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.keys import ErrorName
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters
from inercal.benches.key_declarations import KeyDeclaration, declarations
from inercal.benches.kind_definition import Kind
from inercal.benches.qualification.result import Qualification, QualifiedParameter, load
from inercal.physics.section_settings import key_error

KEY = "[bench] qualification"
# Keys of parameters that no field declares, by parameter name without number and axis.
_BY_HAND = {"g": "gravity", "sin": "harmonics", "cos": "harmonics", "index": "indexing"}
_CONSTANTS = {"gravity", "radius", "azimuth", "latitude", "stretch", "latency"}
_NOT_POSSIBLE = {"lever", "clock"}  # on a turntable: only simulated, or estimated in each run


@dataclass(frozen=True)
class UsedQualifications:
    """The qualifications that a run uses.

    Parameters
    ----------
    files : tuple of str
        Files of the qualifications, as the run file names them.
    each : tuple of Qualification
    parameters : QualifiedParameters
        Parameters from all qualifications.
    keys : tuple of str
        Keys of [bench] that the qualifications replace.
    """

    files: tuple[str, ...] = ()
    each: tuple[Qualification, ...] = ()
    parameters: QualifiedParameters = NOT_QUALIFIED
    keys: tuple[str, ...] = ()


def read_qualifications(named: object, folder: Path) -> UsedQualifications:
    """Read the files that [bench] qualification names, and join them.

    Parameters
    ----------
    named : str or list of str
        Value of the key. Other types are left to the schema of the run file.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        A file is not a qualification, or two files contain the same parameter from different
        determinations.
    """
    texts = [named] if isinstance(named, str) else named
    if not isinstance(texts, list | tuple):
        return UsedQualifications()
    files = [text for text in cast(Sequence[object], texts) if isinstance(text, str)]
    if len(files) != len(cast(Sequence[object], texts)):
        return UsedQualifications()
    each: list[Qualification] = []
    for text in files:
        try:
            each.append(load(folder / text))
        except InputError as error:
            # The error is in the run file, so it must not name the qualification as its `file`.
            raise InputError(f"{KEY}: {error}", key=KEY, names=(text,)) from None
        if each[-1].withdrawn:
            raise key_error(
                KEY,
                f"{text} was withdrawn, {each[-1].withdrawn}: qualify the bench again",
                names=(text,),
            )
    return UsedQualifications(tuple(files), tuple(each), _join(each, files))


def _join(each: Sequence[Qualification], files: Sequence[str]) -> QualifiedParameters:
    """Return the parameters of all files; if files share a parameter, the larger file counts."""
    owner: dict[str, tuple[int, QualifiedParameter]] = {}
    for k in sorted(range(len(each)), key=lambda k: -len(each[k].parameters)):
        for one in each[k].parameters:
            other = owner.setdefault(one.name, (k, one))
            if other[1].determination != one.determination:
                raise key_error(
                    KEY,
                    f"{one.name} is in {files[other[0]]} and in {files[k]}, from different "
                    "determinations; name only one of them",
                    names=(one.name,),
                )
    rows = [
        (k, i)
        for k, qualification in enumerate(each)
        for i, one in enumerate(qualification.parameters)
        if owner[one.name][0] == k
    ]
    covariance = (
        tuple(float(each[k].covariance[i, j]) if k == other else 0.0 for other, j in rows)
        for k, i in rows
    )
    found = [each[k].parameters[i] for k, i in rows]
    return QualifiedParameters(
        tuple(one.name for one in found),
        tuple(one.value for one in found),
        tuple(covariance),
        tuple(one.determination for one in found),
        tuple(one.date.isoformat() for one in found),
    )


def with_qualified_keys(
    section: Mapping[str, Any], kind: Kind[Any, Any], used: UsedQualifications
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return [bench] with the keys that qualifications replace, and the names of these keys.

    Raises
    ------
    InputError
        A qualification is for another bench, no key states a parameter, or a replaced key is also
        typed.
    """
    name = section.get("name", "")
    for file, one in zip(used.files, used.each, strict=True):
        if not one.is_of_bench(kind.name, name):
            raise key_error(
                KEY,
                f"{file} is for {_bench_text(one.bench, one.bench_name)}, not for "
                f"{_bench_text(kind.name, name)}; name a qualification of this bench, or correct "
                "[bench] kind and name",
                names=(one.bench, one.bench_name),
            )
    by_key: dict[str, list[str]] = {}
    for parameter in used.parameters.names:
        by_key.setdefault(_key_of(parameter, kind), []).append(parameter)
    result = dict(section)
    for key, names in by_key.items():
        if key in section:
            raise key_error(
                f"[bench] {key}",
                f"{', '.join(names)} is both typed and qualified; remove {key} or the "
                "qualification",
                names=tuple(names),
            )
        text = _key_text(key, names, kind, used.parameters)
        if text is not None:
            result[key] = text
    return result, tuple(by_key)


def require_parameters(bench: Any, used: UsedQualifications) -> None:
    """Refuse qualified parameters that the bench does not have or that vary within a run.

    Raises
    ------
    InputError
        The bench has no such parameter, or the parameter varies and has a value or correlation.
    """
    declared: dict[str, Parameter] = {one.name: one for one in bench.parameters}
    covariance = np.array(used.parameters.covariance)
    for k, name in enumerate(used.parameters.names):
        one = declared.get(name)
        if one is None:
            raise _unknown_parameter(name, tuple(declared))
        alone = np.count_nonzero(covariance[k]) == 1
        if one.scope != "run" and not (alone and used.parameters.value[k] == 0):
            raise key_error(
                KEY,
                f"{name} changes with each {one.scope}: a qualification can state its standard "
                "deviation, but no value and no correlation",
                names=(name,),
            )


def _key_of(name: str, kind: Kind[Any, Any]) -> str:
    for field, one in declarations(kind.bench).items():
        if name in _declared_names(field, one):
            key = one.key or field
            break
    else:
        base = ErrorName(name).name
        fields = kind.section.model_fields
        stem = base.rstrip("0123456789xyz").rstrip("_")
        key = next((k for k in (_BY_HAND.get(stem), base, stem) if k in fields), "")
        if not key:
            raise _unknown_parameter(name, ())
    if key in _NOT_POSSIBLE:
        raise _unknown_parameter(name, ())
    return key


def _unknown_parameter(name: str, known: tuple[str, ...]) -> InputError:
    text = f"; it has {', '.join(known)}" if known else ""
    return key_error(
        KEY,
        f"the bench has no parameter {name!r} that a qualification can state{text}",
        names=(name,),
    )


def _declared_names(field: str, one: KeyDeclaration) -> set[str]:
    return {field} if isinstance(one.parameters, str) else set(one.parameters)


def _key_text(
    key: str, names: Sequence[str], kind: Kind[Any, Any], known: QualifiedParameters
) -> str | list[str] | None:
    """Return the text of a key from its parameters; None if the default still covers others."""
    if key in _CONSTANTS:
        k = known.names.index(names[0])
        unit = {"gravity": "m/s²", "radius": "m", "stretch": "1/(m/s²)", "latency": "s"}.get(
            key, "rad"
        )
        return f"{known.value[k]!r} {unit} ± {known.std(names[0])!r} {unit}"
    if key == "harmonics":
        return _harmonics(names, kind, known)
    for field, one in declarations(kind.bench).items():
        if (one.key or field) == key and not _declared_names(field, one) <= set(names):
            return None
    deviation = max(known.std(name) for name in names)
    return f"{deviation!r}{_unit_text(key, kind)}"


def _unit_text(key: str, kind: Kind[Any, Any]) -> str:
    """Return the SI unit of a key, found from its default or its example."""
    info = kind.section.model_fields[key]
    example = str((info.examples or [info.get_default()])[0])
    if example.endswith(("°", "″", "′")):
        return " rad"
    if example.endswith(("°/h", "°/s")):
        return " rad/s"
    if example.endswith("g"):
        return " m/s²"
    return " m" if example.endswith("m") and not example.endswith("ppm") else ""


def _harmonics(names: Sequence[str], kind: Kind[Any, Any], known: QualifiedParameters) -> list[str]:
    default = kind.section.model_fields["harmonics"].get_default()
    by_order: dict[int, float] = {}
    for name in names:
        order = int(ErrorName(name).name.removeprefix("sin").removeprefix("cos"))
        by_order[order] = max(by_order.get(order, 0.0), known.std(name))
    texts: list[str] = []
    for order in range(1, max(by_order) + 1):
        if order in by_order:
            texts.append(f"{by_order[order]!r} rad")
        elif order <= len(default):
            texts.append(default[order - 1])
        else:
            text = f"harmonic {order} is missing: qualify all up to {max(by_order)}"
            raise key_error(KEY, text, names=(f"sin{order}", f"cos{order}"))
    return texts


def _bench_text(kind: str, name: str) -> str:
    return f"a {kind} named {name!r}" if name else f"a {kind} without a name"
