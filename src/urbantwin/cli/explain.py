"""``urbantwin explain``: why objects are missed in one recording and found in another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "explain"]

EXAMPLES = """
urbantwin explain pair/ --model model/
urbantwin explain pair/ --model model/ --by overlap -o why/
urbantwin explain pair/ --detections base-found/ --detections value-found/ --score 0.3
"""


def explain(
    pair: Annotated[Path, typer.Argument(help="A folder that `urbantwin vary` wrote.")],
    out: Out = None,
    model: Annotated[
        Path | None, typer.Option(help="A detector, which detects in all recordings.")
    ] = None,
    detections: Annotated[
        list[Path] | None,
        typer.Option(
            help="What was detected: of the base, then of each value; in place of a model."
        ),
    ] = None,
    score: Annotated[
        float | None,
        typer.Option(help="From which on a detection counts.  [default: the base's best F1]"),
    ] = None,
    by: Annotated[
        str, typer.Option(help="How a detection finds an object: distance or overlap.")
    ] = "distance",
    drawn: Annotated[
        int, typer.Option(min=0, max=10_000, help="So many objects are drawn at most.")
    ] = 60,
    device: Annotated[str, typer.Option(help="Of torch: cpu, cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Say which objects one factor makes a detector miss or find, and why."""
    made = ut.explain(
        pair,
        out,
        model=model,
        detections=detections or (),
        score=score,
        by=by,
        drawn=drawn,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
