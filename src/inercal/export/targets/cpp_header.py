"""C++11 header with an inline correction, a template over the type of the numbers."""

from collections.abc import Sequence

from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.c_text import (
    BEYOND_TOLERANCE,
    check_lines,
    header_code,
    header_text,
)
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment


def _real(value: float) -> str:
    text = f"{value + 0.0:.17g}"
    return f"Real({text if any(one in text for one in '.en') else f'{text}.0'})"


def _render(request: Request) -> Rendering:
    made = header_code(request, "Real", _real)
    name, n = request.name, made.n

    def write(header: Sequence[str]) -> str:
        call = f"correct<Real>(reading{made.argument}, motion)"
        lines = [
            f"namespace {name} {{",
            "",
            f"/* motion: {motion_comment(made.code)}. */",
            "template <typename Real>",
            f"inline void correct(const Real (&reading)[{n}]{made.parameter}, Real (&motion)[{n}])",
            "{",
            *made.body,
            "}",
            "",
            "/* Returns 0 where the check above is reproduced to 1e-5. */",
            "template <typename Real>",
            "inline int self_test()",
            *check_lines("Real", made.constants, call, BEYOND_TOLERANCE, n),
            "",
            f"}}  // namespace {name}",
        ]
        return header_text(header, f"INERCAL_{name.upper()}_HPP", lines)

    return code_rendering(
        made.code,
        write,
        remarks=("errors are of Real = double; float adds rounding of 1e-6 of the largest result",),
    )


TARGET = code_target("cpp", "C++11 header", ".hpp", _render)
