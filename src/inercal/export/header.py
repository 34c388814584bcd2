"""Write the explanation in every exported file, in ASCII because some devices need this."""

import textwrap
import unicodedata
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from inercal.basics.units import ZERO_CELSIUS
from inercal.basics.visible_text import visible_text
from inercal.calibration import Calibration
from inercal.calibration.delays import uncorrected_delays
from inercal.calibration.files import OUTDATED, calibration_object
from inercal.export.cost import Cost, Loss, Samples
from inercal.export.model import UNMEASURED, ExportModel
from inercal.export.ranges import NAMES, Ranges
from inercal.export.target_definition import Rendering, Target
from inercal.physics.quantities import QUANTITIES

_WIDTH = 96
_ASCII = str.maketrans(
    {"µ": "u", "μ": "u", "²": "^2", "³": "^3", "°": "deg", "…": "...", "·": "*", "×": "x",
     "−": "-", "–": "-", "ω": "w", "Δ": "d", "±": "+-", "″": "arcsec", "√": "sqrt"}
)  # fmt: skip


def plain_text(text: str) -> str:
    """Return a text as one ASCII line that cannot end a comment.

    >>> plain_text("µg */ B²")
    'ug * / B^2'
    """
    shown = visible_text(" ".join(text.split()))
    plain = unicodedata.normalize("NFKD", shown.translate(_ASCII))
    plain = plain.encode("ascii", "ignore").decode().replace("\\", "/").replace("??", "? ?")
    return plain.replace("*/", "* /").replace("/*", "/ *")


def header_lines(
    model: ExportModel,
    target: Target,
    rendering: Rendering,
    samples: Samples,
    ranges: Ranges,
    costs: Sequence[Cost],
    losses: Sequence[Loss],
    *,
    with_bias: Sequence[Cost] = (),
    source: str = "",
    refitted: bool = False,
    left_out: str = "",
    undetermined: Sequence[str] = (),
    whole: Calibration | None = None,
) -> tuple[str, ...]:
    """Return the lines of explanation for a file.

    Parameters
    ----------
    model, target, rendering, samples, ranges
    costs, losses : sequences of Cost and of Loss
    with_bias : sequence of Cost
        Errors that include the bias, if the target estimates the bias itself.
    source : str
        Name of the calibration file; empty if there is none.
    refitted : bool
        Whether the linear terms were fitted over the range.
    left_out : str
        Which axes this file leaves out.
    undetermined : sequence of str
        Sentences on biases and scale factors that the calibration does not determine.
    whole : Calibration, optional
        The calibration with these axes, if it is not that of the model.
    """
    lines = [f"{target.meaning}, by inercal {version('inercal')}"]
    lines += _source_lines(whole or model.calibration, source)
    kinds = " and ".join(
        f"{QUANTITIES[k].name} in {QUANTITIES[k].ascii_unit}"
        for k, _ in model.triads
        if k in (target.holds if rendering.holds is None else rendering.holds)
    )
    lines.append(f"takes {rendering.reads}; gives {kinds}")
    lines.append(_frame_text(model))
    lines += [text] if (text := feed_text(model, rendering)) else []
    lines += [f"formula: {text}" for text in rendering.formula]
    if refitted:
        lines.append("the linear terms are a least-squares fit over the range below (refit)")
    lines += [f"NOT in this file: {left_out}"] if left_out else []
    lines += [f"NOT calibrated: {text}" for text in undetermined]
    lines += uncorrected_delays(model.calibration.conditions)
    lines += [_loss_text(one) for one in losses] or [
        "the target includes every coefficient of the calibration"
        + " of these axes" * bool(left_out)
    ]
    lines.append(_range_text(ranges, model))
    lines += [_cost_text("error of this file", one) for one in costs]
    if with_bias:
        lines += [_cost_text("the same after subtracting the biases below", c) for c in with_bias]
        lines += [
            f"bias of {QUANTITIES[kind].name} at {_celsius(model):.6g} degC, which the target "
            "does not read: "
            + ", ".join(f"{x:.9g}" for x in triad.bias)
            + f" {QUANTITIES[kind].ascii_unit}"
            for kind, triad in model.triads
        ]
    if model.calibration.states_uncertainty:
        kept = "the covariance is" if rendering.states_u else "uncertainties and covariance are"
        lines.append(f"{kept} only in the calibration file")
    else:
        lines.append("the calibration states no uncertainties")
    lines += rendering.remarks
    lines.append(_check_text(model, rendering, samples))
    wrapped = (textwrap.wrap(plain_text(line), _WIDTH, subsequent_indent="  ") for line in lines)
    return tuple(part for parts in wrapped for part in parts)


