"""``urbantwin observe``: who drives, rides and walks in frames without labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "observe"]

EXAMPLES = """
urbantwin discover real/ -o rig.yaml --frames rings/
urbantwin observe rings/ -o observed/ --rate 10
urbantwin observe rings/ -o observed/ --times times.csv
urbantwin observe rings/ -o observed/ --twin twin/
urbantwin detect detector/ rings/ -o detections/
urbantwin observe rings/ -o observed/ --twin twin/ --detections detections/
urbantwin replay observed/tracks.csv --twin twin/ -o motion/
"""


def observe(
    frames: Annotated[
        Path, typer.Argument(help="A folder that `urbantwin discover --frames` wrote.")
    ],
    out: Out = None,
    twin: Annotated[
        Path | None,
        typer.Option(help="A twin of the place: what waits on its lanes is seen, too."),
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(help="What `urbantwin detect` found in these frames: who walks and rides."),
    ] = None,
    rate: Annotated[
        float, typer.Option(metavar="HZ", min=0.1, max=50.0, help="Frames per second.")
    ] = 10.0,
    times: Annotated[
        Path | None,
        typer.Option(
            help="A table, frame and seconds, for frames that are not evenly spaced; without it "
            "gaps are found by what moves."
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find what moves in frames of sensors that stand still: tracks, and a picture to draw on."""
    made = ut.observe(
        frames,
        out,
        twin=twin,
        detections=detections,
        rate=rate,
        times=times,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
