"""`inercal certificate`: issue, verify, copy and list calibration certificates."""

import os
import sys
from datetime import date, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from inercal.basics.atomic_files import atomic_write_all
from inercal.basics.errors import InercalError, InputError, require_installed
from inercal.cli import console, outputs
from inercal.cli.options import Force, Json, RegisterOption, flag, optional

if TYPE_CHECKING:
    from inercal.laboratory.store import CertificateFiles

PASSPHRASE = "INERCAL_SIGNING_PASSPHRASE"
_ISSUE = "issue"


class _Commands(TyperGroup):
    """Group of verbs in which `issue` is the default: `inercal certificate FILE`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] != "--help":
            args = [_ISSUE, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_Commands,
    help="Issue a calibration certificate (PDF/A-3 and DCC) from a calibration file: "
    "inercal certificate FILE --lab lab.toml. Verify one, or copy one from the register.",
    no_args_is_help=True,
)

_Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the files.")]
_Schema = Annotated[
    Path | None, typer.Option("--schema", help="The schema file dcc.xsd, to validate the DCC.")
]


@app.command(_ISSUE)
def issue(
    file: Path = typer.Argument(help="A calibration file."),
    lab: Path = typer.Option(help="The laboratory file (TOML)."),
    job: Path | None = optional("A TOML file whose \\[job] adds keys to the run's \\[job]."),
    as_found: Path | None = optional("The calibration file from before the adjustment."),
    language: Literal["en", "de", "zh"] = typer.Option("en", help="Language: en, de or zh."),
    issued: str | None = optional("Date of issue, such as 2026-11-26; by default today.", "--date"),
    amends: str | None = optional("Number of the certificate that this one amends."),
    replaces: str | None = optional("Number of the certificate that it replaces."),
    reason: str | None = optional("Reason for changing an earlier certificate."),
    font: Path | None = optional("A font file, for characters that are not in the built-in fonts."),
    sign: Path | None = optional(f"PKCS#12 file of the key; set ${PASSPHRASE} to its passphrase."),
    schema: _Schema = None,
    draft: bool = flag("--draft", "Write a draft without a number; it is not registered."),
    out: _Out = Path(),
    force: Force = False,
    by: str | None = optional(
        "Name of the person who issues the certificate; by default your user name."
    ),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Issue a certificate as PDF/A-3 and DCC (XML), with a number from the register."""
    from inercal.laboratory.certificate.dcc_elements import CERTIFICATE
    from inercal.runfile.job import read_laboratory

    require_installed(*CERTIFICATE)
    laboratory = read_laboratory(lab)
    day = _read_date(issued)
    # The modules of the work load after the inputs were checked.
    from inercal.calibration.files import load
    from inercal.laboratory.certificate import content as certificate
    from inercal.laboratory.certificate.issue import IssueOptions, make_files, read_signing_key
    from inercal.laboratory.certificate.issue import issue as issue_certificate
    from inercal.laboratory.certificate.job import read_job

    if amends and replaces:
        raise _option_error("--replaces", "give --amends or --replaces, not both")
    if bool(amends or replaces) != bool(reason):
        raise _option_error(
            "--reason", "--reason must be given together with --amends or --replaces"
        )
    earlier: list[str] = []
    key = None if sign is None else read_signing_key(sign, _passphrase(sign))
    change = "amended" if amends else "substituted" if replaces else ""
    options = IssueOptions(font, schema, key, change, amends or replaces or "", reason or "")
    calibration = load(file)
    given = certificate.CertificateInput(
        calibration,
        None if as_found is None else load(as_found),
        laboratory,
        read_job(calibration.job, job),
        language,
        day,
        draft,
    )
    if draft:
        if options.change:
            raise _option_error("--draft", "a draft cannot change a certificate; remove --draft")
        files, number, address = make_files(given, "", options), "", None
        written = _write(files, out, f"{file.name.partition('.')[0]}.draft", force)
    else:
        # A folder that cannot be written is refused before a number is used.
        outputs.check_outputs({out / "certificate.pdf": outputs.CERTIFICATE}, force=True)
        with console.open_register(register, by, create=not options.change) as opened:
            entry = issue_certificate(file, given, options, opened)
            address = opened.address
            if not options.change:
                earlier = [
                    one.number
                    for one in opened.certificates()
                    if one.calibration == entry.calibration and one.number != entry.number
                ]
        number = entry.number
        written = _write(entry.files, out, number, force, number)
    if earlier:
        console.report_line(
            f"warning: this calibration already has the certificate {', '.join(earlier)}, to which "
            f"{number} does not refer; if {number} should not stand beside it, issue a "
            f"certificate with --replaces {number} and --reason"
        )
    marks = certificate.make_certificate(given, number, certificate.CertificateChange()).marks
    for mark, why in marks.items():
        if why:
            word = certificate.Texts("en").word("mark", mark)
            console.report_line(f"the pages are marked {word}: {why}")
    if json:
        content = {"number": number, "register": address, "marks": marks, **written}
        console.print_json(content | ({"other_certificates": earlier} if earlier else {}))
        return
    console.print_written_files(written.values())


