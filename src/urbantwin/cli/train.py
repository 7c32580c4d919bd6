"""``urbantwin train``: a detector that learns from labelled frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, PartOfSplit, Quiet

__all__ = ["EXAMPLES", "train"]

EXAMPLES = """
urbantwin train dataset/ -o model/
urbantwin train munich/dataset/ taipei/dataset/ -o model/ --minutes 30
urbantwin train dataset/ -o model/ --steps 2000 --class car --class pedestrian
urbantwin train dataset/ -o model/ --head boxes --head points
urbantwin train split.json -o model/
urbantwin train dataset/ -o finer/ --from model/ --minutes 20
"""


def train(
    datasets: Annotated[list[Path], typer.Argument(help="Labelled frames: datasets of `record`.")],
    out: Out = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Train for so many steps.")] = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0.1, help="As many steps as fit into this.  [default: 10]"),
    ] = None,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="NAME", help="Learn this class.  [default: all]"),
    ] = None,
    reach: Annotated[
        float,
        typer.Option("--range", metavar="M", min=10.0, max=300.0, help="Look so far, x and y."),
    ] = 60.0,
    cell: Annotated[
        float, typer.Option(metavar="M", min=0.1, max=1.0, help="Edge of a pillar.")
    ] = 0.4,
    batch: Annotated[int, typer.Option(min=1, max=256, help="Samples of a step.")] = 4,
    width: Annotated[
        float, typer.Option(min=0.25, max=8.0, help="Times the channels of the small network.")
    ] = 1.0,
    intensity: Annotated[
        bool, typer.Option("--intensity", help="Tell it of intensities, too.")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help="Do not vary samples so: placed (turned, mirrored, scaled), beams (fewer), "
            "objects (of other frames), sizes (of objects), clutter (bushes, walls, posts).",
        ),
    ] = None,
    heads: Annotated[
        list[str] | None,
        typer.Option(
            "--head",
            metavar="NAME",
            help="What it tells: boxes, points (the class of each).  [default: boxes]",
        ),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option("--from", metavar="MODEL", help="Begin with the weights of this model."),
    ] = None,
    in_order: Annotated[
        bool,
        typer.Option("--in-order", help="One dataset after the other; needs --steps."),
    ] = False,
    second_look: Annotated[
        bool,
        typer.Option(
            help="Learn to look again at the points of people and two-wheelers that are found."
        ),
    ] = True,
    part: PartOfSplit = "train",
    seed: Annotated[int, typer.Option(min=0, help="Seed of weights and samples.")] = 0,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Processes that make samples.")] = 1,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Train a detector of road users; interrupted, the same command goes on."""
    made = ut.train(
        datasets,
        out,
        steps=steps,
        minutes=minutes,
        classes=classes,
        reach=reach,
        cell=cell,
        batch=batch,
        width=width,
        intensity=intensity,
        without=without or (),
        heads=heads,
        start=start,
        in_order=in_order,
        second_look=second_look,
        part=part,
        seed=seed,
        workers=workers,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
