"""Write the administrative data of a DCC: persons, items, dates and statements."""

from importlib.metadata import version
from typing import Any

from inercal.laboratory.certificate.content import Certificate
from inercal.laboratory.certificate.dcc_elements import content, dcc
from inercal.laboratory.certificate.facts import statement_facts

_DRAFT = "DRAFT"


def administrative_data(certificate: Certificate) -> Any:
    """Return the element with the administrative data, the first part of a DCC."""
    texts = certificate.texts
    software = dcc(
        "software", content("name", texts, "inercal"), dcc("release", version("inercal"))
    )
    definition = dcc(
        "refTypeDefinition",
        content("name", texts, "inercal"),
        content("description", texts, texts.text("equation_text")),
        dcc("namespace", "inercal"),
        dcc("link", "urn:inercal:certificate"),
        dcc("release", version("inercal")),
    )
    return dcc(
        "administrativeData",
        dcc("dccSoftware", software),
        dcc("refTypeDefinitions", definition),
        _core_data(certificate),
        _items(certificate),
        _laboratory(certificate),
        _persons(certificate),
        _customer(certificate),
        _statements(certificate),
    )


def _core_data(certificate: Certificate) -> Any:
    texts, job, change = certificate.texts, certificate.job, certificate.change
    order = None
    if job.number:
        order = dcc(
            "identifications",
            dcc(
                "identification",
                dcc("issuer", "calibrationLaboratory"),
                dcc("value", job.number),
                content("name", texts, texts.text("order")),
            ),
        )
    changed = previous = None
    if change.kind:
        changed = dcc(
            "reportAmendedSubstituted",
            dcc("typeOfChange", change.kind),
            dcc("replacedUniqueIdentifier", change.previous),
        )
        previous = dcc(
            "previousReport",
            content("referral", texts, texts.text("certificate")),
            dcc("referralID", change.previous),
            dcc("procedure", "SHA-256"),
            dcc("value", change.previous_sha256),
        )
    return dcc(
        "coreData",
        dcc("countryCodeISO3166_1", certificate.laboratory.country),
        dcc("usedLangCodeISO639_1", texts.language),
        dcc("mandatoryLangCodeISO639_1", texts.language),
        dcc("uniqueIdentifier", certificate.number or _DRAFT),
        order,
        dcc("receiptDate", job.received.isoformat()) if job.received else None,
        dcc("beginPerformanceDate", certificate.first_day.isoformat()),
        dcc("endPerformanceDate", certificate.last_day.isoformat()),
        dcc("performanceLocation", "other" if job.place else "laboratory"),
        dcc("issueDate", certificate.issued.isoformat()),
        changed,
        previous,
    )


def _items(certificate: Certificate) -> Any:
    texts, job = certificate.texts, certificate.job
    condition = f"{texts.text('condition')}: {job.condition}"
    item = dcc(
        "item",
        content("name", texts, job.item or texts.text("default_item")),
        content("description", texts, certificate.calibration.sensor.name, condition),
        dcc("manufacturer", content("name", texts, job.maker)) if job.maker else None,
        dcc("model", job.model) if job.model else None,
        dcc(
            "identifications",
            dcc(
                "identification",
                dcc("issuer", "manufacturer"),
                dcc("value", job.serial_number),
                content("name", texts, texts.text("serial_number")),
            ),
        ),
    )
    return dcc("items", item)


def _laboratory(certificate: Certificate) -> Any:
    laboratory = certificate.laboratory
    code = laboratory.accreditation
    return dcc(
        "calibrationLaboratory",
        dcc("calibrationLaboratoryCode", code) if code else None,
        _contact(
            certificate, "contact", laboratory.laboratory, laboratory.email, laboratory.address
        ),
    )


def _customer(certificate: Certificate) -> Any:
    job = certificate.job
    return _contact(certificate, "customer", job.customer, job.customer_email, job.customer_address)


def _contact(
    certificate: Certificate, element: str, name: str | None, email: str | None, address: str | None
) -> Any:
    texts = certificate.texts
    return dcc(
        element,
        content("name", texts, name or ""),
        dcc("eMail", email) if email else None,
        dcc("location", content("further", texts, address or "")),
    )


def _persons(certificate: Certificate) -> Any:
    texts, laboratory = certificate.texts, certificate.laboratory
    approver = dcc(
        "respPerson",
        dcc("person", content("name", texts, laboratory.approved_by or "")),
        dcc("role", laboratory.approver_role or texts.text("approved_by")),
        dcc("mainSigner", "true"),
    )
    others = [(one.name, one.role) for one in laboratory.person]
    if certificate.job.operator:
        others.append((certificate.job.operator, texts.text("operator")))
    persons = [
        dcc(
            "respPerson",
            dcc("person", content("name", texts, name)),
            dcc("role", role) if role else None,
            dcc("mainSigner", "false"),
        )
        for name, role in others
    ]
    return dcc("respPersons", approver, *persons)


def _statements(certificate: Certificate) -> Any:
    texts = certificate.texts
    marks = [(texts.word("mark", mark), (texts.word("mark", mark),)) for mark in certificate.marks]
    statements = [
        dcc("statement", content("name", texts, name), content("declaration", texts, *lines))
        for name, lines in (*marks, *statement_facts(certificate))
    ]
    return dcc("statements", *statements)
