"""C99 header with an inline correction in single precision: no allocation, no library.

NAME_self_test corrects a reading whose result is known.
"""

from collections.abc import Sequence

import numpy as np

from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.c_text import (
    BEYOND_TOLERANCE,
    check_lines,
    header_code,
    header_text,
    literal,
)
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment


def _render(request: Request) -> Rendering:
    made = header_code(request, "float", literal)
    name, n = request.name, made.n

    def write(header: Sequence[str]) -> str:
        call = f"{name}_correct(reading{made.argument}, motion)"
        lines = [
            f"/* motion: {motion_comment(made.code)}. */",
            f"static inline void {name}_correct(const float reading[{n}]{made.parameter}, "
            f"float motion[{n}])",
            "{",
            *made.body,
            "}",
            "",
            "/* Returns 0 where the check above is reproduced to 1e-5. */",
            f"static inline int {name}_self_test(void)",
            *check_lines("float", made.constants, call, BEYOND_TOLERANCE, n),
        ]
        return header_text(header, f"INERCAL_{name.upper()}_H", lines)

    return code_rendering(made.code, write, digits=np.float32)


TARGET = code_target("c", "C99 header, single precision", ".h", _render)
