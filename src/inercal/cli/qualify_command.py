"""`inercal qualify`: parameters of a bench from a measurement of their own."""

from pathlib import Path

import typer

from inercal.cli.console import print_json

NAME = "qualify"
_NOT_TO_BE_RELIED_ON = 3  # the exit status


def run(
    files: list[Path] = typer.Argument(
        help="Input file with \\[qualification] and \\[measurement]; with --drift the earlier and "
        "the later qualification.",
        metavar="FILE…",
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="The qualification to write, *.qualification.json."
    ),
    force: bool = typer.Option(False, "--force", help="Write over an existing file."),
    drift: bool = typer.Option(
        False, "--drift", help="Compare two successive qualifications of one bench."
    ),
    withdraw: str | None = typer.Option(
        None,
        "--withdraw",
        metavar="REASON",
        help="Withdraw a qualification: the file says so, and what used it is listed.",
    ),
    register: str | None = typer.Option(
        None,
        "--register",
        help="A path, sqlite:///PATH or postgresql://USER@HOST/DATABASE; else $INERCAL_REGISTER.",
    ),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of tables."),
) -> None:
    r"""Qualify a bench: find its parameters with their covariance, for \[bench] qualification."""
    from inercal.basics.errors import InputError

    if drift and withdraw is not None:
        raise InputError("--drift and --withdraw are two tasks: give one of them", key="--drift")
    wanted = 2 if drift else 1
    if len(files) != wanted:
        raise InputError(f"{len(files)} files are given; give {wanted}")
    if register is not None and withdraw is None:
        raise InputError("--register is of --withdraw; remove it", key="--register")
    if out is not None and (drift or withdraw is not None):
        raise InputError("--out is of a measurement; remove it", key="--out")
    if drift:
        _drift(files, json)
    elif withdraw is not None:
        _withdraw(files[0], withdraw, register, json)
    else:
        _qualify(files[0], out, force, json)


def _qualify(file: Path, out: Path | None, force: bool, json: bool) -> None:
    from inercal.benches.qualification.input_file import input_files, qualify
    from inercal.benches.qualification.qualification_file import qualification_object, save
    from inercal.cli.outputs import QUALIFICATION, check_outputs

    if out is not None:
        check_outputs({out: QUALIFICATION}, input_files(file), force=force)
    found = qualify(file)
    if out is not None:
        save(found, out)
    if json:
        print_json(qualification_object(found))
    else:
        from inercal.cli.qualify_view import print_qualification

        print_qualification(found)
        if out is not None:
            print(f"wrote {out}")
    if not found.consistent:
        raise typer.Exit(_NOT_TO_BE_RELIED_ON)


def _drift(files: list[Path], json: bool) -> None:
    from inercal.benches.qualification.qualification_file import load
    from inercal.benches.qualification.succession import drift_between

    earlier, later = map(load, files)
    found = drift_between(earlier, later)
    if json:
        print_json({"drift": [one._asdict() for one in found]})
        return
    from inercal.cli.qualify_view import print_drift

    print_drift(earlier, later, found)


def _withdraw(file: Path, reason: str, address: str | None, json: bool) -> None:
    from dataclasses import replace
    from datetime import UTC, datetime

    from inercal.basics.errors import InputError
    from inercal.benches.qualification.qualification_file import load, save
    from inercal.laboratory.store import Register
    from inercal.laboratory.store.qualification_uses import qualification_uses

    found = load(file)
    if not reason.strip() and not found.withdrawn:
        raise InputError("--withdraw: the reason is empty; state it", key="--withdraw")
    with Register(address, create=False) as opened:
        uses = qualification_uses(opened, found.determination)
        place = opened.address
    if not found.withdrawn:
        day = datetime.now(UTC).date()
        found = replace(found, withdrawn=f"{day}: {' '.join(reason.split())}")
        save(found, file)
    if json:
        print_json(
            {
                "determination": found.determination,
                "withdrawn": found.withdrawn,
                "register": place,
                "uses": [one._asdict() for one in uses],
            }
        )
        return
    from inercal.cli.qualify_view import print_uses

    print_uses(found, place, uses)
