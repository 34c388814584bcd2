"""VectorNav VN-100, VN-200, VN-300: registers 25 (accelerometer) and 84 (gyro) compensation.

    out = C (in − B)

C = M⁻¹ and B = b, in single precision. The device applies this after its factory calibration.
Source: VN-100 user manual UM001 v2, 6.2.2. The checksum of a message is the XOR of the characters
between $ and *.
"""

from functools import reduce

from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets import shared

REGISTERS = {"f": 25, "w": 84}


def message(body: str) -> str:
    """Return a message with its checksum.

    >>> message("VNRRG,25,1,0,0,0,1,0,0,0,1,0,0,0")
    '$VNRRG,25,1,0,0,0,1,0,0,0,1,0,0,0*75'
    """
    return f"${body}*{reduce(lambda total, one: total ^ one, body.encode(), 0):02X}"


def _render(request: Request) -> Rendering:
    model = request.model
    lines: list[str] = []
    corrections: dict[str, shared.Correction] = {}
    for kind, triad in model.triads:
        matrix, bias = shared.single(triad.correction), shared.single(triad.bias)
        values = ",".join(shared.number(x) for x in (*matrix.ravel(), *bias))
        lines.append(message(f"VNWRG,{REGISTERS[kind]},{values}"))
        corrections[kind] = shared.matrix_correction(matrix, bias)

    return Rendering(
        shared.by_triad(model, corrections),
        shared.with_comments("\n".join([*lines, message("VNWNV")]) + "\n"),
        ("out = C (in - B), C row by row, then B: register 25 of force, 84 of rate",),
        "readings that both registers leave as they are (C = I, B = 0), in m/s^2 and rad/s",
        ("send the lines that begin with $; VNWNV stores them in the device",),
    )


TARGET = Target(
    "vectornav",
    "VectorNav compensation registers",
    ".txt",
    {"f": shared.MATRIX, "w": shared.MATRIX},
    _render,
)
