"""Pieces of code that the headers of C and C++ share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.polynomial import CodeModel, Dialect, code_model, statements
from inercal.export.target_definition import Request

Number = Callable[[float], str]
_TOLERANCE = 1e-5  # of the self-test, of results above 1


@dataclass(frozen=True, eq=False)
class HeaderCode:
    """The parts of a header that are the same in C and C++.

    Parameters
    ----------
    code : CodeModel
    n : int
        Channels.
    parameter : str
        Declaration of the temperature in the list of parameters; empty where none is taken.
    body : list of str
        Statements of the correction, from `reading` to `motion`.
    argument : str
        Temperature of the self-test in the list of arguments.
    constants : mapping of str to str
        Initialisers of the self-test: reading, expected result and tolerance.
    """

    code: CodeModel
    n: int
    parameter: str
    body: list[str]
    argument: str
    constants: Mapping[str, str]


def header_code(request: Request, real: str, number: Number) -> HeaderCode:
    """Return the parts of a header whose numbers have the type `real`.

    Raises
    ------
    InputError
        The passes do not converge over the calibrated range.
    """
    code = code_model(request)
    expected = code.correct(request.check_reading, request.check_dT)[0]
    arrays = {
        "reading": code.model.outputs(request.check_reading)[0],
        "expected": expected,
        "tolerance": _TOLERANCE * np.maximum(1.0, np.abs(expected)),
    }
    celsius = number(code.reference + float(request.check_dT[0]))
    return HeaderCode(
        code,
        len(code.offset),
        f", {real} temperature" * code.takes_temperature,
        _body_lines(code, real, number),
        f", {celsius}" * code.takes_temperature,
        {name: array_text(values, "    ", number) for name, values in arrays.items()},
    )


def header_text(comment: Sequence[str], guard: str, lines: Sequence[str]) -> str:
    """Return a header with its explanation and its include guard."""
    parts = [f"#ifndef {guard}", f"#define {guard}", "", *lines, "", "#endif"]
    return block_comment(comment) + "\n".join(parts) + "\n"


def check_lines(
    kind: str, constants: Mapping[str, str], call: str, failure: str, n: int
) -> list[str]:
    """Return the body of a self-test: 0, or the number of the channel whose result is wrong.

    Parameters
    ----------
    kind : str
        Type of the numbers.
    constants : mapping of str to str
        Initialisers of constant arrays, (n,), by name.
    call : str
        The call of the correction, from `reading` to `motion`.
    failure : str
        The condition of a wrong result of channel i.
    n : int
        Channels.
    """
    return [
        "{",
        *(f"    static const {kind} {name}[{n}] = {text};" for name, text in constants.items()),
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


# Written so that a NaN fails.
BEYOND_TOLERANCE = (
    "!(motion[i] - expected[i] <= tolerance[i] && expected[i] - motion[i] <= tolerance[i])"
)


def literal(value: float) -> str:
    """Return a constant of single precision.

    >>> literal(2.0), literal(1e-7)
    ('2.0f', '1.00000001e-07f')
    """
    text = f"{float(np.float32(value)) + 0.0:.9g}"
    return f"{text if any(one in text for one in '.en') else f'{text}.0'}f"


def block_comment(lines: Sequence[str]) -> str:
    """Return a comment of C."""
    return "/*\n" + "".join(f" * {line}".rstrip() + "\n" for line in lines) + " */\n"


def array_text(values: Array, indent: str, number: Number = literal) -> str:
    """Return the initialiser of an array of one or two dimensions."""
    if values.ndim == 1:
        return "{" + ", ".join(number(float(x)) for x in values) + "}"
    rows = f",\n{indent}    ".join(array_text(row, indent, number) for row in values)
    return "{\n" + f"{indent}    {rows}\n{indent}" + "}"


def _body_lines(code: CodeModel, real: str, number: Number) -> list[str]:
    n, indent = len(code.offset), "    "
    lines = [
        f"static const {real} matrix[{n}][{n}] = {array_text(code.matrix, indent, number)};",
        f"static const {real} offset[{n}] = {array_text(code.offset, indent, number)};",
        f"{real} in[{n}];",
    ]
    if code.takes_temperature:
        lines += _temperature_lines(code, real, number)
    start = [f"for (int j = 0; j < {n}; ++j) {{", "    in[j] = reading[j] - offset[j];", "}"]
    multiply = [
        f"for (int i = 0; i < {n}; ++i) {{",
        f"    motion[i] = {number(0.0)};",
        f"    for (int j = 0; j < {n}; ++j) {{",
        "        motion[i] += matrix[i][j] * in[j];",
        "    }",
        "}",
    ]
    lines += [*start, *multiply]
    if code.passes:
        variables, channels = statements(code.model, _dialect(code, number))
        inner = [f"const {real} {one.name} = {one.expression};" for one in variables]
        inner += start
        inner += [f"in[{k}] -= {text};" for k, text in enumerate(channels) if text]
        inner += multiply
        lines += [f"for (int pass = 0; pass < {code.passes}; ++pass) {{"]
        lines += [*(f"    {line}" for line in inner), "}"]
    return [f"    {line}" for line in lines]


def _dialect(code: CodeModel, number: Number) -> Dialect:
    """Return how C and C++ write the terms."""
    start = {kind: 3 * k for k, (kind, _) in enumerate(code.model.triads)}
    zero, one = number(0.0), number(1.0)
    return Dialect(
        number,
        lambda what, k: f"motion[{start[what] + k}]" if what in start else zero,
        lambda name: f"({name} > {zero} ? {one} : ({name} < {zero} ? -{one} : {zero}))",
        " * ",
    )


def _temperature_lines(code: CodeModel, real: str, number: Number) -> list[str]:
    """Return the temperature from the reference, limited where a range is stated."""
    at = "temperature"
    lines: list[str] = []
    if code.limits is not None:
        low, high = (number(x) for x in code.limits)
        lines.append(f"const {real} t = {at} < {low} ? {low} : ({at} > {high} ? {high} : {at});")
        at = "t"
    return [*lines, f"const {real} dT = {at} - {number(code.reference)};"]
