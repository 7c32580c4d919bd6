"""``urbantwin place``: which sensors, where, before the pole is bought."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Workers

__all__ = ["EXAMPLES", "place"]

EXAMPLES = """
urbantwin place twin/ motion/ -o placement/
urbantwin place twin/ motion/ -o placement/ --wish place.yaml --layouts 1000
urbantwin place twin/ motion/ -o placement/ --train 5 --steps 2000
urbantwin record twin/ motion/ --rig placement/rigs/layout-0042.yaml -o dataset/
"""


def place(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    motion: Annotated[Path, typer.Argument(help="A motion on it, which all layouts see.")],
    out: Out = None,
    wish: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML", help="A place.yaml: candidates, models with prices, objectives."
        ),
    ] = None,
    layouts: Annotated[int, typer.Option(min=1, help="How many are judged.")] = 500,
    train: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Layouts of the front that a detector is trained for."
        ),
    ] = 0,
    steps: Annotated[
        int, typer.Option(min=1, help="Of training on all of them, and a quarter more on each.")
    ] = 1000,
    seed: Annotated[
        int, typer.Option(min=0, help="The number that everything random follows from.")
    ] = 0,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Search for layouts of sensors that see most of a motion for what they cost."""
    made = ut.place(
        twin,
        motion,
        out,
        wish=wish,
        layouts=layouts,
        train=train,
        steps=steps,
        seed=seed,
        workers=workers,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
