"""MATLAB or Octave function that corrects rows of readings."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.polynomial import Dialect, code_model, statements
from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment
from inercal.export.targets.shared import comments, number


def _number(value: float) -> str:
    return number(value, 17)


def _matrix(values: Array) -> str:
    rows = np.atleast_2d(values)
    return "[" + "; ...\n        ".join(", ".join(map(_number, row)) for row in rows) + "]"


def _render(request: Request) -> Rendering:
    code = code_model(request)
    start = {kind: 3 * k + 1 for k, (kind, _) in enumerate(code.model.triads)}
    dialect = Dialect(
        _number,
        lambda what, k: f"motion(:, {start[what] + k})" if what in start else "0",
        lambda name: f"sign({name})",
        " .* ",
    )
    argument = ", temperature" * code.takes_temperature

    def write(header: Sequence[str]) -> str:
        lines = [
            f"function motion = {request.name}_correct(reading{argument})",
            f"% Rows of readings to rows of motion: {motion_comment(code)}.",
            comments(header, "%").rstrip(),
            f"    C = {_matrix(code.matrix)};",
            f"    offset = {_matrix(code.offset)};",
            "    motion = (reading - offset) * C';",
        ]
        if code.takes_temperature:
            at = "temperature(:)"
            if code.limits is not None:
                low, high = map(_number, code.limits)
                at = f"min(max(temperature(:), {low}), {high})"
            lines.append(f"    dT = {at} - {_number(code.reference)};")
        if code.passes:
            variables, channels = statements(code.model, dialect)
            lines.append(f"    for pass = 1:{code.passes}")
            lines += [f"        {one.name} = {one.expression};" for one in variables]
            lines.append("        extra = zeros(size(reading));")
            lines += [
                f"        extra(:, {k}) = {text};"
                for k, text in enumerate(channels, start=1)
                if text
            ]
            lines += ["        motion = (reading - offset - extra) * C';", "    end"]
        return "\n".join([*lines, "end"]) + "\n"

    plain = code.matrix[:3, :3]
    remarks = [f"the name of this file must be {request.name}_correct.m"]
    if not code.passes and code.model.accelerometer is not None:
        bias = -(code.offset[:3] @ plain.T)
        remarks.append(
            "for U*A + b of accelcal (Navigation Toolbox), accelerometers: A = C(1:3,1:3)', b = ["
            + ", ".join(map(number, bias))
            + "]"
        )
    return code_rendering(code, write, remarks=remarks)


TARGET = code_target("matlab", "MATLAB or Octave function", ".m", _render, named_by_function=True)
