"""``urbantwin label``: frames that a model labels, for another to learn from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "label"]

EXAMPLES = """
urbantwin label teacher/ real/ -o labelled/ --rate 10
urbantwin label teacher/ kitti/training/ -o labelled/
urbantwin train labelled/ dataset/ -o student/ --from teacher/
"""


def label(
    model: Annotated[Path, typer.Argument(help="The teacher: a folder of `urbantwin train`.")],
    frames: Annotated[Path, typer.Argument(help="Frames: a real recording, or a dataset.")],
    out: Out = None,
    sure: Annotated[
        float, typer.Option(min=0.001, max=0.999, help="A box with this score is a label.")
    ] = 0.5,
    doubtful: Annotated[
        float, typer.Option(min=0.001, max=0.999, help="One with less, down to this, is ignored.")
    ] = 0.15,
    rate: Annotated[
        float | None,
        typer.Option(min=0.01, metavar="HZ", help="Frames follow each other: track them, too."),
    ] = None,
    layout: Annotated[
        str | None, typer.Option(help="How the frames lie.  [default: found out]")
    ] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Label frames by a model: what it is sure of is a label, what it doubts does not count."""
    made = ut.label(
        model,
        frames,
        out,
        sure=sure,
        doubtful=doubtful,
        rate=rate,
        layout=layout,
        device=device,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
