"""``urbantwin verify``: whether artefacts are what was written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet

__all__ = ["EXAMPLES", "verify"]

EXAMPLES = """
urbantwin verify out/
urbantwin verify out/dataset
urbantwin verify carla/
urbantwin verify out/dataset --privacy
urbantwin verify twin/ --json | jq '.artefacts[].wrong'
"""

#: So many files are listed on a terminal; ``--json`` has all.
SHOWN = 20


def verify(
    path: Annotated[
        Path,
        typer.Argument(
            help="An artefact, or a folder of them: what `run` wrote, or `export` to CARLA."
        ),
    ],
    privacy: Annotated[
        bool,
        typer.Option(
            "--privacy",
            help="Search all files, too, for paths, names, e-mail addresses and time stamps.",
        ),
    ] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find damaged files of artefacts by their checksums; put CARLA packages before its rules."""
    found = ut.verify(path, privacy=privacy, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(found.summary(None if as_json else SHOWN))
    found.check()
