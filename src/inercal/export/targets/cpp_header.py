"""C++11 header with an inline correction, a template over the type of the numbers."""

from collections.abc import Sequence

import numpy as np

from inercal.export.cost import sample
from inercal.export.polynomial import code_model
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.c_text import (
    CODE,
    MAX_ORDER,
    array_text,
    block_comment,
    code_remarks,
    dialect_of,
    formula_lines,
    motion_comment,
    temperature_lines,
    term_lines,
)
from inercal.export.targets.shared import output_text


def _real(value: float) -> str:
    text = f"{value + 0.0:.17g}"
    return f"Real({text if any(one in text for one in '.en') else f'{text}.0'})"


def _render(request: Request) -> Rendering:
    code = code_model(request)
    name, n = request.name, len(code.offset)
    samples = sample(code.model, request.ranges)
    readings, dT = samples.readings[-1:], samples.dT[-1:]
    output = code.model.outputs(readings)[0]
    expected = code.correct(readings, dT)[0]
    temperature = ", Real temperature" * code.takes_temperature
    given = f", {_real(code.reference + float(dT[0]))}" * code.takes_temperature
    guard = f"INERCAL_{name.upper()}_HPP"
    start = [f"for (int j = 0; j < {n}; ++j) {{", "    in[j] = reading[j] - offset[j];", "}"]
    sweep = [
        f"for (int i = 0; i < {n}; ++i) {{",
        "    motion[i] = Real(0);",
        f"    for (int j = 0; j < {n}; ++j) {{",
        "        motion[i] += matrix[i][j] * in[j];",
        "    }",
        "}",
    ]
    body = [
        f"    static const Real matrix[{n}][{n}] = {array_text(code.matrix, '    ', _real)};",
        f"    static const Real offset[{n}] = {array_text(code.offset, '    ', _real)};",
        f"    Real in[{n}];",
    ]
    if code.takes_temperature:
        body += temperature_lines(code, "const Real ", _real)
    body += [f"    {line}" for line in (*start, *sweep)]
    if code.passes:
        declared, subtractions = term_lines(code, dialect_of(code, _real), "const Real ")
        inner = [*declared, *start, *subtractions, *sweep]
        body.append(f"    for (int pass = 0; pass < {code.passes}; ++pass) {{")
        body += [f"        {line}" for line in inner]
        body.append("    }")

    def write(header: Sequence[str]) -> str:
        lines = [
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"namespace {name} {{",
            "",
            f"/* motion: {motion_comment(code)}. */",
            "template <typename Real>",
            f"inline void correct(const Real (&reading)[{n}]{temperature}, Real (&motion)[{n}])",
            "{",
            *body,
            "}",
            "",
            "/* Returns 0 where the check above is reproduced to 1e-5. */",
            "template <typename Real>",
            "inline int self_test()",
            "{",
            f"    const Real reading[{n}] = {array_text(output, '    ', _real)};",
            f"    const Real expected[{n}] = {array_text(expected, '    ', _real)};",
            f"    Real motion[{n}];",
            f"    correct<Real>(reading{given}, motion);",
            f"    for (int i = 0; i < {n}; ++i) {{",
            "        const Real error = motion[i] - expected[i];",
            "        const Real size = expected[i] < Real(0) ? -expected[i] : expected[i];",
            "        const Real tolerance = Real(1e-5) * (size > Real(1) ? size : Real(1));",
            "        if (!(error <= tolerance && error >= -tolerance)) {",
            "            return i + 1;",
            "        }",
            "    }",
            "    return 0;",
            "}",
            "",
            f"}}  // namespace {name}",
            "",
            "#endif",
        ]
        return block_comment(header) + "\n".join(lines) + "\n"

    return Rendering(
        lambda y, t: code.correct(y, t, np.float64),
        write,
        formula_lines(code),
        output_text(*(triad for _, triad in code.model.triads)),
        (*code_remarks(code), "errors are of Real = double; float adds rounding of 1e-6"),
        takes_output=True,
    )


TARGET = Target("cpp", "C++11 header", ".hpp", {"f": CODE, "w": CODE}, _render,
                temperature_order=MAX_ORDER, clips_temperature=True)  # fmt: skip
