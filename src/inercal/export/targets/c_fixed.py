"""C99 header with an inline correction in integer arithmetic, for counts.

    motion = round((Σ K x + B) / 2^s),   K = C 2^(s + p),   B = −Σ C o 2^(s + p)

The counts are x; C and o apply to the sensor's own output. The result is in steps of 2^−p, where p
is 16 for m/s² and 20 for rad/s. The shift s is the largest value for which six products fit in 63
bits. K has 28 bits. B has 64 bits, so the offset is not rounded to a count. Rounding the result
causes an error of at most half a step, and rounding K causes at most |x| 2^−(s + p + 1) for each
product.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units.expression import canonical_name
from inercal.export.target_definition import STEP, Rendering, Request, Target, TargetOption
from inercal.export.targets.c_headers import check_lines, header_text
from inercal.export.targets.shared import MATRIX, MATRIX_AND_G, needed
from inercal.physics.quantities import QUANTITIES

_FRACTION = {"f": 16, "w": 20}
_BITS = 28  # bits of K; six products with 32-bit counts then fit in 63 bits
_MAX_SHIFT = 40
_LARGEST_CONSTANT = 1 << 61  # the sum of the products is at most 2^61.6
OPTIONS = (TargetOption("lsb", "output units of one count of the reading", limits=STEP),)


def _render(request: Request) -> Rendering:
    model = request.model
    units = tuple(dict.fromkeys(triad.unit for _, triad in model.triads))
    default = 1.0 if {canonical_name(unit) for unit in units} == {"LSB"} else None
    stated = request.options["lsb"]
    lsb: float = needed({"lsb": default if stated is None else stated}, OPTIONS, "lsb", "c_fixed")
    kinds = [kind for kind, _ in model.triads]
    inputs, matrix = model.inputs, model.gain * lsb
    n, m = matrix.shape
    fraction = np.repeat([_FRACTION[kind] for kind in kinds], 3)
    largest = np.abs(matrix).reshape(len(kinds), -1).max(axis=1) * 2.0 ** fraction[::3]
    shift = np.repeat([_shift(one) for one in largest.tolist()], 3)
    one = 2.0 ** (shift + fraction)
    factors = np.rint(matrix * one[:, None]).astype(np.int64)
    constants = [round(float(x)) for x in -(model.gain @ model.zero) * one]
    if max(map(abs, constants)) >= _LARGEST_CONSTANT:
        raise InputError(
            "c_fixed: the offset is too large for these integers; choose target c", key="--to"
        )
    name = request.name

    def correct(readings: Array, dT: Array) -> Array:
        counts = np.rint(model.outputs(readings)[:, inputs] / lsb).astype(np.int64)
        total = counts @ factors.T + np.array(constants, dtype=np.int64)
        half = 1 << (shift - 1)
        size = (np.abs(total) + half) >> shift
        return np.sign(total) * size / 2.0**fraction

    def possible(readings: Array) -> Array:
        rounded = model.outputs(readings)
        rounded[:, inputs] = np.rint(rounded[:, inputs] / lsb) * lsb
        return (rounded - model.joined("offset")) / model.joined("scale")

    seen = possible(request.check_reading)
    expected = np.rint(correct(seen, request.check_dT)[0] * 2.0**fraction).astype(int).tolist()
    counted = np.rint(model.outputs(seen)[0, inputs] / lsb).astype(int).tolist()
    constants_of_test = {
        "reading": f"{{{', '.join(map(str, counted))}}}",
        "expected": f"{{{', '.join(map(str, expected))}}}",
    }

    def write(header: Sequence[str]) -> str:
        rows = ",\n".join(
            "        {" + ", ".join(f"INT64_C({x})" for x in row) + "}" for row in factors.tolist()
        )
        loops = [line for k in range(len(kinds)) for line in _loop(m, 3 * k, int(shift[3 * k]))]
        steps = {"f": "2^-16 m/s^2", "w": "2^-20 rad/s"}
        parts = ", then ".join(f"{QUANTITIES[k].name} x y z in steps of {steps[k]}" for k in kinds)
        lines = [
            "#include <stdint.h>",
            "",
            f"/* motion: {parts}. */",
            f"static inline void {name}_correct_fixed(const int32_t reading[{m}], "
            f"int32_t motion[{n}])",
            "{",
            f"    static const int64_t factor[{n}][{m}] = {{",
            rows,
            "    };",
            f"    static const int64_t constant[{n}] = {{"
            + ", ".join(f"INT64_C({x})" for x in constants)
            + "};",
            *loops,
            "}",
            "",
            "/* Returns 0 if a reading gives the expected motion. */",
            f"static inline int {name}_self_test_fixed(void)",
            *check_lines(
                "int32_t",
                constants_of_test,
                f"{name}_correct_fixed(reading, motion)",
                "motion[i] != expected[i]",
                n,
            ),
        ]
        return header_text(header, f"INERCAL_{name.upper()}_FIXED_H", lines)

    return Rendering(
        correct,
        write,
        ("motion 2^p = round((sum of K x + B) / 2^s) in 64 bit integers; p = 16 and 20",),
        f"readings in whole counts of {' and '.join(f'{lsb:.9g} {unit}' for unit in units)}",
        (
            "rounding: half a step of the result (7.6e-06 m/s^2, 4.8e-07 rad/s), and of each "
            f"factor K, {_rounding_text(shift, fraction)}",
        ),
        takes_output=True,
        measured_only=True,
        possible=possible,
    )


def _loop(m: int, first: int, shift: int) -> list[str]:
    """Return the C code for the loop over three channels.

    The divisor is a constant, so a 32-bit compiler needs no 64-bit division.
    """
    one, half = f"INT64_C({1 << shift})", f"INT64_C({1 << (shift - 1)})"
    return [
        f"    for (int i = {first}; i < {first + 3}; ++i) {{",
        "        int64_t sum = constant[i];",
        f"        for (int j = 0; j < {m}; ++j) {{",
        "            sum += factor[i][j] * reading[j];",
        "        }",
        "        /* Halves are rounded away from zero. */",
        f"        sum += sum < 0 ? -{half} : {half};",
        f"        motion[i] = (int32_t)(sum / {one});",
        "    }",
    ]


def _shift(largest: float) -> int:
    """Return the shift s for rows whose factors are at most `largest` if s = 0."""
    shift = int(np.floor(_BITS - np.log2(largest)))
    if shift < 1:
        raise InputError(
            "c_fixed: one count is too large a motion for these integers; state --set lsb, or "
            "choose target c",
            key="--set",
        )
    return min(shift, _MAX_SHIFT)


def _rounding_text(shift: Array, fraction: Array) -> str:
    sizes = dict.fromkeys(float(x) for x in 2.0 ** -(shift + fraction + 1.0))
    return " and ".join(f"{x:.2g}" for x in sizes) + " per count"


TARGET = Target("c_fixed", "C99 header in integers", ".h", {"f": MATRIX, "w": MATRIX_AND_G},
                _render, OPTIONS)  # fmt: skip
