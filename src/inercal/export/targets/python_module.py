"""Python module with a function `correct` and no import at all."""

from collections.abc import Sequence

from inercal.export.polynomial import CodeModel, Dialect, code_model, statements
from inercal.export.target_definition import Rendering, Request
from inercal.export.targets.code_text import code_rendering, code_target, motion_comment
from inercal.export.targets.shared import comments


def _number(value: float) -> str:
    return repr(float(value) + 0.0)


def _rows(code: CodeModel) -> str:
    rows = ",\n".join(f"    ({', '.join(map(_number, row))})" for row in code.matrix)
    return f"MATRIX = (\n{rows},\n)"


def _render(request: Request) -> Rendering:
    code = code_model(request)
    start = {kind: 3 * k for k, (kind, _) in enumerate(code.model.triads)}
    dialect = Dialect(
        _number,
        lambda what, k: f"motion[{start[what] + k}]" if what in start else "0.0",
        lambda name: f"({name} > 0.0) - ({name} < 0.0)",
        " * ",
    )
    argument = ", temperature" * code.takes_temperature

    def write(header: Sequence[str]) -> str:
        lines = [
            comments(header, "#").rstrip(),
            "",
            _rows(code),
            f"OFFSET = ({', '.join(map(_number, code.offset))})",
            "",
            "",
            f"def correct(reading{argument}):",
            f'    """Return {motion_comment(code)}, as a tuple of numbers."""',
            "    start = [value - offset for value, offset in zip(reading, OFFSET)]",
            "    motion = _apply(start)",
        ]
        if code.takes_temperature:
            at = "temperature"
            if code.limits is not None:
                low, high = map(_number, code.limits)
                at = f"min(max(temperature, {low}), {high})"
            lines.append(f"    dT = {at} - {_number(code.reference)}")
        if code.passes:
            given = ", dT" * code.takes_temperature
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
        if code.passes:
            given = ", dT" * code.takes_temperature
            variables, channels = statements(code.model, dialect)
            lines += ["", "", f"def _terms(motion{given}):"]
            lines += [f"    {one.name} = {one.expression}" for one in variables]
            lines += ["    return ("]
            lines += [f"        {text or '0.0'}," for text in channels] + ["    )"]
        return "\n".join(lines) + "\n"

    return code_rendering(code, write)


TARGET = code_target(
    "python", "Python module without imports", ".py", _render, named_by_function=True
)
