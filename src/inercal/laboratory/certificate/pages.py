"""Convert a certificate to the JSON sections that the layout `certificate.typ` prints."""

import re
from typing import Any, cast

from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_value_and_uncertainty
from inercal.basics.visible_text import visible_text
from inercal.calibration.specification import limit_text, probability_text
from inercal.laboratory.certificate import facts
from inercal.laboratory.certificate.content import Certificate
from inercal.laboratory.certificate.results import ResultSet

_LONG_WORD = re.compile(r"\S{64}(?=\S)")  # a longer word would run over the margin
_REGIONS = {"zh": "cn"}


def page_data(
    certificate: Certificate, fonts: list[str], *, bookmarked: bool, signed: bool
) -> dict[str, Any]:
    """Return the data that the layout prints.

    Parameters
    ----------
    certificate : Certificate
    fonts : list of str
        Font families; each character is printed in the first family that contains it.
    bookmarked : bool
        Whether the outline of the document lists the headings.
    signed : bool
        Whether the file will be signed electronically. If not, the page has a line for a
        handwritten signature.
    """
    texts, issued = certificate.texts, certificate.issued
    before, between, after = re.split(
        r"\{\w+\}", texts.text("page", n="{n}", total="{total}"), maxsplit=2
    )
    number = certificate.number or texts.text("draft_number")
    stem = certificate.number or "draft"
    data: dict[str, Any] = {
        "lang": texts.language,
        "region": _REGIONS.get(texts.language),
        "fonts": fonts,
        "bookmarked": bookmarked,
        "title": texts.text("title"),
        "number_label": texts.text("number"),
        "number": number,
        "laboratory": certificate.laboratory.laboratory,
        "date": [issued.year, issued.month, issued.day],
        "page": [before, between, after],
        "end": texts.text("end"),
        "marks": [texts.word("mark", mark) for mark in certificate.marks],
        "files": [f"{stem}.xml", f"{stem}.calibration.json"],
        "sections": [part for part in _sections(certificate, signed) if part["blocks"]],
    }
    return _printable(data)


def _sections(certificate: Certificate, signed: bool) -> list[dict[str, Any]]:
    t = certificate.texts
    parts = [
        _section(t.text("change"), _lines(facts.change_lines(certificate))),
        _section(t.text("laboratory"), _facts(_laboratory(certificate))),
        _section(t.text("customer"), _facts(_customer(certificate))),
        _section(t.text("item"), _facts(_item(certificate))),
        _section(t.text("dates"), _facts(_dates(certificate))),
        _section(t.text("method"), _facts(facts.method_facts(certificate))),
    ]
    if len(certificate.results) == 1:
        parts.append(_conditions(certificate, certificate.results[0]))
    for one in certificate.results:
        blocks = [_result_table(certificate, one)]
        if one.status:
            blocks += _conditions(certificate, one)["blocks"]
        parts.append({"title": facts.results_title(t, one), "blocks": blocks})
    parts += [
        _section(t.text("uncertainty"), _lines(facts.uncertainty_lines(certificate))),
        _section(
            t.text("conformity"), _limit_table(certificate), _lines(facts.rule_lines(certificate))
        ),
        _section(
            t.text("traceability"),
            _lines((certificate.laboratory.traceability or "",)),
            _instruments(certificate),
        ),
        _section(t.text("remarks"), _facts(_remarks(certificate)), _lines(facts.general_lines(t))),
        _section(
            t.text("authorization"), _facts(_persons(certificate)), _signature(certificate, signed)
        ),
    ]
    return parts


def _section(title: str, *blocks: dict[str, Any] | None) -> dict[str, Any]:
    return {"title": title, "blocks": [block for block in blocks if block is not None]}


def _facts(rows: list[tuple[str, str | None]] | list[tuple[str, str]]) -> dict[str, Any] | None:
    known = [[name, text] for name, text in rows if text]
    return {"kind": "facts", "rows": known} if known else None


def _lines(lines: tuple[str, ...]) -> dict[str, Any] | None:
    known = [line for line in lines if line]
    return {"kind": "lines", "lines": known} if known else None


