"""``urbantwin demo``: a real signalised intersection in central Helsinki."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet, Workers

__all__ = ["EXAMPLES", "demo"]

EXAMPLES = """
urbantwin demo
urbantwin demo -o /tmp/helsinki --workers 2
"""


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="The folder to write.")
    ] = Path("urbantwin-demo"),
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run a real intersection in central Helsinki, map to frames."""
    made = ut.demo(out, workers=workers, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
