"""Validate a DCC against its XML schema, which the laboratory supplies.

The schema imports other schemas by address. They are looked up by namespace in the folder of the
schema, and nothing is loaded from the network. The content of an XML signature is not validated
here, because `certificate verify` checks the signature itself.
"""

from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.laboratory.certificate.dcc_elements import etree

SIGNATURE_NAMESPACE = "http://www.w3.org/2000/09/xmldsig#"
_SIGNATURE_STUB = f"""<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"
 targetNamespace="{SIGNATURE_NAMESPACE}"><xs:element name="Signature"><xs:complexType><xs:sequence>
 <xs:any processContents="skip" minOccurs="0" maxOccurs="unbounded"/></xs:sequence>
 <xs:anyAttribute processContents="skip"/></xs:complexType></xs:element></xs:schema>"""
_IMPORT = "{http://www.w3.org/2001/XMLSchema}import"


def schema_defects(document: bytes, schema: Path) -> tuple[str, ...]:
    """Return a line for each violation of the schema; empty for a valid document.

    Parameters
    ----------
    document : bytes
        The DCC as XML.
    schema : Path
        The file dcc.xsd; the schemas that it imports must be in the same folder.

    Raises
    ------
    InputError
        If the schema cannot be read, or a schema that it imports is not in its folder.
    """
    validator = _read_schema(schema)
    root = etree.fromstring(document, _parser())
    if validator.validate(root):
        return ()
    return tuple(f"line {one.line}: {one.message}" for one in validator.error_log)


def _parser() -> Any:
    return etree.XMLParser(resolve_entities=False, no_network=True)


def _read_schema(path: Path) -> Any:
    root = _read_xml(path)
    imported: dict[str, str] = {}
    for file in sorted(path.parent.glob("*.xsd")):
        if file != path:
            imported.setdefault(_read_xml(file).get("targetNamespace"), file.resolve().as_uri())
    parser = _parser()
    parser.resolvers.add(_Resolver())
    for one in root.iter(_IMPORT):
        namespace = one.get("namespace")
        if namespace == SIGNATURE_NAMESPACE:
            one.set("schemaLocation", _Resolver.signature)
        elif namespace in imported:
            one.set("schemaLocation", imported[namespace])
        else:
            raise InputError(
                f"--schema {path} imports {namespace}, but the schema for it is not in "
                f"{path.parent}; put it there",
                file=path,
                key="--schema",
            )
    try:
        return etree.XMLSchema(
            etree.fromstring(etree.tostring(root), parser, base_url=path.resolve().as_uri())
        )
    except etree.XMLSchemaParseError as error:
        raise InputError(f"--schema {path}: {error}", file=path, key="--schema") from None


def _read_xml(path: Path) -> Any:
    try:
        return etree.fromstring(path.read_bytes(), _parser())
    except (OSError, etree.XMLSyntaxError) as error:
        raise InputError(
            f"--schema {path} cannot be read as a schema: {error}; give the file dcc.xsd",
            file=path,
            key="--schema",
        ) from None


class _Resolver(etree.Resolver):
    """A resolver that replaces the signature schema by a stub; libxml2 reads all other files."""

    signature = "inercal:signature"

    def resolve(self, system_url: str, public_id: str, context: Any) -> Any:
        """Return the stub schema for the address of XML signatures."""
        if system_url == self.signature:
            return self.resolve_string(_SIGNATURE_STUB, context)
        return None
