"""``urbantwin track``: who is who in detections of frame after frame."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "track"]

EXAMPLES = """
urbantwin track detections/ -o tracked/
urbantwin track detections/ -o tracked/ --rate 10
urbantwin track detections/ -o tracked/ --smooth
urbantwin track detections/ -o tracked/ --frames dataset/
"""


def track(
    detections: Annotated[
        Path, typer.Argument(help="A folder of detections: `urbantwin detect` writes such.")
    ],
    out: Out = None,
    frames: Annotated[
        Path | None,
        typer.Option(help="The recording: says where a sensor is that rides, and when."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            min=0.1,
            max=1000.0,
            help="Frames per second.  [default: as the detections say]",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth", help="Use what came later, too: join broken tracks, smooth places."
        ),
    ] = False,
    gap: Annotated[
        float,
        typer.Option(metavar="S", min=0.0, max=60.0, help="So long nobody need be detected."),
    ] = 2.0,
    birth: Annotated[
        float,
        typer.Option(metavar="SCORE", min=0.0, max=1.0, help="From this on a track may begin."),
    ] = 0.3,
    lowest: Annotated[
        float,
        typer.Option(metavar="SCORE", min=0.0, max=1.0, help="Below this nothing is detected."),
    ] = 0.1,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Follow road users through detections: one class and size each, gaps filled and marked."""
    made = ut.track(
        detections,
        out,
        frames=frames,
        rate=rate,
        smooth=smooth,
        gap=gap,
        birth=birth,
        lowest=lowest,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
