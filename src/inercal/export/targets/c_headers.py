"""C99 headers in single precision, and C++11 headers with a template over the number type.

The correction is inline and needs neither memory allocation nor a library. A self-test corrects a
reading whose result is known.

The C99 header in integers, `c_fixed`, corrects counts::

    motion = round((Σ K x + B) / 2^s),   K = C 2^(s + p),   B = −Σ C o 2^(s + p)

The counts are x; C and o apply to the sensor's own output. The result is in steps of 2^−p, where p
is 16 for m/s² and 20 for rad/s. The shift s is the largest value for which six products fit in 63
bits. K has 28 bits. B has 64 bits, so the offset is not rounded to a count. Rounding the result
causes an error of at most half a step, and rounding K causes at most |x| 2^−(s + p + 1) for each
product.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units.expression import canonical_name
from inercal.export.polynomial import CodeModel, Dialect, code_model, statements
from inercal.export.target_definition import STEP, Rendering, Request, Target, TargetOption
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment
from inercal.export.targets.shared import MATRIX, MATRIX_AND_G, needed
from inercal.physics.quantities import QUANTITIES

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
        + (", and its field to 1e-9 T" * (code.model.triad("m") is not None))
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


_FRACTION = {"f": 16, "w": 20}
_BITS = 28  # bits of K; six products with 32-bit counts then fit in 63 bits
_MAX_SHIFT = 40
_LARGEST_CONSTANT = 1 << 61  # the sum of the products is at most 2^61.6
_FIXED_OPTIONS = (TargetOption("lsb", "output units of one count of the reading", limits=STEP),)


def _render_integers(request: Request) -> Rendering:
    model = request.model
    units = tuple(dict.fromkeys(triad.unit for _, triad in model.triads))
    default = 1.0 if {canonical_name(unit) for unit in units} == {"LSB"} else None
    stated = request.options["lsb"]
    lsb: float = needed(
        {"lsb": default if stated is None else stated}, _FIXED_OPTIONS, "lsb", "c_fixed"
    )
    kinds = [kind for kind, _ in model.triads]
    inputs, matrix = model.inputs, model.gain * lsb
    n, m = matrix.shape
    fraction = np.repeat([_FRACTION[kind] for kind in kinds], 3)
    largest = np.abs(matrix).reshape(len(kinds), -1).max(axis=1) * 2.0 ** fraction[::3]
    shift = np.repeat([_shift(one) for one in largest.tolist()], 3)
    one = 2.0 ** (shift + fraction)
    factors = np.rint(matrix * one[:, None]).astype(np.int64)
    constants = [round(float(x)) for x in -(model.gain @ model.zero) * one]
    if max(map(abs, constants)) >= _LARGEST_CONSTANT:
        raise InputError(
            "c_fixed: the offset is too large for these integers; choose target c", key="--to"
        )
    name = request.name

    def correct(readings: Array, dT: Array) -> Array:
        counts = np.rint(model.outputs(readings)[:, inputs] / lsb).astype(np.int64)
        total = counts @ factors.T + np.array(constants, dtype=np.int64)
        half = 1 << (shift - 1)
        size = (np.abs(total) + half) >> shift
        return np.sign(total) * size / 2.0**fraction

    def possible(readings: Array) -> Array:
        rounded = model.outputs(readings)
        rounded[:, inputs] = np.rint(rounded[:, inputs] / lsb) * lsb
        return (rounded - model.joined("offset")) / model.joined("scale")

    seen = possible(request.check_reading)
    expected = np.rint(correct(seen, request.check_dT)[0] * 2.0**fraction).astype(int).tolist()
    counted = np.rint(model.outputs(seen)[0, inputs] / lsb).astype(int).tolist()
    constants_of_test = {
        "reading": f"{{{', '.join(map(str, counted))}}}",
        "expected": f"{{{', '.join(map(str, expected))}}}",
    }

    def write(header: Sequence[str]) -> str:
        rows = ",\n".join(
            "        {" + ", ".join(f"INT64_C({x})" for x in row) + "}" for row in factors.tolist()
        )
        loops = [line for k in range(len(kinds)) for line in _loop(m, 3 * k, int(shift[3 * k]))]
        steps = {"f": "2^-16 m/s^2", "w": "2^-20 rad/s"}
        parts = ", then ".join(f"{QUANTITIES[k].name} x y z in steps of {steps[k]}" for k in kinds)
        lines = [
            "#include <stdint.h>",
            "",
            f"/* motion: {parts}. */",
            f"static inline void {name}_correct_fixed(const int32_t reading[{m}], "
            f"int32_t motion[{n}])",
            "{",
            f"    static const int64_t factor[{n}][{m}] = {{",
            rows,
            "    };",
            f"    static const int64_t constant[{n}] = {{"
            + ", ".join(f"INT64_C({x})" for x in constants)
            + "};",
            *loops,
            "}",
            "",
            "/* Returns 0 if a reading gives the expected motion. */",
            f"static inline int {name}_self_test_fixed(void)",
            *check_lines(
                "int32_t",
                constants_of_test,
                f"{name}_correct_fixed(reading, motion)",
                "motion[i] != expected[i]",
                n,
            ),
        ]
        return header_text(header, f"INERCAL_{name.upper()}_FIXED_H", lines)

    return Rendering(
        correct,
        write,
        ("motion 2^p = round((sum of K x + B) / 2^s) in 64 bit integers; p = 16 and 20",),
        f"readings in whole counts of {' and '.join(f'{lsb:.9g} {unit}' for unit in units)}",
        (
            "rounding: half a step of the result (7.6e-06 m/s^2, 4.8e-07 rad/s), and of each "
            f"factor K, {_rounding_text(shift, fraction)}",
        ),
        takes_output=True,
        measured_only=True,
        possible=possible,
    )


def _loop(m: int, first: int, shift: int) -> list[str]:
    """Return the C code for the loop over three channels.

    The divisor is a constant, so a 32-bit compiler needs no 64-bit division.
    """
    one, half = f"INT64_C({1 << shift})", f"INT64_C({1 << (shift - 1)})"
    return [
        f"    for (int i = {first}; i < {first + 3}; ++i) {{",
        "        int64_t sum = constant[i];",
        f"        for (int j = 0; j < {m}; ++j) {{",
        "            sum += factor[i][j] * reading[j];",
        "        }",
        "        /* Halves are rounded away from zero. */",
        f"        sum += sum < 0 ? -{half} : {half};",
        f"        motion[i] = (int32_t)(sum / {one});",
        "    }",
    ]


def _shift(largest: float) -> int:
    """Return the shift s for rows whose factors are at most `largest` if s = 0."""
    shift = int(np.floor(_BITS - np.log2(largest)))
    if shift < 1:
        raise InputError(
            "c_fixed: one count is too large a motion for these integers; state --set lsb, or "
            "choose target c",
            key="--set",
        )
    return min(shift, _MAX_SHIFT)


def _rounding_text(shift: Array, fraction: Array) -> str:
    sizes = dict.fromkeys(float(x) for x in 2.0 ** -(shift + fraction + 1.0))
    return " and ".join(f"{x:.2g}" for x in sizes) + " per count"


C_FIXED = Target("c_fixed", "C99 header in integers", ".h", {"f": MATRIX, "w": MATRIX_AND_G},
                _render_integers, _FIXED_OPTIONS)  # fmt: skip
