"""Write what all code targets share: the supported terms, the formula and the remarks."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from inercal.export.polynomial import CodeModel
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.shared import output_text
from inercal.export.term_kinds import TermKind
from inercal.physics.quantities import KINDS, QUANTITIES

_HELD: frozenset[TermKind] = frozenset(
    {"bias", "scale", "misalignment", "g", "bias_temperature", "polynomial"}
)
_MAX_ORDER = 99  # highest power of temperature; code has no limit


def code_target(
    name: str,
    meaning: str,
    suffix: str,
    render: Callable[[Request], Rendering],
    *,
    named_by_function: bool = False,
) -> Target:
    """Return a target for code; it supports all terms except derivatives (`DERIVATIVES`)."""
    return Target(
        name,
        meaning,
        suffix,
        dict.fromkeys(KINDS, _HELD),
        render,
        temperature_order=_MAX_ORDER,
        named_by_function=named_by_function,
    )


def code_rendering(
    code: CodeModel,
    write: Callable[[Sequence[str]], str],
    *,
    digits: type[Any] = np.float64,
    remarks: Sequence[str] = (),
) -> Rendering:
    """Return the rendering for code that computes with numbers of type `digits`."""
    return Rendering(
        lambda y, dT: code.correct(y, dT, digits),
        write,
        _formula_lines(code),
        output_text(*(triad for _, triad in code.model.triads)),
        (*_temperature_remarks(code), *remarks),
        takes_output=True,
        measured_only=True,
    )


def motion_comment(code: CodeModel) -> str:
    """Return a comment that lists the elements of the result."""
    quantities = [QUANTITIES[kind] for kind, _ in code.model.triads]
    return ", then ".join(f"{one.name} x y z ({one.ascii_unit})" for one in quantities)


def _formula_lines(code: CodeModel) -> tuple[str, ...]:
    if not code.passes:
        return ("motion = C (reading - offset)",)
    return (
        f"motion = C (reading - offset - n(motion)), computed {code.passes} times beginning with "
        "n = 0; n are the nonlinear and temperature terms",
    )


def _temperature_remarks(code: CodeModel) -> tuple[str, ...]:
    if not code.takes_temperature:
        return ()
    if code.limits is None:
        return ("temperature in degC; no range is stated, so the code does not limit it",)
    low, high = code.limits
    return (f"temperature in degC; the code limits it to {low:.6g} to {high:.6g}",)
