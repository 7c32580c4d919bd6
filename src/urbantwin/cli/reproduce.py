"""``urbantwin reproduce``: a dataset made again from its manifest, and compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet, Workers

__all__ = ["EXAMPLES", "reproduce"]

EXAMPLES = """
urbantwin reproduce out/dataset/dataset.json
urbantwin reproduce dataset.json --inputs maps/ --inputs sensors/
urbantwin reproduce out/dataset -o again/ --workers 4
urbantwin reproduce out/dataset --twin out/twin --motion out/motion
urbantwin reproduce out/dataset --json | jq .why
"""


def reproduce(
    path: Annotated[Path, typer.Argument(help="A dataset's folder, or its dataset.json.")],
    inputs: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Where inputs are looked for first, by name and SHA-256; then around the dataset "
            "and in the current folder.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Keep what is made: twin, motion and dataset. If not given, it goes again.",
        ),
    ] = None,
    twin: Annotated[
        Path | None, typer.Option(help="The dataset's twin, not to build it again.")
    ] = None,
    motion: Annotated[
        Path | None, typer.Option(help="The dataset's motion, not to simulate it again.")
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Make a dataset again from its manifest, and say whether the bytes are the same or why not."""
    console = Console(quiet=quiet, as_json=as_json)
    found = ut.reproduce(
        path,
        inputs=inputs or (),
        out=out,
        twin=twin,
        motion=motion,
        workers=workers,
        note=console.note,
        progress=not quiet,
    )
    console.result(found.summary())
    found.check()
