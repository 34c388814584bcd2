"""CSV: the correction C (output − offset), and every coefficient with its uncertainty in SI."""

import csv
from io import StringIO

from inercal.basics.visible_text import spreadsheet_cell
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets import shared
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import SI_UNITS

_DIGITS = 15


def _render(request: Request) -> Rendering:
    model = request.model
    matrix = shared.written(model.gain, _DIGITS)
    offset = shared.written(model.zero, _DIGITS)
    units = [QUANTITIES[kind].ascii_unit for kind, _ in model.triads for _ in range(3)]
    outputs = [model.triads[k // 3][1].unit for k in model.inputs]
    motions = [kind + axis for kind, _ in model.triads for axis in "xyz"]
    channels = [spreadsheet_cell(model.channels[k]) for k in model.inputs]
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("quantity", "row", "column", "value", "std", "unit"))
    for i, to in enumerate(motions):
        for j, name in enumerate(channels):
            unit = f"({units[i]})/({outputs[j]})"
            table.writerow(("C", to, name, shared.number(matrix[i, j], _DIGITS), "", unit))
    for name, value, unit in zip(channels, offset, outputs, strict=True):
        table.writerow(("offset", name, "", shared.number(value, _DIGITS), "", unit))
    calibration = model.calibration
    for full, value, std in zip(
        model.sensor.coefficients, calibration.values, calibration.std, strict=True
    ):
        unit = SI_UNITS[model.sensor.coefficient(full).unit]
        row = (shared.number(value, _DIGITS), shared.number(std, 6), unit)
        table.writerow(("coefficient", spreadsheet_cell(full), "", *row))
    return Rendering(
        lambda y, dT: (model.outputs(y)[:, model.inputs] - offset) @ matrix.T,
        shared.with_comments(text.getvalue()),
        ("motion = C (output - offset)",),
        shared.output_text(*(triad for _, triad in model.triads)),
        ("coefficients are those of the calibration in its own axes, u with k = 1, in SI",),
        takes_output=True,
        measured_only=True,
        states_u=True,
    )


_HOLDS = {"f": shared.MATRIX, "w": shared.MATRIX_AND_G, "m": shared.MATRIX}
TARGET = Target("csv", "CSV of the correction and of the coefficients", ".csv", _HOLDS, _render)
