"""Correction scripts: a Python module without imports, and a MATLAB or Octave function.

The Python module has a function `correct` for one reading; the MATLAB function corrects rows of
readings.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.polynomial import CodeModel, Dialect, code_model, statements
from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment
from inercal.export.targets.shared import comments, number


def _python_number(value: float) -> str:
    return repr(float(value) + 0.0)


def _render_python(request: Request) -> Rendering:
    code = code_model(request)
    return code_rendering(code, lambda header: module_text(code, header))


def module_text(code: CodeModel, header: Sequence[str]) -> str:
    """Return a Python module without imports, with the lines of explanation as comments."""
    dialect = Dialect(_python_number, "motion[{}]", "({0} > 0.0) - ({0} < 0.0)")
    variables, channels = statements(code.model, dialect)
    argument, given = (word * code.takes_temperature for word in (", temperature", ", dT"))
    lines = [
        comments(header, "#").rstrip(),
        "\nMATRIX = (",
        *(f"    {tuple(row)}," for row in (code.model.gain + 0.0).tolist()),
        ")",
        f"OFFSET = {tuple((code.model.zero + 0.0).tolist())}",
        "",
        "",
        f"def correct(reading{argument}):",
        f'    """Return {motion_comment(code)}, as a tuple of numbers."""',
        "    if len(reading) != len(OFFSET):",
        '        raise ValueError(f"give {len(OFFSET)} readings, not {len(reading)}")',
        "    start = [value - offset for value, offset in zip(reading, OFFSET)]",
        "    motion = _apply(start)",
    ]
    if code.takes_temperature:
        lines.append(_difference(code, "temperature", dialect))
    if any(channels):
        lines += [
            f"    for _ in range({code.passes}):",
            f"        extra = _terms(motion{given})",
            "        motion = _apply([value - more for value, more in zip(start, extra)])",
        ]
    lines += [
        "    return motion",
        "",
        "",
        "def _apply(reading):",
        "    return tuple(sum(c * x for c, x in zip(row, reading)) for row in MATRIX)",
    ]
    if any(channels):
        lines += ["", "", f"def _terms(motion{given}):"]
        lines += [f"    {name} = {expression}" for name, expression in variables.items()]
        lines += ["    return ("]
        lines += [f"        {text or '0.0'}," for text in channels] + ["    )"]
    return "\n".join(lines) + "\n"


def _difference(code: CodeModel, at: str, dialect: Dialect) -> str:
    """Return the line with the temperature difference, limited to the range if one is stated."""
    if code.limits is not None:
        low, high = map(dialect.number, code.limits)
        at = f"min(max({at}, {low}), {high})"
    return f"    dT = {at} - {dialect.number(code.reference)}"


def _matlab_number(value: float) -> str:
    return number(value, 17)


def _matlab_matrix(values: Array) -> str:
    rows = np.atleast_2d(values)
    return "[" + "; ...\n        ".join(", ".join(map(_matlab_number, row)) for row in rows) + "]"


def _render_matlab(request: Request) -> Rendering:
    code = code_model(request)
    dialect = Dialect(_matlab_number, "motion(:, {})", "sign({0})", " .* ", first=1)
    argument = ", temperature" * code.takes_temperature

    def write(header: Sequence[str]) -> str:
        lines = [
            f"function motion = {request.name}_correct(reading{argument})",
            f"% Rows of readings to rows of motion: {motion_comment(code)}.",
            comments(header, "%").rstrip(),
            f"    C = {_matlab_matrix(code.model.gain)};",
            f"    offset = {_matlab_matrix(code.model.zero)};",
            f"    assert(size(reading, 2) == {len(code.model.zero)});",
            "    motion = (reading - offset) * C';",
        ]
        if code.takes_temperature:
            lines.append(f"{_difference(code, 'temperature(:)', dialect)};")
        if code.passes:
            variables, channels = statements(code.model, dialect)
            lines.append(f"    for pass = 1:{code.passes}")
            lines += [f"        {name} = {expression};" for name, expression in variables.items()]
            lines.append("        extra = zeros(size(reading));")
            numbered = enumerate(channels, start=1)
            lines += [f"        extra(:, {k}) = {text};" for k, text in numbered if text]
            lines += ["        motion = (reading - offset - extra) * C';", "    end"]
        return "\n".join([*lines, "end"]) + "\n"

    remarks = [f"the name of this file must be {request.name}_correct.m"]
    complete = len(code.model.zero) == len(code.model.gain)
    if complete and not code.passes and code.model.triad("f") is not None:
        bias = -(code.model.zero[:3] @ code.model.gain[:3, :3].T)
        remarks.append(
            "for U*A + b of accelcal (Navigation Toolbox), accelerometers: A = C(1:3,1:3)', b = ["
            + ", ".join(map(number, bias))
            + "]"
        )
    field = code.model.triad("m")
    if complete and not code.passes and field is not None:
        rows = f"{len(code.model.gain) - 2}:{len(code.model.gain)}"
        offset = code.model.zero[-3:]
        remarks.append(
            f"for (m - b)*A of magcal (Navigation Toolbox): A = {number(field.scale[0])} * "
            f"C({rows},{rows})', b = [{', '.join(map(number, offset))}]; expmfs is then the field "
            f"in {field.unit}"
        )
    return code_rendering(code, write, remarks=remarks)


PYTHON = code_target(
    "python", "Python module without imports", ".py", _render_python, named_by_function=True
)
MATLAB = code_target(
    "matlab", "MATLAB or Octave function", ".m", _render_matlab, named_by_function=True
)
