"""``urbantwin actors``: the catalogue of actors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite

__all__ = ["EXAMPLES", "actors"]

EXAMPLES = """
urbantwin actors
urbantwin actors van --country DE
urbantwin actors --save actors.png
urbantwin actors --json | jq '.fleet.car'
"""


def actors(
    name: Annotated[
        str | None, typer.Argument(metavar="[CLASS]", help="A class of actors; all if not given.")
    ] = None,
    country: Annotated[
        str, typer.Option(metavar="XX", help="Whose fleet the sizes are of, such as DE or US.")
    ] = "",
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A picture of the bodies, .png.")
    ] = None,
    overwrite: Overwrite = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print names only.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the bodies of actors, and how large a country's are."""
    known = ut.actors(
        name, country=country, save=save, overwrite=overwrite, progress=not (quiet or as_json)
    )
    if as_json:
        Console(as_json=True).result(known.summary())
    else:
        print("\n".join(known.names) if quiet else known)
