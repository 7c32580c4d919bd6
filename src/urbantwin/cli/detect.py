"""``urbantwin detect``: road users in the frames of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, PartOfSplit, Quiet

__all__ = ["EXAMPLES", "detect"]

EXAMPLES = """
urbantwin detect model/ dataset/ -o detections/
urbantwin detect model/ kitti/training/ -o detections/
urbantwin detect model/ dataset/ -o detections/ --part test
urbantwin detect model/ real/ -o detections/ --least 0.3
urbantwin detect model/ real/ -o detections/ --views 4
urbantwin detect model/ another-hour/ -o before/
urbantwin detect model/ real/ -o detections/ --standing before/
"""


def detect(
    model: Annotated[Path, typer.Argument(help="A folder that `urbantwin train` wrote.")],
    frames: Annotated[Path, typer.Argument(help="Frames: a dataset or a real recording.")],
    out: Out = None,
    least: Annotated[
        float,
        typer.Option(metavar="SCORE", min=0.001, max=0.999, help="Leave out what is less likely."),
    ] = 0.05,
    layout: Annotated[
        str | None, typer.Option(help="How the frames lie.  [default: found out]")
    ] = None,
    part: PartOfSplit = "all",
    standing: Annotated[
        Path | None,
        typer.Option(
            help="Detections in other frames of the same fixed sensors: people and riders that "
            "are at one place in half of them are left out."
        ),
    ] = None,
    views: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            max=8,
            help="Look at each frame from so many sides and take the mean: N times as long.",
        ),
    ] = 1,
    second_look: Annotated[
        bool,
        typer.Option(
            help="Look again at the points of people and two-wheelers that are found, if the model "
            "has learned to."
        ),
    ] = True,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Detect road users: boxes with classes and scores for `track` and `evaluate`."""
    made = ut.detect(
        model,
        frames,
        out,
        least=least,
        layout=layout,
        part=part,
        standing=standing,
        views=views,
        second_look=second_look,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
