"""``urbantwin curriculum``: graded datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Seed, Workers

__all__ = ["EXAMPLES", "curriculum"]

EXAMPLES = """
urbantwin curriculum twin/ -o graded/
urbantwin curriculum twin/ -o graded/ --ladder range --seconds 20
urbantwin curriculum twin/ -o graded/ --ladder ladder.yaml --rig rig.yaml
"""


def curriculum(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out = None,
    ladder: Annotated[
        str,
        typer.Option(help="all, density, occlusion or range; or a .yaml file with grades."),
    ] = "all",
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own if not given.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=86400.0, help="Length of each motion; the site's if not given."),
    ] = None,
    start: Annotated[float, typer.Option(help="No frame before, seconds of the motion.")] = 0.0,
    stop: Annotated[float | None, typer.Option(help="No frame after.")] = None,
    seed: Seed = None,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Record a dataset for each grade of a ladder of density, occlusion and range."""
    made = ut.curriculum(
        twin,
        out,
        ladder=ladder,
        rig=rig,
        seconds=seconds,
        start=start,
        stop=stop,
        seed=seed,
        workers=workers,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
