"""``urbantwin teach``: from a place to a detector for its own sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AllowKey, AsJson, KeyEnv, Out, Quiet, Workers

__all__ = ["EXAMPLES", "teach"]

EXAMPLES = """
urbantwin teach site.yaml -o detector/
urbantwin teach site.yaml -o detector/ --plan
urbantwin teach site.yaml -o detector/ --minutes 60 --drives 8 --real labelled/
"""


def teach(
    site: Annotated[Path, typer.Argument(help="A site.yaml with its rig.")],
    out: Out = None,
    minutes: Annotated[float, typer.Option(min=0.1, help="Minutes of training.")] = 30.0,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of training, in place of minutes.")
    ] = None,
    drives: Annotated[int, typer.Option(min=1, help="Drives to learn from.")] = 6,
    judging: Annotated[int, typer.Option(min=1, help="Drives to judge by.")] = 2,
    seconds: Annotated[float, typer.Option(min=3.0, help="Length of each drive.")] = 200.0,
    every: Annotated[float, typer.Option(min=0.05, help="Seconds between its frames.")] = 4.0,
    real: Annotated[
        list[Path] | None, typer.Option(help="Labelled real frames to judge by, too.")
    ] = None,
    background: Annotated[
        list[str] | None,
        typer.Option(metavar="[NAME=]FILE", help="What real sensors measured (`background`)."),
    ] = None,
    within: Annotated[
        tuple[float, float],
        typer.Option(metavar="M DEG", help="How far off the rig's places and angles may be."),
    ] = (0.05, 0.3),
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random choice.")] = 1,
    workers: Workers = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    plan: Annotated[bool, typer.Option("--plan", help="Only say how long it takes.")] = False,
    key_env: KeyEnv = None,
    allow_key: AllowKey = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Make a detector for a place's own sensors; interrupted, the same command goes on."""
    made = ut.teach(
        site,
        out,
        minutes=minutes,
        steps=steps,
        drives=drives,
        judging=judging,
        seconds=seconds,
        every=every,
        real=real or (),
        background=background or (),
        within=within,
        seed=seed,
        workers=workers,
        device=device,
        plan=plan,
        key_env=key_env,
        allow_key=allow_key,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
