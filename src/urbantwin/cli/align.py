"""``urbantwin align``: where in a twin a real sensor stands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet, RigPicture

__all__ = ["EXAMPLES", "align"]

EXAMPLES = """
urbantwin align real/ twin/ -o rig.yaml
urbantwin align real/ twin/ --guess 12 -7 135 -o rig.yaml
urbantwin align real_b/ twin/ --rig rig.yaml --sensor b --frames 0,5,10 -o rig.yaml
urbantwin align real/ twin/ --anywhere --rig rig.yaml -o rig.yaml
"""


def align(
    real: Annotated[Path, typer.Argument(help="A real frame, or a recording of them.")],
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The rig to write.")],
    rig: Annotated[
        Path | None,
        typer.Option(help="The rig whose first sensor it is; the twin's own if not given."),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The sensor that recorded, which alone moves; else the first, and others "
            "move with it.",
        ),
    ] = None,
    frames: Annotated[
        str,
        typer.Option(
            metavar="N,N,...",
            help="Numbers of frames from 0, or all; of a sensor that stands still their mean.",
        ),
    ] = "0",
    guess: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="E N YAW",
            help="Roughly where: metres from the anchor, degrees from east; else as the rig says.",
        ),
    ] = None,
    anywhere: Annotated[
        bool, typer.Option("--anywhere", help="Search the whole region, with any heading.")
    ] = False,
    within: Annotated[
        tuple[float, float],
        typer.Option(metavar="M DEG", help="How far off the rough place and heading may be."),
    ] = (3.0, 15.0),
    level: Annotated[
        bool,
        typer.Option("--level", help="The points are level with gravity; the rig says the tilt."),
    ] = False,
    picture: RigPicture = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find the pose of a sensor in a twin from real frames, and write it into a rig."""
    made = ut.align(
        real,
        twin,
        out,
        rig=rig,
        sensor=sensor,
        frames=frames,
        guess=guess,
        anywhere=anywhere,
        within=within,
        level=level,
        picture=picture,
        overwrite=overwrite,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
