"""``urbantwin suite``: scenarios driven again, and what became different."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

__all__ = ["EXAMPLES", "suite"]

EXAMPLES = """
urbantwin suite scenarios/ --accept
urbantwin suite scenarios/
urbantwin suite scenarios/ -o changes.md --json
"""


def suite(
    folder: Annotated[Path, typer.Argument(help="A folder with suite.yaml and scenarios.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The table (Markdown) to write.  [default: changes.md in the folder]",
        ),
    ] = None,
    accept: Annotated[
        bool, typer.Option("--accept", help="Store what the cases are now as what is expected.")
    ] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Drive scenarios with seeds again; say which event and actor changed, and from when on."""
    made = ut.suite(folder, out, accept=accept, overwrite=overwrite, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
    made.check()
