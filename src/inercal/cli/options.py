"""Declare the options that several verbs share, and check their values."""

import os
from collections.abc import Iterable
from math import inf
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inercal.basics.errors import InputError
from inercal.cli.console import report_line

if TYPE_CHECKING:
    from inercal.host.tasks import RunOptions

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Explain = Annotated[
    bool, typer.Option("--explain", help="Print everything behind the verdict, under headings.")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="Exit with status 3 also if the result has reservations.")
]
RegisterOption = Annotated[
    str | None,
    typer.Option(
        help="A path, sqlite:///PATH or postgresql://USER@HOST/DATABASE; default $INERCAL_REGISTER."
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(help="Number of processes (default: one per core); it does not affect results."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        "--cluster",
        help="Compute on a Dask cluster: tcp://HOST:PORT, tls://HOST:PORT or local (this machine).",
    ),
]


def flag(name: str, meaning: str) -> Any:
    """Return an option that is off unless its name is given."""
    return typer.Option(False, name, help=meaning)


def optional(meaning: str, *names: str, **settings: Any) -> Any:
    """Return an option that is None unless it is given; by default it is named as its parameter."""
    return typer.Option(None, *names, help=meaning, **settings)


def repeated(meaning: str, *names: str, **settings: Any) -> Any:
    """Return an option that can be given several times, and is an empty list by default."""
    return typer.Option([], *names, help=meaning, **settings)


def out_option(meaning: str) -> Any:
    """Return the option `--out` of a verb that has a default place for its output, or none."""
    return optional(meaning, "--out", "-o")


def assignments(
    texts: Iterable[str], option: str, form: str, *, sectioned: bool = False
) -> dict[str, str]:
    """Return the values given with an option such as `--set`, by name.

    Parameters
    ----------
    texts : iterable of str
        Texts of the form "NAME=VALUE".
    option : str
    form : str
        Description of the required form, for the error message.
    sectioned : bool
        Whether a name is a key with its section, such as "data.rate".

    Raises
    ------
    InputError
        A text has another form, or a name is stated twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not (name and value) or (sectioned and "." not in name):
            raise InputError(f"{option} {text!r}: write {form}", key=option, names=(name,))
        if name in found:
            raise InputError(
                f"{option} {name} is given twice: give it only once", key=option, names=(name,)
            )
        found[name] = value
    return found


def warn_of_root(scheduler: str | None) -> None:
    """Print a warning if the work is distributed to other processes while running as root.

    Parameters
    ----------
    scheduler : str or None
        Address of the scheduler as given by the user.
    """
    from inercal.basics.parallel import LOCAL

    root = hasattr(os, "geteuid") and os.geteuid() == 0
    if scheduler is None or not root:
        return
    what = (
        "the processes that read the recordings run as root"
        if scheduler == LOCAL
        else "anyone who can reach the scheduler can run code as root"
    )
    report_line(f"warning: inercal runs as root, so {what}; start it as another user")


def positive_number(option: str, given: float | str, otherwise: str = "") -> float:
    """Return the value of an option as a positive number.

    Parameters
    ----------
    option : str
        Name of the option, such as "--pace".
    given : float or str
    otherwise : str
        Other possible values, for the error message.

    Raises
    ------
    InputError
        The value is not a number above 0.
    """
    try:
        value = float(given)
    except ValueError:
        value = 0.0
    if not 0 < value < inf:
        raise InputError(f"{option} {given}: give a number above 0{otherwise}", key=option)
    return value


def run_options(speed: float | None, patience: float, temperature: str) -> "RunOptions":
    """Return the run options from `--speed`, `--patience` and `--temperature`.

    Raises
    ------
    InputError
        A value is not a number above 0, or the temperatures are not two numbers in ascending order.
    """
    from inercal.basics.units import ZERO_CELSIUS
    from inercal.host.tasks import RunOptions

    within: tuple[float, float] | None = None
    if temperature:
        low, _, high = temperature.partition(":")
        try:
            within = float(low) + ZERO_CELSIUS, float(high) + ZERO_CELSIUS
        except ValueError:
            within = (1.0, 0.0)
        if not within[0] < within[1]:
            raise InputError(
                f"--temperature {temperature!r}: give the lowest and highest °C, such as 15:40",
                key="--temperature",
            )
    for name, value in (("--speed", speed), ("--patience", patience)):
        if value is not None:
            positive_number(name, value)
    return RunOptions(speed, within, patience)
