"""``urbantwin coverage``: where a rig sees how much."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet

__all__ = ["EXAMPLES", "coverage"]

EXAMPLES = """
urbantwin coverage twin/ -o coverage/
urbantwin coverage twin/ --rig rig.yaml -o coverage/ --cell 1
"""


def coverage(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    cell: Annotated[float, typer.Option(metavar="M", help="Side of a cell of the map.")] = 0.5,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Map the points per square metre that a rig gets from the ground and 1 m above it."""
    made = ut.coverage(twin, out, rig=rig, cell=cell, pictures=pictures, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
