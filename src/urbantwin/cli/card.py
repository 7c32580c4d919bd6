"""``urbantwin card``: what a dataset is, how it was made, and what may be done with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Pictures, Quiet

__all__ = ["EXAMPLES", "card"]

EXAMPLES = """
urbantwin card out/dataset
urbantwin card out/dataset -o card/ --no-pictures
urbantwin card graded/
"""


def card(
    path: Annotated[
        Path, typer.Argument(help="A dataset, an exported dataset, or a folder of them.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="The folder to write.  [default: the dataset]"
        ),
    ] = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a dataset's card: README.md with pictures, statistics, licences and limits."""
    made = ut.card(path, out, pictures=pictures, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
