"""``urbantwin campaign``: sites, seeds, scenarios, rigs and weather, recorded with each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Ray, Workers

__all__ = ["EXAMPLES", "campaign"]

EXAMPLES = """
urbantwin campaign grid.yaml --plan
urbantwin campaign grid.yaml -o campaign/ --workers 8
urbantwin campaign grid.yaml -o campaign/ --most 1
urbantwin campaign grid.yaml -o /shared/campaign/ --ray auto
"""


def campaign(
    grid: Annotated[
        Path, typer.Argument(help="A .yaml with sites, seeds, scenarios, rigs and weather.")
    ],
    out: Out = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Only say what is left, how long it takes, how large.")
    ] = False,
    most: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Record so many datasets at most, now."),
    ] = None,
    workers: Workers = None,
    ray: Ray = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Record every site with every seed, scenario, rig and weather. Run again, it goes on."""
    made = ut.campaign(
        grid, out, plan=plan, most=most, workers=workers, ray=ray, progress=not quiet
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
    made.check()
