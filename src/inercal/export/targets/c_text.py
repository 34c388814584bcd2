"""Pieces of code that C and C++ share, and what the targets of code say of themselves."""

from collections.abc import Callable, Sequence

import numpy as np

from inercal.arrays import Array
from inercal.export.polynomial import CodeModel, Dialect, statements
from inercal.export.term_kinds import TermKind

Number = Callable[[float], str]
CODE: frozenset[TermKind] = frozenset(
    {"bias", "scale", "misalignment", "g", "bias_temperature", "polynomial"}
)
MAX_ORDER = 99  # of temperature: code has no limit


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


def motion_comment(code: CodeModel) -> str:
    """Return what the elements of the result are."""
    words = {"f": "specific force x y z (m/s^2)", "w": "angular rate x y z (rad/s)"}
    return ", then ".join(words[kind] for kind, _ in code.model.triads)


def term_lines(code: CodeModel, dialect: Dialect, declare: str) -> tuple[list[str], list[str]]:
    """Return the variables of the terms s n, and the statements that take them from `in`."""
    variables, channels = statements(code.model, dialect)
    declared = [f"{declare}{one.name} = {one.expression};" for one in variables]
    return declared, [f"in[{k}] -= {text};" for k, text in enumerate(channels) if text]


def dialect_of(code: CodeModel, number: Number = literal) -> Dialect:
    """Return how C and C++ write the terms."""
    start = {kind: 3 * k for k, (kind, _) in enumerate(code.model.triads)}
    zero, one = number(0.0), number(1.0)
    return Dialect(
        number,
        lambda what, k: f"motion[{start[what] + k}]" if what in start else zero,
        lambda name: f"({name} > {zero} ? {one} : ({name} < {zero} ? -{one} : {zero}))",
        " * ",
    )


def temperature_lines(code: CodeModel, declare: str, number: Number) -> list[str]:
    """Return the temperature from the reference, clipped where a range is stated."""
    at = "temperature"
    lines: list[str] = []
    if code.limits is not None:
        low, high = (number(x) for x in code.limits)
        lines.append(f"    {declare}t = {at} < {low} ? {low} : ({at} > {high} ? {high} : {at});")
        at = "t"
    return [*lines, f"    {declare}dT = {at} - {number(code.reference)};"]


def formula_lines(code: CodeModel) -> tuple[str, ...]:
    """Return the formula of code."""
    if not code.passes:
        return ("motion = C (reading - offset)",)
    return (
        f"motion = C (reading - offset - n(motion)), put in {code.passes} times from n = 0; n are "
        "the terms that no matrix holds",
    )


def code_remarks(code: CodeModel) -> tuple[str, ...]:
    """Return what the user of code must know of the temperature."""
    if not code.takes_temperature:
        return ()
    if code.limits is None:
        return ("temperature in degC; no range is stated, and none is enforced",)
    low, high = code.limits
    return (f"temperature in degC, taken as within {low:.6g} to {high:.6g}",)
