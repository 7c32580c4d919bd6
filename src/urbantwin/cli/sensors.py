"""``urbantwin sensors``: the catalogue, or one sensor of it."""

from __future__ import annotations

from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson

__all__ = ["EXAMPLES", "sensors"]

EXAMPLES = """
urbantwin sensors
urbantwin sensors show OS1-128
urbantwin sensors show unit.json
urbantwin sensors --json | jq '.sensors[].name'
"""


def sensors(
    name: Annotated[
        str | None,
        typer.Argument(help="A model, or the path of a sensor's file (.yaml, .json, .csv)."),
    ] = None,
    shown: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="The model, after `show`.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print names only.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the sensors of the catalogue, or `show NAME`: everything known of one."""
    if name == "show":
        if shown is None:
            raise ut.InputError("show needs a sensor", expected="urbantwin sensors show NAME")
        name = shown
    elif shown is not None:
        raise ut.InputError(f"two sensors, {name!r} and {shown!r}", expected="one")
    known = ut.sensors() if name is None else ut.sensors(name)
    if as_json:
        Console(as_json=True).result(known.summary())
    else:
        print("\n".join(known.names) if quiet else known)
