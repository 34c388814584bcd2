"""Write the statements of a certificate as pairs of name and text, for both PDF and DCC."""

from itertools import chain

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.calibration import Calibration
from inercal.calibration.explanation import UNCERTAINTIES, customer_lines, customer_sections
from inercal.calibration.specification import probability_text
from inercal.estimation.uncertainty import COVERAGE_PROBABILITY
from inercal.laboratory.certificate.content import Certificate, Texts
from inercal.laboratory.certificate.results import ResultSet, acceptance_risk, names_of
from inercal.physics.sensors.coefficient_tables import G0

_ALONG = 1e-6  # tolerance for a unit vector that points along an axis

Fact = tuple[str, str]
Statement = tuple[str, tuple[str, ...]]


def method_facts(certificate: Certificate) -> list[Fact]:
    """Return the facts about how the calibration was made."""
    texts, calibration = certificate.texts, certificate.calibration
    provenance = calibration.provenance
    way = ", ".join(text for text in (calibration.method, calibration.estimator) if text)
    facts = [
        (texts.text("procedure"), certificate.job.procedure or certificate.laboratory.procedure),
        (texts.text("estimator"), way),
        (texts.text("frame"), texts.word("frame", calibration.frame)),
        (texts.text("equation"), texts.text("equation_text")),
        (texts.text("input_axes"), _input_axes(calibration)),
        (texts.text("software"), f"inercal {provenance.get('inercal', '')}".strip()),
        (texts.text("recording"), _file_and_hash(calibration, "recording")),
        (texts.text("run_file"), _file_and_hash(calibration, "run file")),
        (texts.text("calibration_file"), certificate.calibration_sha256),
    ]
    return [(name, text) for name, text in facts if text]


def _input_axes(calibration: Calibration) -> str:
    """Return the directions of I, P and O of each axis as text, such as "ax +x, +y, +z"."""
    return "; ".join(
        f"{axis.name} {', '.join(_direction(vector) for vector in axis.frame)}"
        for axis in calibration.sensor.axes
    )


def _direction(vector: Array) -> str:
    """Return the frame axis to which a unit vector points, or its components as text."""
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) > 1 - _ALONG:
        return ("−" if vector[k] < 0 else "+") + "xyz"[k]
    return "(" + " ".join(f"{part:.4f}".replace("-", "−") for part in vector) + ")"


def _file_and_hash(calibration: Calibration, what: str) -> str:
    names = (what, f"{what} sha256")
    return " ".join(filter(None, (calibration.provenance.get(name) for name in names)))


def results_title(texts: Texts, results: ResultSet) -> str:
    """Return the title of the results; if there are two, it says before or after adjustment."""
    keys = {"beforeAdjustment": "results_before", "afterAdjustment": "results_after"}
    return texts.text(keys.get(results.status, "results"))


def condition_facts(certificate: Certificate, calibration: Calibration) -> list[Fact]:
    """Return the conditions that influence the result."""
    texts, job = certificate.texts, certificate.job
    facts = [
        (texts.text("ambient_temperature"), job.ambient_temperature),
        (texts.text("ambient_humidity"), job.ambient_humidity),
        (texts.text("ambient_pressure"), job.ambient_pressure),
        *(
            (texts.word("condition", name), _with_coverage(name, text))
            for name, text in calibration.conditions.items()
        ),
        *_ranges(texts, calibration),
    ]
    return [(name, text) for name, text in facts if text]


def _with_coverage(name: str, text: str) -> str:
    """Add "(k = 1)" to a condition with ±, because it states a standard uncertainty."""
    return f"{text} (k = 1)" if " ± " in text and "k = " not in name + text else text


def _ranges(texts: Texts, calibration: Calibration) -> list[Fact]:
    if calibration.validity is None:
        return []
    units = {"force": ("g", G0, 0.0), "rate": ("°/s", si_factor("°/s"), 0.0)}
    units |= {"temperature": ("°C", 1.0, ZERO_CELSIUS), "field": ("µT", 1e-6, 0.0)}
    found: list[Fact] = []
    for name, ends in calibration.validity.ranges.items():
        unit, size, zero = units[name]
        low, high = (f"{(end - zero) / size:.4g}".replace("-", "−") for end in ends)
        found.append(
            (texts.text(f"range_{name}"), texts.text("range", low=low, high=high, unit=unit))
        )
    return found


