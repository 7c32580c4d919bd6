"""``urbantwin pretrain``: a network that learns from frames without labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, PartOfSplit, Quiet

__all__ = ["EXAMPLES", "pretrain"]

EXAMPLES = """
urbantwin pretrain real/ -o pretrained/
urbantwin pretrain real/ dataset/ -o pretrained/ --minutes 20
urbantwin pretrain dataset/ -o pretrained/ --task next-sweep
urbantwin train dataset/ -o model/ --from pretrained/
"""


def pretrain(
    frames: Annotated[list[Path], typer.Argument(help="Frames, real or simulated.")],
    out: Out = None,
    task: Annotated[
        str,
        typer.Option(metavar="NAME", help="masked (hidden pillars), or next-sweep."),
    ] = "masked",
    steps: Annotated[int | None, typer.Option(min=1, help="Train for so many steps.")] = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0.1, help="As many steps as fit into this.  [default: 10]"),
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
    part: PartOfSplit = "train",
    seed: Annotated[int, typer.Option(min=0, help="Seed of weights and samples.")] = 0,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Processes that make samples.")] = 1,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Train a network without labels, for `train --from`: it guesses what it is not shown."""
    made = ut.pretrain(
        frames,
        out,
        task=task,
        steps=steps,
        minutes=minutes,
        reach=reach,
        cell=cell,
        batch=batch,
        width=width,
        intensity=intensity,
        part=part,
        seed=seed,
        workers=workers,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
