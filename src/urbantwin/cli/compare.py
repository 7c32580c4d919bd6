"""``urbantwin compare``: how near a synthetic dataset is to real clouds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Layout, Out, Quiet, RowWidth, Workers

__all__ = ["EXAMPLES", "compare"]

EXAMPLES = """
urbantwin compare real/ out/dataset/ -o report/
urbantwin compare real/ out/dataset/ -o report/ --arbitrary elsewhere/
urbantwin compare real/ out/dataset/ -o report/ --arbitrary none
urbantwin compare real/ out/dataset/ -o report/ --protocol urbantwin-challenge
urbantwin compare later/ out/dataset/ -o report/ --anchor earlier/ --within 40 40 5
urbantwin compare --objects kitti/training -o objects/
urbantwin compare --objects clouds/ --layout tumtraf --sensor OS1-64 -o objects/
"""


def compare(
    real: Annotated[
        Path,
        typer.Argument(
            help="Real frames: clouds, a dataset in a layout that is known, a ROS bag or MCAP, a "
            "capture of packets."
        ),
    ],
    dataset: Annotated[
        Path | None,
        typer.Argument(
            help="A dataset, or a folder of clouds in the same frame; none with --objects."
        ),
    ] = None,
    out: Out = None,
    objects: Annotated[
        bool,
        typer.Option(
            "--objects",
            help="Put our bodies into the boxes of labelled real frames and compare points, shape, "
            "codes and lost rays, ray by ray: without twin and dataset.",
        ),
    ] = False,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="With --objects: what recorded the real frames.  [default: by their layout]",
        ),
    ] = None,
    arbitrary: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Clouds of another site, measured alike as a control; none: no control.  "
            "[default: an example site, recorded by the dataset's sensors]",
        ),
    ] = None,
    anchor: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Other real frames of the place, for real against real.  [default: each frame's "
            "neighbour]",
        ),
    ] = None,
    within: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Crop all sides to so much each way from the frame's origin, metres.",
        ),
    ] = None,
    layout: Layout = None,
    columns: RowWidth = None,
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="The sensor's place in the clouds' frame, metres.  [default: what the data says]",
        ),
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(help="A challenge's protocol to compute as well: urbantwin-challenge."),
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Detections in the real frames, for the protocol."),
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure synthetic frames against real ones, or bodies in the boxes of real objects."""
    made = ut.compare(
        real,
        dataset,
        out,
        objects=objects,
        sensor=sensor,
        arbitrary=arbitrary,
        anchor=anchor,
        within=within,
        layout=layout,
        columns=columns,
        origin=origin,
        protocol=protocol,
        detections=detections,
        workers=workers,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
