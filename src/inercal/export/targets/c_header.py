"""C99 header with an inline correction in single precision: no allocation, no library.

`NAME_self_test` corrects a reading whose result is known.
"""

from collections.abc import Sequence

import numpy as np

from inercal.export.cost import sample
from inercal.export.polynomial import CodeModel, code_model
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.c_text import (
    CODE,
    MAX_ORDER,
    array_text,
    block_comment,
    code_remarks,
    dialect_of,
    formula_lines,
    literal,
    motion_comment,
    temperature_lines,
    term_lines,
)
from inercal.export.targets.shared import output_text


def _body(code: CodeModel, n: int) -> list[str]:
    indent = "    "
    lines = [f"    static const float matrix[{n}][{n}] = {array_text(code.matrix, indent)};"]
    lines += [f"    static const float offset[{n}] = {array_text(code.offset, indent)};"]
    lines += [f"    float in[{n}];", "    int i, j;"]
    if code.passes:
        lines.append("    int pass;")
    if code.takes_temperature:
        lines += temperature_lines(code, "const float ", literal)
    sweep = [
        f"for (i = 0; i < {n}; ++i) {{",
        "    motion[i] = 0.0f;",
        f"    for (j = 0; j < {n}; ++j) {{",
        "        motion[i] += matrix[i][j] * in[j];",
        "    }",
        "}",
    ]
    start = [f"for (j = 0; j < {n}; ++j) {{", "    in[j] = reading[j] - offset[j];", "}"]
    lines += [f"    {line}" for line in (*start, *sweep)]
    if code.passes:
        declared, subtractions = term_lines(code, dialect_of(code), "const float ")
        lines.append(f"    for (pass = 0; pass < {code.passes}; ++pass) {{")
        lines += [f"        {line}" for line in (*declared, *start, *subtractions, *sweep)]
        lines.append("    }")
    return lines


def _render(request: Request) -> Rendering:
    code = code_model(request)
    name, n = request.name, len(code.offset)
    samples = sample(code.model, request.ranges)
    readings, dT = samples.readings[-1:], samples.dT[-1:]
    output = code.model.outputs(readings)[0]
    expected = code.correct(readings, dT)[0]
    temperature = ", float temperature" * code.takes_temperature
    given = f", {literal(code.reference + float(dT[0]))}" * code.takes_temperature
    guard = f"INERCAL_{name.upper()}_H"

    def write(header: Sequence[str]) -> str:
        tolerance = [1e-5 * max(1.0, abs(x)) for x in expected]
        lines = [
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"/* motion: {motion_comment(code)}. */",
            f"static inline void {name}_correct(const float reading[{n}]{temperature}, "
            f"float motion[{n}])",
            "{",
            *_body(code, n),
            "}",
            "",
            "/* Returns 0 where the check above is reproduced to 1e-5. */",
            f"static inline int {name}_self_test(void)",
            "{",
            f"    static const float reading[{n}] = {array_text(output, '    ')};",
            f"    static const float expected[{n}] = {array_text(expected, '    ')};",
            f"    static const float tolerance[{n}] = {array_text(np.array(tolerance), '    ')};",
            f"    float motion[{n}];",
            "    int i;",
            f"    {name}_correct(reading{given}, motion);",
            f"    for (i = 0; i < {n}; ++i) {{",
            "        const float error = motion[i] - expected[i];",
            "        if (!(error <= tolerance[i] && error >= -tolerance[i])) {",
            "            return i + 1;",
            "        }",
            "    }",
            "    return 0;",
            "}",
            "",
            "#endif",
        ]
        return block_comment(header) + "\n".join(lines) + "\n"

    return Rendering(
        lambda y, t: code.correct(y, t, np.float32),
        write,
        formula_lines(code),
        output_text(*(triad for _, triad in code.model.triads)),
        code_remarks(code),
        takes_output=True,
    )


TARGET = Target("c", "C99 header, single precision", ".h", {"f": CODE, "w": CODE}, _render,
                temperature_order=MAX_ORDER, clips_temperature=True)  # fmt: skip
