"""``urbantwin vary``: the same recording with one factor changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet, Workers

__all__ = ["EXAMPLES", "vary"]

EXAMPLES = """
urbantwin vary run.yaml --set sensor.height=6.5 -o pair/
urbantwin vary urbantwin-demo/ --set sensor.height=4,5,6.5 -o sweep/
urbantwin vary run.yaml --set scenario=cyclist.yaml -o added/
urbantwin vary run.yaml --set insert=bicycle -o cyclist/
urbantwin vary run.yaml --set signal.J1.offset=10 -o later/
"""


def vary(
    run: Annotated[Path, typer.Argument(help="A run.yaml, or the folder of a run.")],
    changes: Annotated[
        str,
        typer.Option("--set", metavar="FACTOR=VALUES", help="What differs: sensor.height=4,6.5."),
    ],
    out: Out = None,
    workers: Workers = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Record the same with one factor changed; prove it; say what became of every object."""
    made = ut.vary(
        run, out, changes=changes, workers=workers, pictures=pictures, progress=not quiet
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
