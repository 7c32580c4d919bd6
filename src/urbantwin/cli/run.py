"""``urbantwin run``: a site's twin, motion and dataset, one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet, Workers

__all__ = ["EXAMPLES", "run"]

EXAMPLES = """
urbantwin run site.yaml -o out/
urbantwin run examples/two-avenues/site.yaml -o out/ --workers 2
"""


def run(
    site: Annotated[Path, typer.Argument(help="A site.yaml.")],
    out: Out = None,
    workers: Workers = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Go the whole way: twin, motion and dataset of a site."""
    made = ut.run(site, out, workers=workers, pictures=pictures, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
