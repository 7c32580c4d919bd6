"""``urbantwin discover``: which sensors recorded frames, and where they stand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet, RigPicture

__all__ = ["EXAMPLES", "discover"]

EXAMPLES = """
urbantwin discover real/ -o rig.yaml
urbantwin discover frame.bin -o rig.yaml --picture found.png
urbantwin discover real/ -o rig.yaml --frames rings/
"""


def discover(
    real: Annotated[
        Path,
        typer.Argument(help="Frames of sensors that stand still, fused or of one; or one frame."),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The rig to write.")],
    frames: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Write all frames with sensor, ring and column of every point."
        ),
    ] = None,
    picture: RigPicture = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find the sensors of unlabelled frames: their places, tilts and models."""
    made = ut.discover(
        real, out, frames=frames, picture=picture, overwrite=overwrite, progress=not quiet
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