@app.command()
def verify(
    file: Path = typer.Argument(help="A certificate: the PDF or the DCC."),
    trust: Path | None = optional("PEM file with the certificates to trust."),
    schema: _Schema = None,
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Check the signatures, the numbers, the schema and the entry in the register.

    The exit status is 0 if no check fails and the file is confirmed by a trusted signature
    (--trust) or by the register (--register); otherwise it is 3.
    """
    from inercal.laboratory.certificate.dcc_elements import CERTIFICATE, SIGNATURE

    require_installed(*CERTIFICATE)
    require_installed(*SIGNATURE)
    from inercal.laboratory.certificate.verify import verify as verify_certificate

    if register is None:
        found = verify_certificate(file, trust=trust, schema=schema)
    else:
        with console.open_register(register, create=False) as opened:
            found = verify_certificate(file, trust=trust, schema=schema, register=opened)
    if json:
        console.print_json(
            {
                "number": found.number,
                "authentic": found.authentic,
                "checks": [vars(one) for one in found.checks],
            }
        )
    else:
        words = {True: "passed", False: "FAILED", None: "not made"}
        print(f"certificate {found.number}")
        for one in found.checks:
            print(f"{one.name}: {words[one.passed]}: {one.text}")
        if not found.authentic:
            print("the certificate is not verified", file=sys.stderr)
    console.exit_if(not found.authentic)


@app.command("copy")
def copy_(
    number: str = typer.Argument(help="Number of a certificate."),
    out: _Out = Path(),
    force: Force = False,
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Write the files of an issued certificate again from the register."""
    with console.open_register(register, create=False) as opened:
        entry = opened.certificate(number)
    written = _write(entry.files, out, entry.number, force)
    if json:
        console.print_json({"number": entry.number, **written})
        return
    console.print_written_files(written.values())


@app.command("list")
def list_(register: RegisterOption = None, json: Json = False) -> None:
    """List the certificates in the register."""
    with console.open_register(register, create=False) as opened:
        address, found = opened.address, opened.certificates()
    if json:
        console.print_json({"register": address, "certificates": [one._asdict() for one in found]})
        return
    words = {"": "", "amended": "amends ", "substituted": "replaces "}
    console.print_table(
        ("number", "issued", "sensor", "calibration", "changes", "issued by"),
        [
            (one.number, one.issued, one.sensor, f"#{one.calibration}",
             words[one.change] + one.previous, one.by)
            for one in found
        ],
    )  # fmt: skip


def _passphrase(path: Path) -> str:
    from inercal.laboratory.certificate.dcc_elements import SIGNATURE

    require_installed(*SIGNATURE)
    known = os.environ.get(PASSPHRASE)
    if known is not None:
        return known
    if not sys.stdin.isatty():
        raise _option_error("--sign", f"set ${PASSPHRASE} to the passphrase of {path}")
    return str(typer.prompt(f"passphrase of {path}", hide_input=True, err=True))


def _read_date(text: str | None) -> date:
    if text is None:
        return date.today()
    try:
        found = date.fromisoformat(text)
    except ValueError:
        raise _option_error("--date", f"{text!r} is not a date such as 2026-11-26") from None
    if found > date.today() + timedelta(days=1):  # somewhere else it may be tomorrow
        raise _option_error("--date", f"{text} is in the future")
    return found


def _option_error(key: str, message: str) -> Exception:

    return InputError(f"{key}: {message}" if key not in message else message, key=key)


def _write(
    files: "CertificateFiles", out: Path, stem: str, force: bool, number: str = ""
) -> dict[str, str]:
    """Write both files; on failure, tell how to get the files of the issued certificate."""
    paths = [out / f"{stem}.pdf", out / f"{stem}.xml"]
    try:
        outputs.check_outputs(dict.fromkeys(paths, outputs.CERTIFICATE), force=force)
        with atomic_write_all(paths) as parts:
            parts[0].write_bytes(files.pdf)
            parts[1].write_bytes(files.dcc)
    except InercalError as error:
        if number:
            raise error.located(
                f"certificate {number} was issued; get its files with `inercal certificate copy "
                f"{number}`"
            ) from None
        raise
    return {"pdf": str(paths[0]), "dcc": str(paths[1])}