def _source_lines(calibration: Calibration, source: str) -> list[str]:
    sha256 = calibration_object(calibration)["sha256"]
    parts = [source or "not saved", f"sha256 {sha256}", f"sensor {calibration.sensor.name}"]
    if calibration.method:
        parts.append(f"method {calibration.method}")
    if created := calibration.provenance.get("created"):
        parts.append(f"of {created}")
    lines = [f"calibration: {', '.join(parts)}"]
    if reason := calibration.provenance.get(OUTDATED):
        lines.append(f"OUTDATED: {reason}")
    verdict = calibration.verdict
    if verdict is not None:
        mark = "NOT TO BE RELIED ON: " if verdict.grade == "unreliable" else "verdict: "
        lines.append(mark + (verdict.word if not verdict.reasons else "; ".join(verdict.reasons)))
    return lines


def _frame_text(model: ExportModel) -> str:
    text = f"frame: {model.calibration.frame} of the calibration"
    if np.array_equal(model.turn, np.eye(3)):
        same = "; channels in the order of the calibration"
        return f"{text}, x y z{same * (len(model.inputs) == len(model.channels))}"
    names = [
        ("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in model.turn
    ]
    return f"{text} with axes {' '.join(names)}; the channels are along these axes, in this order"


def feed_text(model: ExportModel, rendering: Rendering) -> str:
    """Say which components a sensor does not measure and what to pass instead; "" if none."""
    minus = ["-" * (sign < 0) for sign in model.joined("signs").tolist()]
    name = [m + c.removeprefix(UNMEASURED) for m, c in zip(minus, model.channels, strict=True)]
    missing = [k for k in range(len(name)) if k not in model.inputs]
    feed = f"only {', '.join(name[k] for k in model.inputs)}, in this order"
    if not rendering.measured_only:
        zero = (model.joined("offset") * rendering.takes_output).tolist()
        feed = ", ".join([*name, *(f"with {name[k]} = {zero[k]:.9g}" for k in missing)])
    what = ", ".join(name[k] for k in missing)
    return f"NOT measured and assumed to be zero: {what}; feed {feed}" if missing else ""


def _loss_text(one: Loss) -> str:
    shown = ", ".join(one.names[:6]) + (" ..." if len(one.names) > 6 else "")
    return f"NOT included: {one.word} ({shown}), {one.effect_text()}"


def _range_text(ranges: Ranges, model: ExportModel) -> str:
    kinds = {kind for kind, _ in model.triads}
    parts: list[str] = []
    for kind, name in NAMES.items():
        if kind in kinds:
            low, high = ranges.of(kind)
            word = " (assumed)" if name in ranges.assumed else ""
            parts.append(f"{low:.4g} to {high:.4g} {QUANTITIES[kind].ascii_unit} per axis{word}")
    if ranges.temperature is not None and model.sensor.uses("dT"):
        low, high = (t - ZERO_CELSIUS for t in ranges.temperature)
        parts.append(f"{low:.4g} to {high:.4g} degC")
    elif model.sensor.uses("dT"):
        parts.append(f"{_celsius(model):.4g} degC only, because no range of temperature is stated")
    return f"range: {'; '.join(parts)}"


def _cost_text(what: str, one: Cost) -> str:
    unit = QUANTITIES[one.measures].ascii_unit
    against = (
        f"; U (k = 2) of the calibration at that point: {one.expanded:.3g}"
        if one.expanded > 0
        else ""
    )
    if one.exceeds:
        against += "; the error exceeds U somewhere in the range"
    return (
        f"{what} in {QUANTITIES[one.measures].name} against the calibration: at most "
        f"{one.largest:.3g} {unit} per component, rms {one.rms:.3g}{against}"
    )


def _celsius(model: ExportModel) -> float:
    return model.sensor.reference_temperature - ZERO_CELSIUS


def _check_text(model: ExportModel, rendering: Rendering, samples: Samples) -> str:
    """Describe a reading and its correction by the target, as a check for the user."""
    readings, dT = samples.readings[-1:], samples.dT[-1:]
    corrected = rendering.correct(readings, dT)[0]
    at = f" at {_celsius(model) + float(dT[0]):.6g} degC" if model.sensor.uses("dT") else ""
    shown = model.outputs(readings)[0] if rendering.takes_output else readings[0]
    shown = shown[model.inputs] if rendering.measured_only else shown
    numbers = ", ".join(f"{x:.9g}" for x in shown)
    return f"check: readings ({numbers}){at} give ({', '.join(f'{x:.7g}' for x in corrected)})"