def _laboratory(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, laboratory = certificate.texts, certificate.laboratory
    return [
        (t.text("name"), laboratory.laboratory),
        (t.text("address"), f"{laboratory.address}, {laboratory.country}"),
        (t.text("email"), laboratory.email),
        (t.text("accreditation"), laboratory.accreditation),
        (t.text("place"), certificate.job.place or t.text("place_laboratory")),
    ]


def _customer(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, job = certificate.texts, certificate.job
    return [
        (t.text("name"), job.customer),
        (t.text("address"), job.customer_address),
        (t.text("email"), job.customer_email),
        (t.text("order"), job.number),
    ]


def _item(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, job, sensor = certificate.texts, certificate.job, certificate.calibration.sensor
    axes = ", ".join(f"{axis.name} ({axis.readout.unit})" for axis in sensor.axes)
    return [
        (t.text("description"), job.item or t.text("default_item")),
        (t.text("sensor"), sensor.name),
        (t.text("maker"), job.maker),
        (t.text("model"), job.model),
        (t.text("serial_number"), job.serial_number),
        (t.text("axes"), axes),
        (t.text("condition"), job.condition),
    ]


def _dates(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, job = certificate.texts, certificate.job
    first, last = certificate.first_day.isoformat(), certificate.last_day.isoformat()
    measured = first if first == last else t.text("until", first=first, last=last)
    return [
        (t.text("received"), job.received and job.received.isoformat()),
        (t.text("measured"), measured),
        (t.text("issued"), certificate.issued.isoformat()),
    ]


def _conditions(certificate: Certificate, results: ResultSet) -> dict[str, Any]:
    rows = facts.condition_facts(certificate, results.calibration)
    return _section(certificate.texts.text("conditions"), _facts(rows))


def _result_table(certificate: Certificate, results: ResultSet) -> dict[str, Any]:
    t = certificate.texts
    rows = [
        [
            row.name,
            t.word("meaning", row.meaning),
            row.term,
            row.value.replace("-", "−"),
            row.expanded,
            f"{results.k:.2f}",
            row.unit,
        ]
        for row in results.rows
    ]
    keys = ("coefficient", "meaning", "term", "value", "expanded")
    head = [*(t.text(key) for key in keys), "k", t.text("unit")]
    return _table(head, "lllrrrl", rows)


def _limit_table(certificate: Certificate) -> dict[str, Any] | None:
    conformity, t = certificate.conformity, certificate.texts
    if conformity is None:
        return None
    shown = {row.name: row for row in certificate.results[-1].rows}
    rows: list[list[str]] = []
    for one in conformity.limits:
        row = shown[one.name]
        term = certificate.calibration.sensor.coefficient(one.name)
        rows.append(
            [
                one.name,
                f"{row.value} ± {row.expanded}".replace("-", "−"),
                limit_text(one.lower, one.upper, term).replace("-", "−"),
                format_value_and_uncertainty(0.0, one.guard / term.si)[1],
                probability_text(one.probability),
                t.word("result", one.result),
            ]
        )
    keys = ("coefficient", "value", "limit", "guard", "probability", "result")
    return _table([t.text(key) for key in keys], "lrlrrl", rows)


def _table(head: list[str], align: str, rows: list[list[str]]) -> dict[str, Any]:
    axes = [CoefficientName(row[0]).axis for row in rows]
    groups = [k for k, axis in enumerate(axes) if k and axis != axes[k - 1]]
    return {"kind": "table", "head": head, "align": list(align), "rows": rows, "groups": groups}


def _instruments(certificate: Certificate) -> dict[str, Any] | None:
    t = certificate.texts
    rows: list[list[str]] = []
    for one in certificate.laboratory.instrument:
        due = one.due.isoformat() if one.due else "–"
        if one.is_overdue(certificate.last_day):
            due = t.text("overdue", date=due)
        known = (one.name, one.serial_number, one.certificate, one.calibrated_by, due)
        rows.append([text or "–" for text in known])
    if not rows:
        return None
    keys = ("instruments", "serial_number", "certificate", "calibrated_by", "due")
    head = [t.text(key) for key in keys]
    return {"kind": "table", "head": head, "align": list("lllll"), "rows": rows, "groups": []}


def _remarks(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, job = certificate.texts, certificate.job
    return [
        (t.text("deviations"), job.deviations or t.text("none")),
        *((t.text("verdict") if k == 0 else "", line)
          for k, line in enumerate(facts.verdict_lines(certificate))),
        (t.text("external"), job.external),
        (t.text("opinions"), job.opinions),
        (t.text("notes"), job.notes),
        *(("", line) for line in certificate.laboratory.statements),
    ]  # fmt: skip


def _persons(certificate: Certificate) -> list[tuple[str, str | None]]:
    t, laboratory = certificate.texts, certificate.laboratory
    return [
        (t.text("operator"), certificate.job.operator),
        *((one.role or t.text("persons"), one.name) for one in laboratory.person),
        (t.text("approved_by"), _approver(certificate)),
    ]


def _approver(certificate: Certificate) -> str:
    laboratory = certificate.laboratory
    return ", ".join(filter(None, (laboratory.approved_by, laboratory.approver_role)))


def _signature(certificate: Certificate, signed: bool) -> dict[str, Any]:
    return {
        "kind": "signature",
        "note": certificate.texts.text("signed_electronically") if signed else "",
        "signer": f"{certificate.issued}, {_approver(certificate)}",
    }


def _printable(data: Any) -> Any:
    """Make the texts in the data printable: no control characters, and breaks in long words."""
    if isinstance(data, str):
        return _LONG_WORD.sub(lambda word: word[0] + "\u200b", visible_text(data, keep="\n"))
    if isinstance(data, dict):
        named = cast(dict[str, Any], data)
        return {key: _printable(value) for key, value in named.items()}
    if isinstance(data, list):
        return [_printable(value) for value in cast(list[Any], data)]
    return data
