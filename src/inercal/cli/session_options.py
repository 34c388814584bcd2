"""Options of verbs that read repeated sessions of a sensor: from files, a table or a register."""

import typer

TABLE = typer.Option(
    None,
    "--table",
    "-t",
    help="CSV of sessions with columns file, day, mount, turn_on; instead of files.",
)
SENSOR = typer.Option(None, "--sensor", help="A sensor of the register; instead of files.")
REGISTER = typer.Option(
    None,
    "--register",
    help="A path, sqlite:///PATH or postgresql://USER@HOST/DATABASE; else $INERCAL_REGISTER.",
)
SAME = typer.Option(
    None,
    "--same",
    help="What all files have in common; otherwise each is of another day, mounting and turn-on.",
)
