"""Registers of devices: VectorNav and Analog Devices ADIS16xxx.

VectorNav VN-100, VN-200, VN-300: registers 25 (accelerometer) and 84 (gyro) compensation.

    out = C (in − B)

C = M⁻¹ and B = b, in single precision. The device applies this after its factory calibration.
Source: VN-100 user manual UM001 v2, 6.2.2. The checksum of a message is the XOR of the characters
between $ and *.

Analog Devices ADIS16xxx: scale and bias register words, with step sizes stated by the user.

    scale, then bias   out = (1 + n_s u_s) raw + n_b u_b
    bias, then scale   out = (1 + n_s u_s) (raw + n_b u_b)

u_s and u_b are the sizes of one register step. The data sheet of the part states these sizes and
the order. With s = n_s u_s and B = n_b u_b, 1 + s = 1/M_ii, and B = −b/M_ii (first formula) or −b
(second formula).
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.target_definition import STEP, Rendering, Request, Target, TargetOption
from inercal.export.targets import shared

REGISTERS = {"f": 25, "w": 84}


def message(body: str) -> str:
    """Return a message with its checksum.

    >>> message("VNRRG,25,1,0,0,0,1,0,0,0,1,0,0,0")
    '$VNRRG,25,1,0,0,0,1,0,0,0,1,0,0,0*75'
    """
    return f"${body}*{reduce(lambda total, one: total ^ one, body.encode(), 0):02X}"


def _render_vectornav(request: Request) -> Rendering:
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


VECTORNAV = Target(
    "vectornav", "VectorNav compensation registers", ".txt", shared.MATRICES, _render_vectornav
)


_SCALE_BITS = 16
OPTIONS = (
    TargetOption(
        "order",
        "what the part applies first, according to its data sheet: scale or bias",
        required=True,
        kind=str,
        choices=("scale", "bias"),
    ),
    *(
        TargetOption(
            f"{name}_bias_lsb",
            f"size of a step of the bias registers, '{step}'",
            like=unit,
            limits=STEP,
        )
        for name, step, unit in (("acc", "0.8 mg", "m/s^2"), ("gyro", "0.02 deg/s", "rad/s"))
    ),
    TargetOption(
        "scale_lsb",
        "size of a step of the scale registers, such as 2^-15; omit it if there are none",
        limits=STEP,
    ),
    TargetOption("bias_bits", "bits of a bias register", required=True, kind=int, limits=(2, 64)),
)
_KINDS = {"f": ("acc_bias_lsb", "ACCL", "A"), "w": ("gyro_bias_lsb", "GYRO", "G")}


def _render_adis(request: Request) -> Rendering:
    model, options = request.model, request.options
    shared.require_aligned(model, "adis")
    first, step = options["order"], options["scale_lsb"]
    lines: list[str] = []
    corrections: dict[str, shared.Correction] = {}
    for kind, triad in model.triads:
        option, word, letter = _KINDS[kind]
        lsb = shared.needed(options, OPTIONS, option, "adis")
        scale = 1 / np.diag(triad.matrix)
        words = np.zeros(3) if step is None else np.rint((scale - 1) / step)
        factor = 1 + words * (step or 0.0)
        biases = np.rint(-triad.bias * (factor if first == "scale" else 1.0) / lsb)
        if step is not None:
            lines += _registers([f"{a}_{word}_SCALE" for a in "XYZ"], words, _SCALE_BITS)
        lines += _registers([f"{a}{letter}_BIAS" for a in "XYZ"], biases, options["bias_bits"])
        corrections[kind] = _correction(factor, biases * lsb, first)

    factor_text = "" if step is None else f"(1 + {step:.9g} SCALE) "
    sizes = ", ".join(f"{options[_KINDS[k][0]]:.9g}" for k, _ in model.triads)
    formula = {
        "scale": f"out = {factor_text}raw + LSB BIAS",
        "bias": f"out = {factor_text}(raw + LSB BIAS)",
    }[first]
    return Rendering(
        shared.by_triad(model, corrections),
        shared.with_comments("register,value,word\n" + "\n".join(lines) + "\n"),
        (f"{formula}; LSB = {sizes} (m/s^2, rad/s), as the user stated it",),
        "readings with all these registers at 0, in m/s^2 and rad/s",
        (
            "check the order and the sizes in the data sheet of the part, because inercal does "
            "not know them",
        ),
        holds=dict.fromkeys("fw", shared.BIAS if step is None else shared.BIAS_AND_SCALE),
    )


def _registers(names: Sequence[str], values: Array, bits: int) -> list[str]:
    lines: list[str] = []
    for name, value in zip(names, values.astype(int).tolist(), strict=True):
        if not -(1 << (bits - 1)) <= value < 1 << (bits - 1):
            raise InputError(
                f"adis: {name} would be {value}, which does not fit into {bits} bits; check "
                "the stated sizes of a step",
                names=(name,),
            )
        lines.append(f"{name},{value},0x{value & ((1 << bits) - 1):0{bits // 4}X}")
    return lines


def _correction(factor: Array, bias: Array, first: str):
    def correct(y: Array, dT: Array) -> Array:
        return factor * y + bias if first == "scale" else factor * (y + bias)

    return correct


ADIS = Target("adis", "Analog Devices ADIS16xxx scale and bias registers", ".csv",
                dict.fromkeys("fw", shared.BIAS_AND_SCALE), _render_adis, OPTIONS)  # fmt: skip
