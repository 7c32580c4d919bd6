"""``urbantwin evaluate``: how good detections are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, PartOfSplit, Quiet

__all__ = ["EXAMPLES", "evaluate"]

EXAMPLES = """
urbantwin evaluate detections/ dataset/ -o report/
urbantwin evaluate detections/ kitti/training/ -o report/ --within 40
urbantwin evaluate detections/ real/ -o report/ --class car --class pedestrian
urbantwin evaluate model/ dataset/ -o report/ --part test
"""


def evaluate(
    detections: Annotated[
        Path, typer.Argument(help="Detections (ours, KITTI's, OpenPCDet's, nuScenes'), or a model.")
    ],
    data: Annotated[
        Path, typer.Argument(help="Labelled frames: a dataset of ours or a real recording.")
    ],
    out: Out = None,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="NAME", help="Judge this class.  [default: all labelled]"),
    ] = None,
    layout: Annotated[
        str | None, typer.Option(help="How the data lies.  [default: found out]")
    ] = None,
    part: PartOfSplit = "all",
    within: Annotated[
        float | None,
        typer.Option(metavar="M", min=1.0, max=1000.0, help="Nothing farther counts."),
    ] = None,
    fewest_points: Annotated[
        int | None,
        typer.Option(min=1, max=1000, help="Boxes with fewer do not count.  [default: 5]"),
    ] = None,
    vans: Annotated[bool, typer.Option("--vans", help="Count KITTI's vans as cars.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Judge detections by labels: average precision, errors, false alarms, the worst misses."""
    made = ut.evaluate(
        detections,
        data,
        out,
        classes=classes,
        layout=layout,
        part=part,
        within=within,
        fewest_points=fewest_points,
        vans=vans,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
