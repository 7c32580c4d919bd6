"""``urbantwin sequence``: tracks, poses and flow of a dataset as files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "sequence"]

EXAMPLES = """
urbantwin sequence dataset/ -o sequence/ --flow
urbantwin sequence dataset/ -o sequence/ --flow --ego
urbantwin sequence dataset/ -o sequence/ --csv
urbantwin sequence older_dataset/ --motion motion/ -o sequence/
"""


def sequence(
    dataset: Annotated[Path, typer.Argument(help="A dataset: `urbantwin record` writes such.")],
    out: Out = None,
    motion: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="What it was recorded of: for trajectories, which older datasets lack.",
        ),
    ] = None,
    flow: Annotated[
        bool,
        typer.Option("--flow", help="Write where each point goes until the next frame, too."),
    ] = False,
    ego: Annotated[
        bool,
        typer.Option("--ego", help="With the motion of who looks, as Argoverse 2 has it."),
    ] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Write each table as CSV, too.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Follow a dataset's actors and sensors: tracks, tracklets, trajectories, poses, flow."""
    made = ut.sequence(dataset, out, motion=motion, flow=flow, ego=ego, csv=csv, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
