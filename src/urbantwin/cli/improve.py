"""``urbantwin improve``: a model learns from more of what it misses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Workers

__all__ = ["EXAMPLES", "improve"]

EXAMPLES = """
urbantwin improve model/ twin/ -o improved/
urbantwin improve detector/model/ detector/lessons/twin/ -o improved/ --minutes 20
urbantwin improve model/ twin/ -o improved/ --also dataset/ --real labelled/
"""


def improve(
    model: Annotated[Path, typer.Argument(help="A folder of `urbantwin train`.")],
    twin: Annotated[Path, typer.Argument(help="A twin's folder, with its rig.")],
    out: Out = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    drives: Annotated[int, typer.Option(min=1, help="Drives with more of what is missed.")] = 2,
    events: Annotated[int, typer.Option(min=1, help="Put into each of them, at most.")] = 20,
    seconds: Annotated[float, typer.Option(min=7.0, help="Length of each drive.")] = 120.0,
    every: Annotated[float, typer.Option(min=0.05, help="Seconds between its frames.")] = 2.0,
    minutes: Annotated[float, typer.Option(min=0.1, help="Minutes of training.")] = 10.0,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of training, in place of minutes.")
    ] = None,
    also: Annotated[
        list[Path] | None, typer.Option(help="Learn from this dataset, too: nothing is forgotten.")
    ] = None,
    real: Annotated[
        list[Path] | None, typer.Option(help="Labelled real frames to judge by, too.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random choice.")] = 1,
    workers: Workers = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find what a model misses, drive more of that, learn on; interrupted, it goes on."""
    made = ut.improve(
        model,
        twin,
        out,
        rig=rig,
        drives=drives,
        events=events,
        seconds=seconds,
        every=every,
        minutes=minutes,
        steps=steps,
        also=also or (),
        real=real or (),
        seed=seed,
        workers=workers,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