def uncertainty_lines(certificate: Certificate) -> tuple[str, ...]:
    """Return the sentences that explain U."""
    texts, results = certificate.texts, certificate.results[-1]
    fields = {"k": f"{results.k:.2f}", "probability": f"{100 * COVERAGE_PROBABILITY:.2f} %"}
    if certificate.job.degrees_of_freedom is None:
        first = texts.text("uncertainty_normal", **fields)
    else:
        first = texts.text("uncertainty_student", dof=f"{results.dof:.3g}", **fields)
    raised = [name for one in certificate.results for name in names_of(one.rows, raised=True)]
    lines = [first, texts.text("uncertainty_covariance")]
    if raised:
        lines.append(texts.text("raised", names=", ".join(dict.fromkeys(raised))))
    return tuple(lines)


def rule_lines(certificate: Certificate) -> tuple[str, ...]:
    """Return the decision rule with its risk and the overall result; empty without limits."""
    conformity, texts = certificate.conformity, certificate.texts
    if conformity is None:
        return ()
    risk = f"{100 * acceptance_risk(conformity, certificate.results[-1].dof):.2g} %"
    rule = conformity.rule
    which = texts.text(f"rule_{conformity.uncertainty}")
    if rule.name == "guarded":
        first = texts.text("rule_guarded", factor=f"{rule.factor:g}", which=which, risk=risk)
    else:
        first = texts.text("rule_simple", which=which, risk=risk)
    return (
        first,
        texts.text(
            "conformity_all",
            result=texts.word("result", conformity.result),
            probability=probability_text(conformity.probability),
        ),
        texts.text("conformity_scope"),
    )


def verdict_lines(certificate: Certificate) -> tuple[str, ...]:
    """Return the result of the statistical tests: the grade with its reasons, then the notes."""
    texts, calibration = certificate.texts, certificate.calibration
    verdict = calibration.verdict
    grade = texts.text(f"grade_{'none' if verdict is None else verdict.grade}")
    if verdict is None:
        return (grade, *customer_lines(calibration.notes))
    # The U on the certificate may be larger, because the laboratory's capability is a lower limit.
    sections = customer_sections(verdict.explanation)
    found = [lines for heading, lines in sections if heading != UNCERTAINTIES]
    return ("; ".join((grade, *customer_lines(verdict.reasons))), *chain.from_iterable(found))


def change_lines(certificate: Certificate) -> tuple[str, ...]:
    """Say which certificate this certificate changes, and why; empty if it changes none."""
    change, texts = certificate.change, certificate.texts
    if not change.kind:
        return ()
    return (
        texts.text(change.kind, number=change.previous),
        f"{texts.text('reason')}: {change.reason}",
    )


def statement_facts(certificate: Certificate) -> list[Statement]:
    """Return all statements of a certificate with their names."""
    texts, job, laboratory = certificate.texts, certificate.job, certificate.laboratory
    statements: list[Statement] = [
        (texts.text("change"), change_lines(certificate)),
        (texts.text("uncertainty"), uncertainty_lines(certificate)),
        (texts.text("conformity"), rule_lines(certificate)),
        (texts.text("traceability"), (laboratory.traceability or "",)),
        (texts.text("place"), (job.place or texts.text("place_laboratory"),)),
        (texts.text("deviations"), (job.deviations or texts.text("none"),)),
        (texts.text("verdict"), verdict_lines(certificate)),
        (texts.text("external"), (job.external or "",)),
        (texts.text("opinions"), (job.opinions or "",)),
        (texts.text("notes"), (*((job.notes,) if job.notes else ()), *laboratory.statements)),
        (texts.text("remarks"), general_lines(texts)),
    ]
    return [(name, lines) for name, lines in statements if any(lines)]


def general_lines(texts: Texts) -> tuple[str, ...]:
    """Return the statements that every certificate contains."""
    keys = ("only_items", "no_copy", "from_customer", "attached")
    return tuple(texts.text(key) for key in keys)
