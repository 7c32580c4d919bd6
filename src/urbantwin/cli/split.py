"""``urbantwin split``: datasets divided into training, validation and test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet, SplitGap, Thin

__all__ = ["EXAMPLES", "split"]

EXAMPLES = """
urbantwin split dataset/ --shares 60,20,20 --gap 5
urbantwin split dataset/ --thin 0.5
urbantwin split seed1/dataset/ seed2/dataset/ seed3/dataset/ -o split.json
urbantwin split graded/ --by scenario && urbantwin train graded/split.json
urbantwin split variation/ --by time
"""


def split(
    datasets: Annotated[
        list[Path],
        typer.Argument(help="Datasets, or folders that hold some.", metavar="DATASET"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="By scenario, the document to write.  [default: split.json beside the first]",
        ),
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="WAY", help="time, or scenario.  [default: by scenario where there are several]"
        ),
    ] = None,
    shares: Annotated[
        str, typer.Option(metavar="SHARES", help="Of training, validation and test.")
    ] = "70,15,15",
    gap: SplitGap = None,
    thin: Thin = None,
    seed: Annotated[
        int, typer.Option(min=0, help="By scenario, of the order in which they are divided.")
    ] = 0,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Divide datasets into training, validation and test parts that do not leak."""
    made = ut.split(
        datasets,
        out,
        by=by,
        shares=shares,
        gap=gap,
        thin=thin,
        seed=seed,
        overwrite=overwrite,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
