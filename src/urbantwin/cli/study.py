"""``urbantwin study``: what faults, weather and traffic do, level by level, over seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Workers

__all__ = ["EXAMPLES", "study"]

EXAMPLES = """
urbantwin study grid.yaml --plan
urbantwin study grid.yaml -o study/
urbantwin study grid.yaml -o study/ --device cuda --json
"""


def study(
    grid: Annotated[Path, typer.Argument(help="A .yaml with twin, seeds and factors.")],
    out: Out = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Only say what would be done, and how long it takes.")
    ] = False,
    workers: Workers = None,
    device: Annotated[str, typer.Option(help="Of torch: cpu, cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure what faults, weather and traffic do to detection and tracking: sizes of effects."""
    made = ut.study(grid, out, plan=plan, workers=workers, device=device, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
