"""C99 headers in single precision, and C++11 headers with a template over the number type.

The correction is inline and needs neither memory allocation nor a library. A self-test corrects a
reading whose result is known.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.polynomial import CodeModel, Dialect, code_model, statements
from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment

_TOLERANCE = 1e-5  # tolerance of the self-test, relative for results above 1
_FIELD = 1e-4  # T, used instead of 1 for magnetic fields
# The condition is written in this way because a NaN must also fail.
_BEYOND_TOLERANCE = (
    "!(motion[i] - expected[i] <= tolerance[i] && expected[i] - motion[i] <= tolerance[i])"
)


@dataclass(frozen=True)
class _Language:
    """Differences between the two languages: number type, literals and declarations.

    The declarations contain the placeholders {name}, {m} for the number of readings, {n} for the
    number of results, and {parameter} and {argument} for the temperature. The beginning also has
    {macro} for the name in capitals, and {warm}, 1 if the correction takes a temperature.
    """

    real: str
    number: Callable[[float], str]
    digits: type[Any]
    correction: Sequence[str]
    self_test: Sequence[str]
    call: str
    guard: str
    begin: Sequence[str] = ()
    end: Sequence[str] = ()
    remarks: Sequence[str] = ()


def literal(value: float) -> str:
    """Return a single-precision literal.

    >>> literal(2.0), literal(1e-7)
    ('2.0f', '1.00000001e-07f')
    """
    return f"{_with_point(f'{float(np.float32(value)) + 0.0:.9g}')}f"


def _real(value: float) -> str:
    return f"Real({_with_point(f'{value + 0.0:.17g}')})"


def _with_point(text: str) -> str:
    return text if any(one in text for one in ".en") else f"{text}.0"


_C = _Language(
    "float",
    literal,
    np.float32,
    ("static inline void {name}_correct(const float reading[{m}]{parameter}, float motion[{n}])",),
    ("static inline int {name}_self_test(void)",),
    "{name}_correct(reading{argument}, motion)",
    "H",
    (
        "#define {macro}_READINGS {m}",
        "#define {macro}_RESULTS {n}",
        "#define {macro}_TAKES_TEMPERATURE {warm}",
        "",
    ),
)
_CPP = _Language(
    "Real",
    _real,
    np.float64,
    (
        "template <typename Real>",
        "inline void correct(const Real (&reading)[{m}]{parameter}, Real (&motion)[{n}])",
    ),
    ("template <typename Real>", "inline int self_test()"),
    "correct<Real>(reading{argument}, motion)",
    "HPP",
    ("namespace {name} {{", ""),
    ("", "}}  // namespace {name}"),
    ("errors are of Real = double; float adds rounding of 1e-6 of the largest result",),
)


def _render(language: _Language, request: Request) -> Rendering:
    code, number, real = code_model(request), language.number, language.real
    expected = code.correct(request.check_reading, request.check_dT)[0]
    floor = np.repeat([_FIELD if kind == "m" else 1.0 for kind, _ in code.model.triads], 3)
    arrays = {
        "reading": code.model.outputs(request.check_reading)[0, code.model.inputs],
        "expected": expected,
        "tolerance": _TOLERANCE * np.maximum(floor, np.abs(expected)),
    }
    constants = {name: _array_text(values, "    ", number) for name, values in arrays.items()}
    celsius = number(code.reference + float(request.check_dT[0]))
    words = {
        "name": request.name,
        "macro": request.name.upper(),
        "warm": int(code.takes_temperature),
        **dict(zip("nm", code.model.gain.shape, strict=True)),
        "parameter": f", {real} temperature" * code.takes_temperature,
        "argument": f", {celsius}" * code.takes_temperature,
    }
    call = language.call.format(**words)
    lines = [
        *(line.format(**words) for line in language.begin),
        f"/* motion: {motion_comment(code)}. */",
        *(line.format(**words) for line in language.correction),
        "{",
        *_body_lines(code, real, number),
        "}",
        "",
        "/* Returns 0 if the check above is reproduced to 1e-5"
        + (", and its field to 1e-9 T" * (code.model.magnetometer is not None))
        + ". */",
        *(line.format(**words) for line in language.self_test),
        *check_lines(real, constants, call, _BEYOND_TOLERANCE, len(code.model.gain)),
        *(line.format(**words) for line in language.end),
    ]
    guard = f"INERCAL_{request.name.upper()}_{language.guard}"
    return code_rendering(
        code,
        lambda header: header_text(header, guard, lines),
        digits=language.digits,
        remarks=language.remarks,
    )


def header_text(comment: Sequence[str], guard: str, lines: Sequence[str]) -> str:
    """Return the text of a header, with its explanation and include guard."""
    explanation = "".join(f" * {line}".rstrip() + "\n" for line in comment)
    parts = [f"#ifndef {guard}", f"#define {guard}", "", *lines, "", "#endif"]
    return f"/*\n{explanation} */\n" + "\n".join(parts) + "\n"


def check_lines(
    kind: str, constants: Mapping[str, str], call: str, failure: str, n: int
) -> list[str]:
    """Return the body of a self-test, which returns 0 or the number of the wrong channel.

    Parameters
    ----------
    kind : str
        Type of the numbers.
    constants : mapping of str to str
        Initialisers of constant arrays by name.
    call : str
        The call that corrects `reading` to `motion`.
    failure : str
        The condition for a wrong result in channel i.
    n : int
        Number of results.
    """
    return [
        "{",
        *(f"    static const {kind} {name}[] = {text};" for name, text in constants.items()),
        f"    {kind} motion[{n}];",
        f"    {call};",
        f"    for (int i = 0; i < {n}; ++i) {{",
        f"        if ({failure}) {{",
        "            return i + 1;",
        "        }",
        "    }",
        "    return 0;",
        "}",
    ]


def _array_text(values: Array, indent: str, number: Callable[[float], str]) -> str:
    """Return the initialiser of a one- or two-dimensional array."""
    if values.ndim == 1:
        return "{" + ", ".join(number(float(x)) for x in values) + "}"
    rows = f",\n{indent}    ".join(_array_text(row, indent, number) for row in values)
    return "{\n" + f"{indent}    {rows}\n{indent}" + "}"


def _body_lines(code: CodeModel, real: str, number: Callable[[float], str]) -> list[str]:
    (n, m), indent = code.model.gain.shape, "    "
    lines = [
        f"static const {real} matrix[{n}][{m}] = {_array_text(code.model.gain, indent, number)};",
        f"static const {real} offset[{m}] = {_array_text(code.model.zero, indent, number)};",
        f"{real} in[{m}];",
    ]
    if code.takes_temperature:
        lines += _temperature_lines(code, real, number)
    start = [f"for (int j = 0; j < {m}; ++j) {{", "    in[j] = reading[j] - offset[j];", "}"]
    multiply = [
        f"for (int i = 0; i < {n}; ++i) {{",
        f"    motion[i] = {number(0.0)};",
        f"    for (int j = 0; j < {m}; ++j) {{",
        "        motion[i] += matrix[i][j] * in[j];",
        "    }",
        "}",
    ]
    lines += [*start, *multiply]
    if code.passes:
        zero, one = number(0.0), number(1.0)
        sign = f"({{0}} > {zero} ? {one} : ({{0}} < {zero} ? -{one} : {zero}))"
        variables, channels = statements(code.model, Dialect(number, "motion[{}]", sign))
        inner = [f"const {real} {name} = {text};" for name, text in variables.items()]
        inner += start
        inner += [f"in[{k}] -= {text};" for k, text in enumerate(channels) if text]
        inner += multiply
        lines += [f"for (int pass = 0; pass < {code.passes}; ++pass) {{"]
        lines += [*(f"    {line}" for line in inner), "}"]
    return [f"    {line}" for line in lines]


def _temperature_lines(code: CodeModel, real: str, number: Callable[[float], str]) -> list[str]:
    """Return code for the temperature difference from the reference, clipped to a stated range."""
    at = "temperature"
    lines: list[str] = []
    if code.limits is not None:
        low, high = (number(x) for x in code.limits)
        lines.append(f"const {real} t = {at} < {low} ? {low} : ({at} > {high} ? {high} : {at});")
        at = "t"
    return [*lines, f"const {real} dT = {at} - {number(code.reference)};"]


C = code_target("c", "C99 header, single precision", ".h", partial(_render, _C))
CPP = code_target("cpp", "C++11 header", ".hpp", partial(_render, _CPP))
